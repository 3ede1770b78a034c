"""What is no longer where it was: two witnesses, LiDAR and camera, each trusted as far as it has earned.

*LiDAR.* A scan becomes an image of ranges about the sensor. A point of an instance is passed through when what was measured in its
direction lies clearly behind it, confirmed when something lies about there, and undecided when the view is blocked or nothing was
measured. How much of it is passed while the camera sees the thing is kept: rays that always passed (glass, thin rods) say nothing.

*Camera.* A picture that shows the place from where the thing was detected before, and no farther, and has no mask on it, is a miss.
A detector misses things for a while, from one place above all: misses count by looks, pictures from places apart, and weigh as much as
the thing was reliably detected before. What is thick and still confirmed by the LiDAR is there, whatever the camera misses.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from irsd.core.geometry import Pose
from irsd.core.jit import kernel
from irsd.core.settings import setting
from irsd.core.times import is_due
from irsd.instances.voxels import Floats

_BIN_RAD = np.deg2rad(1.0)
_COLUMNS, _ROWS = 360, 180
_PROBES = 128  # points of an instance that are asked about
_NEVER = -(1 << 62)
_DECIDED = 0.35  # of its points that rays came near, or the look was none: what is hidden can't be missed
_SECTORS = 16  # directions from which a thing was detected
_PER_LOOK = 3  # pictures of one look that count: those from one place err alike
_FRESH_NS = (
    300_000_000  # a thing detected this short ago is there: what the LiDAR says then is what it says of such a thing
)
_SILENT = 0.5  # where this share of the rays passed all along, they tell nothing
_USUAL = 0.1  # more than usual by this share is still usual
_THICK_M = 0.15  # what is thinner can lie on a wall that confirms its place
_SUPPOSED_M = 3.0  # from how far most things are detected
_NEARER = 1.1  # times the distance from which it was detected


@dataclass(frozen=True)
class ChangeSettings:
    """When a thing counts as carried away, and when as moved."""

    enabled: bool = setting(True, "let what is seen at the place of a thing speak against it")
    looks: int = setting(3, "good looks in a row at the empty place after which a thing is gone", lo=1, hi=100)
    look_period_s: float = setting(0.5, "time between two looks at one thing", lo=0.0, hi=60.0)
    range_m: float = setting(6.0, "things farther from the sensor are not judged", lo=0.5, hi=50.0)
    margin_m: float = setting(0.25, "what was measured this near to a point confirms it", lo=0.02, hi=2.0)
    min_decided: int = setting(
        12, "points that must be passed through or confirmed for a look to be good", lo=1, hi=1000
    )
    passed_share: float = setting(
        0.9, "a look at which this share was passed through finds the place empty", lo=0.5, hi=1.0
    )
    partly_share: float = setting(
        0.3,
        "more passed through than usual by this share: empty if the camera agrees, else a part is gone",
        lo=0.05,
        hi=1.0,
    )
    step_m: float = setting(0.25, "a camera that moved this far takes another look", lo=0.0, hi=10.0)
    turn_rad: float = setting(0.25, "so does one that turned this far", lo=0.0, hi=3.2)
    chance: float = setting(
        1e-5,
        "a thing that the camera alone judges is gone when so many misses by chance are this unlikely",
        lo=0.0,
        hi=0.5,
    )
    keep_s: float = setting(5.0, "how long a thing is still told of as gone before it ends", lo=0.0, hi=3600.0)
    remember_s: float = setting(
        600.0, "a thing like one that left this long ago at most is that one: it has moved", lo=0.0, hi=86_400.0
    )


@kernel
def range_image(origin: NDArray[np.float64], points: Floats) -> tuple[Floats, Floats]:
    """(nearest, farthest) float32 [180, 360] metres by direction of points [N, 3] from origin [3]; inf and 0: nothing."""
    near = np.full((_ROWS, _COLUMNS), np.inf, np.float32)
    far = np.zeros((_ROWS, _COLUMNS), np.float32)
    for p in range(len(points)):
        x, y, z = points[p, 0] - origin[0], points[p, 1] - origin[1], points[p, 2] - origin[2]
        flat = np.sqrt(x * x + y * y)
        distance = np.float32(np.sqrt(flat * flat + z * z))
        column = int((np.arctan2(y, x) + np.pi) / _BIN_RAD) % _COLUMNS
        row = min(int((np.arctan2(z, flat) + np.pi / 2) / _BIN_RAD), _ROWS - 1)
        near[row, column] = min(near[row, column], distance)
        far[row, column] = max(far[row, column], distance)
    return near, far


@kernel
def seen_at(origin: NDArray[np.float64], near: Floats, far: Floats, probes: Floats, margin: float) -> NDArray[np.int8]:
    """Per point [n, 3]: 1 passed through, -1 confirmed, -2 hidden, 0 nothing was measured there (between the beams of a LiDAR).

    Passed only when all that was measured beside it lies behind.
    """
    out = np.zeros(len(probes), np.int8)
    for p in range(len(probes)):
        x, y, z = probes[p, 0] - origin[0], probes[p, 1] - origin[1], probes[p, 2] - origin[2]
        flat = np.sqrt(x * x + y * y)
        distance = np.sqrt(flat * flat + z * z)
        column = int((np.arctan2(y, x) + np.pi) / _BIN_RAD) % _COLUMNS
        row = min(int((np.arctan2(z, flat) + np.pi / 2) / _BIN_RAD), _ROWS - 1)
        if far[row, column] == 0.0:
            continue
        least, most = near[row, column], far[row, column]
        for r in range(max(row - 1, 0), min(row + 2, _ROWS)):
            for c in range(column - 1, column + 2):
                least = min(least, near[r, c % _COLUMNS])
                most = max(most, far[r, c % _COLUMNS]) if far[r, c % _COLUMNS] > 0 else most
        if least > distance + margin:
            out[p] = 1
        elif most >= distance - margin and least >= distance - margin:
            out[p] = -1
        else:
            out[p] = -2
    return out


@dataclass(frozen=True, slots=True)
class Sight:
    """What one scan says of places: its image of ranges about origin [3]."""

    origin: NDArray[np.float64]
    near: Floats
    far: Floats
    margin_m: float

    def of(self, points: Floats) -> NDArray[np.int8]:
        """See ``seen_at``, for points float32 [n, 3]."""
        return seen_at(self.origin, self.near, self.far, points, self.margin_m)


@dataclass(frozen=True, slots=True)
class Verdict:
    """Ids, ascending: whose place is empty; of whom a part is gone. sight: what the scan saw, None when nothing was decided."""

    gone: tuple[int, ...] = ()
    partly: tuple[int, ...] = ()
    sight: Sight | None = None


class Probes(NamedTuple):
    """Points of a thing that are asked about, kept small: they lie within metres of the centre [3]. offset: float16 [n, 3]."""

    centre: NDArray[np.float64]
    offset: NDArray[np.float16]

    @property
    def points(self) -> Floats:
        """float32 [n, 3], to a millimetre."""
        return np.asarray(self.offset.astype(np.float32) + self.centre.astype(np.float32))

    def half(self) -> Probes:
        """Every second of them: enough for where it is and how large."""
        return Probes(self.centre, self.offset[::2].copy())


def probes_of(points: Floats) -> Probes:
    """Some of the points float32 [n, 3] of a thing."""
    chosen = points[:: max(len(points) // _PROBES, 1)]
    centre = chosen.mean(0, np.float64)
    return Probes(centre, (chosen - centre).astype(np.float16))


@dataclass(slots=True)
class _Looked:
    """One thing. probes: some of its points, home: those when all of it was last confirmed; thick_m: least extent; existence: share of
    its pictures that saw it, when it was last detected.

    LiDAR: usual, weight: share passed while it was surely there; empty, partly: looks in a row. Camera: reach_m float32 [16], how
    far off it was detected by direction, looked up again at reach_ns; hits, misses: pictures while it was there; looks, missed:
    since it was last detected.
    """

    probes: Probes
    thick_m: float
    home: Probes
    existence: float
    usual: float = 0.0
    weight: float = 1.0
    empty: int = 0
    partly: int = 0
    there: bool = False
    reach_m: Floats = field(default_factory=lambda: np.zeros(_SECTORS, np.float32))
    reach_ns: int = _NEVER
    seen_ns: int = _NEVER
    hits: int = 0
    misses: int = 0
    looks: int = 0
    missed: int = 0
    look_missed: int = 0
    look_ns: int = _NEVER
    look_pose: Pose | None = None

    def passed(self, share: float, s: ChangeSettings, surely_there: bool) -> None:
        """One good look of the LiDAR that passed through a share of the points."""
        if surely_there:
            self.usual = (self.usual * self.weight + share) / (self.weight + 1.0)
            self.weight = min(self.weight + 1.0, 20.0)
        telling = self.usual < _SILENT
        self.empty = self.empty + 1 if telling and share >= s.passed_share else 0
        self.partly = self.partly + 1 if telling and share >= self.usual + s.partly_share else 0
        confirmed = share <= self.usual + _USUAL
        self.there = confirmed and self.thick_m >= _THICK_M
        if confirmed:
            self.home = self.probes.half()

    def sector(self, camera_m: NDArray[np.float64]) -> tuple[int, float]:
        """(direction, distance_m) of a camera at [3] as seen from the thing."""
        x, y, z = (camera_m - self.probes.centre).tolist()
        turn = (np.arctan2(y, x) / (2 * np.pi)) % 1.0
        return int(turn * _SECTORS) % _SECTORS, float(np.sqrt(x * x + y * y + z * z))

    def detected(self, map_T_camera: Pose, stamp_ns: int, s: ChangeSettings) -> None:
        """A picture has a mask on it."""
        self.hits += 1
        self.seen_ns = stamp_ns
        period_ns = round(s.look_period_s * 1e9)
        if is_due(stamp_ns, self.reach_ns, period_ns):
            sector, distance = self.sector(map_T_camera[:3, 3])
            self.reach_m[sector] = max(float(self.reach_m[sector]), distance)
            self.reach_ns = stamp_ns + period_ns
        if self.looks:
            self.misses += self.missed
            self.looks = self.missed = self.look_missed = 0
            self.look_pose = None

    def not_detected(self, map_T_camera: Pose, stamp_ns: int, s: ChangeSettings) -> None:
        """A picture shows the place without a mask on it."""
        sector, distance = self.sector(map_T_camera[:3, 3])
        reach = max(float(self.reach_m[k % _SECTORS]) for k in (sector - 1, sector, sector + 1))
        if distance > _NEARER * reach:
            return
        period_ns = round(s.look_period_s * 1e9)
        if self.look_pose is None or (
            is_due(stamp_ns, self.look_ns + period_ns, period_ns) and _apart(self.look_pose, map_T_camera, s)
        ):
            self.look_pose, self.look_ns, self.look_missed = map_T_camera, stamp_ns, 0
            self.looks += 1
        if self.look_missed < _PER_LOOK:
            self.look_missed += 1
            self.missed += 1

    def missed_for_good(self, s: ChangeSettings) -> bool:
        """Whether so many misses in a row are unlikely for a thing as reliably detected as this one."""
        rate = min((self.hits + 1.0) / (self.hits + self.misses + 2.0), self.existence, 0.9)
        return self.looks >= s.looks and (1.0 - rate) ** self.missed <= s.chance


def _apart(one: Pose, two: Pose, s: ChangeSettings) -> bool:
    moved = float(np.linalg.norm(one[:3, 3] - two[:3, 3])) >= s.step_m
    return moved or float(one[:3, 2] @ two[:3, 2]) <= np.cos(s.turn_rad)


@dataclass(slots=True)
class ChangeWatch:
    """Counts good looks at the places of the published instances. The owner tells where they are, who was detected and who ended."""

    settings: ChangeSettings
    _places: dict[int, _Looked] = field(default_factory=dict)
    _due_ns: int = _NEVER

    def place(self, instance_id: int, points: Floats, existence: float = 1.0) -> None:
        """An instance is here: points float32 [n, 3]; existence: share of the pictures that should have seen it and did."""
        probes = probes_of(points)
        thick_m = _least_extent(probes.points)
        old = self._places.get(instance_id)
        if old is None:
            self._places[instance_id] = _Looked(probes, thick_m, probes.half(), existence)
        else:
            old.probes, old.thick_m, old.existence = probes, thick_m, existence

    def expect(self, instance_id: int, points: Floats) -> None:
        """A thing known from before is supposed to be here; how it is detected is not known."""
        self.place(instance_id, points)
        self._places[instance_id].reach_m[:] = _SUPPOSED_M

    def forget(self, instance_id: int) -> None:
        self._places.pop(instance_id, None)

    def home(self, instance_id: int) -> Floats:
        """Some of the points of a thing when the LiDAR last confirmed all of it."""
        return self._places[instance_id].home.points

    def rename(self, instance_id: int, new_id: int) -> None:
        if instance_id in self._places:
            self._places[new_id] = self._places.pop(instance_id)

    def picture(self, map_T_camera: Pose, stamp_ns: int, detected: Iterable[int], missed: Iterable[int]) -> None:
        """One picture: ids with a mask of their own meaning on them, and ids that it shows well without any."""
        for instance_id in detected:
            place = self._places.get(instance_id)
            if place is not None:
                place.detected(map_T_camera, stamp_ns, self.settings)
        for instance_id in missed:
            place = self._places.get(instance_id)
            if place is not None:
                place.not_detected(map_T_camera, stamp_ns, self.settings)

    def look(self, origin_map: NDArray[np.float64], points_map: Floats, stamp_ns: int) -> Verdict:
        """Who was found gone by now. points_map: float32 [N, 3], one scan from origin_map."""
        s = self.settings
        period_ns = round(s.look_period_s * 1e9)
        due = is_due(stamp_ns, self._due_ns, period_ns)
        if not s.enabled or not self._places or not len(points_map) or not due:
            return Verdict()
        self._due_ns = stamp_ns + period_ns
        ids = np.array(sorted(self._places))
        centres = np.stack([self._places[i].probes.centre for i in ids.tolist()])
        close = ids[np.linalg.norm(centres - origin_map, axis=1) < s.range_m].tolist()
        if not close:
            return Verdict()
        sight = Sight(
            np.asarray(origin_map, np.float64), *range_image(np.asarray(origin_map, np.float64), points_map), s.margin_m
        )
        gone, partly = [], []
        for instance_id in close:
            place = self._places[instance_id]
            seen = sight.of(place.probes.points)
            passed, decided = int((seen > 0).sum()), int((np.abs(seen) == 1).sum())
            if decided >= max(s.min_decided, _DECIDED * int((seen != 0).sum())):
                place.passed(passed / decided, s, stamp_ns - place.seen_ns <= _FRESH_NS)
            watched = stamp_ns - place.seen_ns <= round(s.looks * s.look_period_s * 1e9)
            if (
                (place.empty >= s.looks and not watched)
                or (place.partly >= s.looks and place.missed >= _PER_LOOK)
                or (not place.there and place.missed_for_good(s))
            ):
                gone.append(instance_id)
            elif place.partly >= s.looks and watched:
                place.partly = 0
                partly.append(instance_id)
        return Verdict(tuple(gone), tuple(partly), sight)


@kernel
def _least_extent(points: Floats) -> float:
    """Least of height and of the two extents in plan along their main directions (from variances, as if evenly filled)."""
    n = len(points)
    if n < 3:
        return 0.0
    x = y = xx = xy = yy = 0.0
    low, high = float(points[0, 2]), float(points[0, 2])
    for p in range(n):
        a, b = float(points[p, 0] - points[0, 0]), float(points[p, 1] - points[0, 1])
        x += a
        y += b
        xx += a * a
        xy += a * b
        yy += b * b
        low, high = min(low, float(points[p, 2])), max(high, float(points[p, 2]))
    xx, xy, yy = (xx - x * x / n) / (n - 1), (xy - x * y / n) / (n - 1), (yy - y * y / n) / (n - 1)
    spread = 0.5 * (xx + yy - np.sqrt((xx - yy) ** 2 + 4.0 * xy * xy))
    return float(min(np.sqrt(12.0 * max(spread, 0.0)), high - low))
