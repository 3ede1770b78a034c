"""What is no longer where it was: rays of the LiDAR that pass through the place of an instance are evidence against it.

A scan becomes an image of ranges about the sensor. A point of an instance is passed through when what was measured in its direction
lies clearly behind it, confirmed when something lies about there, and undecided when the view is blocked or nothing was measured.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from irsd.core.jit import kernel
from irsd.core.settings import setting
from irsd.instances.voxels import Floats

_BIN_RAD = np.deg2rad(1.0)
_COLUMNS, _ROWS = 360, 180
_PROBES = 128  # points of an instance that are asked about
_NEVER = -(1 << 62)


@dataclass(frozen=True)
class ChangeSettings:
    """When a thing counts as carried away."""

    enabled: bool = setting(True, "let rays that pass through where a thing was speak against it")
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
    keep_s: float = setting(5.0, "how long a thing is still told of as gone before it ends", lo=0.0, hi=3600.0)


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
def judge(origin: NDArray[np.float64], near: Floats, far: Floats, probes: Floats, margin: float) -> tuple[int, int]:
    """(passed through, confirmed) of points [n, 3]. A point is passed only when all that was measured beside it lies behind, too."""
    passed = confirmed = 0
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
            passed += 1
        elif least <= distance + margin and most >= distance - margin and least >= distance - margin:
            confirmed += 1
    return passed, confirmed


@dataclass(slots=True)
class _Looked:
    """probes float32 [n, 3]; centre [3]; empty: good looks in a row that found the place empty."""

    probes: Floats
    centre: NDArray[np.float64]
    empty: int = 0
    last_ns: int = _NEVER


@dataclass(slots=True)
class ChangeWatch:
    """Counts good looks at the places of the published instances. The owner tells where they are and who ended."""

    settings: ChangeSettings
    _places: dict[int, _Looked] = field(default_factory=dict)
    _due_ns: int = _NEVER

    def place(self, instance_id: int, points: Floats) -> None:
        """An instance was seen here: points float32 [n, 3]. Being seen by a camera wipes out earlier doubt."""
        step = max(len(points) // _PROBES, 1)
        probes = np.ascontiguousarray(points[::step])
        old = self._places.get(instance_id)
        self._places[instance_id] = _Looked(probes, probes.mean(0, np.float64), 0, old.last_ns if old else _NEVER)

    def forget(self, instance_id: int) -> None:
        self._places.pop(instance_id, None)

    def look(self, origin_map: NDArray[np.float64], points_map: Floats, stamp_ns: int) -> list[int]:
        """Ids whose place was found empty often enough, ascending. points_map: float32 [N, 3], one scan from origin_map."""
        s = self.settings
        if not s.enabled or not self._places or not len(points_map) or stamp_ns < self._due_ns:
            return []
        self._due_ns = stamp_ns + round(s.look_period_s * 1e9)
        ids = list(self._places)
        centres = np.stack([self._places[i].centre for i in ids])
        close = np.flatnonzero(np.linalg.norm(centres - origin_map, axis=1) < s.range_m)
        if not len(close):
            return []
        near, far = range_image(np.asarray(origin_map, np.float64), points_map)
        gone = []
        for instance_id in sorted(ids[k] for k in close.tolist()):
            place = self._places[instance_id]
            passed, confirmed = judge(np.asarray(origin_map, np.float64), near, far, place.probes, s.margin_m)
            if passed + confirmed < s.min_decided:
                continue
            place.empty = place.empty + 1 if passed >= s.passed_share * (passed + confirmed) else 0
            if place.empty >= s.looks:
                gone.append(instance_id)
        return gone
