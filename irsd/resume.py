"""Taking up a stored map: are the first scans of the place that is stored, in its frame? Until that is clear, nothing is merged.

Compared is the plan: walls above furniture, and free space. Walls seen now must lie on stored walls, and what is free now must not.
"""

from __future__ import annotations

import logging
import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from irsd.core.errors import DecodeError
from irsd.core.geometry import Pose
from irsd.core.grid import GridFrame
from irsd.core.runtime import Cell
from irsd.core.types import PlanEvidence, SyncedFrame
from irsd.mapping.localise import moved
from irsd.mapping.mapper import Mapper, MappingSettings

_log = logging.getLogger(__name__)

CORRECTION = "map_T_odom"  # geometry of this name: where odometry's frame lay in the map
PLAN = "plan/"  # geometry of this name: the plan of a floor
_HEADER = struct.Struct("<4sddddII")
_MAGIC = b"IRP1"
_MAX_CELLS = 1 << 28
_LOOKS = 5  # sweeps before the first verdict
_AGAIN_EVERY, _LAST_LOOK = 10, 300  # sweeps between the later ones, and after which it is left to the operator
_NEAR_M = 0.1  # a wall this near to a stored one is that wall
_SHARED_M2 = 4.0  # of known floor that must be common to tell anything
_WALLS, _BLOCKED = 0.7, 0.1  # least share of walls on walls, most of free floor on walls


@dataclass(frozen=True, slots=True)
class Plan:
    """A floor from above: wall and free, bool [H, W] on ``frame``."""

    frame: GridFrame
    floor_z_m: float
    wall: NDArray[np.bool_]
    free: NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Agreement:
    """How a plan fits a stored one. shared_m2: known in both. walls: share of its walls on stored ones; blocked: of its free floor."""

    shared_m2: float
    walls: float
    blocked: float

    @property
    def enough(self) -> bool:
        """Whether it tells anything."""
        return self.shared_m2 >= _SHARED_M2

    @property
    def good(self) -> bool:
        """Whether it is the same place in the same frame."""
        return self.enough and self.walls >= _WALLS and self.blocked <= _BLOCKED


def plan_of(evidence: PlanEvidence) -> Plan:
    """The part of a map's evidence that is compared."""
    return Plan(evidence.frame, evidence.floor_z_m, evidence.wall, evidence.free)


def plan_to_bytes(plan: Plan) -> bytes:
    """A few kilobytes per floor."""
    x, y = plan.frame.origin_xy_m
    head = _HEADER.pack(_MAGIC, x, y, plan.frame.resolution_m, plan.floor_z_m, plan.frame.height, plan.frame.width)
    return head + zlib.compress(np.packbits(np.stack([plan.wall, plan.free])).tobytes(), 1)


def plan_from_bytes(payload: bytes) -> Plan:
    """Inverse of ``plan_to_bytes``. DecodeError for anything else."""
    if len(payload) < _HEADER.size:
        raise DecodeError(f"a plan has at least {_HEADER.size} bytes")
    magic, x, y, resolution_m, floor_z_m, height, width = _HEADER.unpack_from(payload)
    cells = height * width
    if magic != _MAGIC or not 0 < cells <= _MAX_CELLS or not resolution_m > 0:
        raise DecodeError("this is no plan of a floor")
    size = -(-2 * cells // 8)
    reader = zlib.decompressobj()
    try:
        packed = reader.decompress(payload[_HEADER.size :], size + 1)
    except zlib.error as error:
        raise DecodeError(f"a plan of a floor is damaged: {error}") from error
    if len(packed) != size or not reader.eof:
        raise DecodeError("a plan of a floor is cut off")
    bits = np.unpackbits(np.frombuffer(packed, np.uint8), count=2 * cells).astype(np.bool_).reshape(2, height, width)
    return Plan(GridFrame((x, y), resolution_m, height, width), floor_z_m, bits[0], bits[1])


def pose_to_bytes(pose: Pose) -> bytes:
    """A pose as 16 little-endian float64."""
    return np.ascontiguousarray(pose, "<f8").tobytes()


def pose_from_bytes(payload: bytes) -> Pose:
    """Inverse of ``pose_to_bytes``. DecodeError for anything else."""
    if len(payload) != 128:
        raise DecodeError("a pose has 128 bytes")
    pose = np.frombuffer(payload, "<f8").reshape(4, 4).astype(np.float64)
    if not np.isfinite(pose).all():
        raise DecodeError("a pose is not finite")
    return pose


def compare(now: Plan, stored: Plan) -> Agreement:
    """How a plan fits a stored one, both in one frame, as far as both reach."""
    wall, free = (_on(layer, now.frame, stored.frame) for layer in (now.wall, now.free))
    cells = 2 * round(_NEAR_M / stored.frame.resolution_m) + 1
    kernel = np.ones((cells, cells), np.uint8)
    near = cv2.dilate(stored.wall.astype(np.uint8), kernel) > 0
    known = cv2.dilate((stored.wall | stored.free).astype(np.uint8), kernel) > 0
    walls, floor = wall & known, free & (stored.free | stored.wall)
    shared_m2 = float(floor.sum()) * stored.frame.resolution_m**2
    on_walls = float((walls & near).sum()) / max(float(walls.sum()), 1.0)
    return Agreement(shared_m2, on_walls, float((floor & stored.wall).sum()) / max(float(floor.sum()), 1.0))


def _on(layer: NDArray[np.bool_], old: GridFrame, new: GridFrame) -> NDArray[np.bool_]:
    """A layer of one grid on another, cell by cell; what falls outside is lost."""
    rows, columns = np.nonzero(layer)
    cells = new.cells_of(old.centres_of(np.stack([rows, columns], 1)))
    inside = ((cells >= 0) & (cells < [new.height, new.width])).all(1)
    out = np.zeros((new.height, new.width), np.bool_)
    out[cells[inside, 0], cells[inside, 1]] = True
    return out


class Resumption:
    """Keeps frames from a stored map until they are known to be of it. ``admit`` belongs to the map thread, ``problem`` to all.

    Odometry may go on where it was, with the drift that was found in it, or begin anew where the map began: whichever fits.
    """

    def __init__(self, settings: MappingSettings, geometry: Mapping[str, bytes]) -> None:
        """geometry: of the stored map; without a plan in it there is nothing to compare, and every frame is admitted."""
        self._settings = settings
        self._problem = Cell("")
        self.held = 0
        self.begin(geometry)

    def begin(self, geometry: Mapping[str, bytes]) -> None:
        """The check anew, against another map."""
        self._stored = [plan_from_bytes(value) for name, value in geometry.items() if name.startswith(PLAN)]
        starts = [pose_from_bytes(geometry[CORRECTION])] if CORRECTION in geometry else []
        if not starts or not np.allclose(starts[0], np.eye(4), atol=1e-3):
            starts.append(np.eye(4))
        self._trials = [(start, Mapper(self._settings, None)) for start in starts] if self._stored else []
        self._start: Pose | None = None
        self._waiting: list[SyncedFrame] = []
        self._looks = 0
        self._problem.set("")

    def accept(self) -> None:
        """The operator says that it is the place, in the stored frame."""
        if self._trials:
            self._start = self._trials[0][0]
        self._trials, self._waiting = [], []
        self._problem.set("")

    @property
    def trusted(self) -> bool:
        """Whether frames go into the map."""
        return not self._trials

    @property
    def problem(self) -> str:
        """Why frames are held back; empty while they are not, or while it is not known yet."""
        return self._problem.get()

    def take_start(self) -> Pose | None:
        """map_T_odom that the next admitted frames begin with; told once, when it has been found out."""
        start, self._start = self._start, None
        return start

    def admit(self, frame: SyncedFrame) -> list[SyncedFrame]:
        """The frames that may go into the map now, in order."""
        if not self._trials:
            return [frame]
        self._looks += 1
        if self._looks <= _LAST_LOOK:
            for start, scratch in self._trials:
                scratch.integrate(moved(frame, start))
        if self._looks <= _LOOKS:
            self._waiting.append(frame)
        due = self._looks == _LOOKS or (self._looks > _LOOKS and self._looks % _AGAIN_EVERY == 0)
        if due and self._looks <= _LAST_LOOK:
            found, start = max((self._judged(each) for each in self._trials), key=lambda pair: pair[0].walls)
            if found.good:
                _log.info("this is the stored map: %.0f %% of the walls fit", 100 * found.walls)
                ready = self._waiting if self._looks == _LOOKS else [frame]
                self._trials, self._waiting, self._start = [], [], start
                self._problem.set("")
                return ready
            self._waiting = []
            self._tell(found)
        self.held += self._looks > _LOOKS
        return []

    def _judged(self, trial: tuple[Pose, Mapper]) -> tuple[Agreement, Pose]:
        start, scratch = trial
        now = plan_of(scratch.plan_evidence())
        return compare(now, min(self._stored, key=lambda plan: abs(plan.floor_z_m - now.floor_z_m))), start

    def _tell(self, found: Agreement) -> None:
        if found.enough:
            text = (
                f"the scans do not fit the stored map ({100 * found.walls:.0f} % of the walls lie on its walls, "
                f"{100 * found.blocked:.0f} % of the free floor too)"
            )
        else:
            text = f"the scans are of no part of the stored map ({found.shared_m2:.1f} m2 in common)"
        if not self._problem.get():
            _log.warning("%s: nothing is merged until it fits or irsctl relocalise decides", text)
        self._problem.set(text)
