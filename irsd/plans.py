"""The plan of a floor, as it is kept on disk and compared: walls above furniture, and free space.

Walls seen now must lie on stored walls, and what is free now must not.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from irsd.core.errors import DecodeError
from irsd.core.geometry import Pose, transform
from irsd.core.grid import GridFrame
from irsd.core.types import Plan, PlanEvidence

CORRECTION = "map_T_odom"  # geometry of this name: where odometry's frame lay in the map
PLAN = "plan/"  # geometry of this name: the plan of a floor
_HEADER = struct.Struct("<4sddddII")
_MAGIC = b"IRP1"
_MAX_CELLS = 1 << 28
_NEAR_M = 0.1  # a wall this near to a stored one is that wall
SHARED_M2 = 4.0  # of known floor that must be common to tell anything
_WALLS, _BLOCKED = 0.7, 0.1  # least share of walls on walls, most of free floor on walls


@dataclass(frozen=True, slots=True)
class Agreement:
    """How a plan fits a stored one. shared_m2: known in both. walls: share of its walls on stored ones; blocked: of its free floor."""

    shared_m2: float
    walls: float
    blocked: float

    @property
    def enough(self) -> bool:
        """Whether it tells anything."""
        return self.shared_m2 >= SHARED_M2

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


def compare(now: Plan, stored: Plan, stored_T_now: Pose | None = None) -> Agreement:
    """How a plan fits a stored one, as far as both reach. stored_T_now: where its frame lies in the other's; None: the same."""
    wall, free = (_on(layer, now.frame, stored.frame, stored_T_now) for layer in (now.wall, now.free))
    cells = 2 * round(_NEAR_M / stored.frame.resolution_m) + 1
    kernel = np.ones((cells, cells), np.uint8)
    near = cv2.dilate(stored.wall.astype(np.uint8), kernel) > 0
    known = cv2.dilate((stored.wall | stored.free).astype(np.uint8), kernel) > 0
    walls, floor = wall & known, free & (stored.free | stored.wall)
    shared_m2 = float(floor.sum()) * stored.frame.resolution_m**2
    on_walls = float((walls & near).sum()) / max(float(walls.sum()), 1.0)
    return Agreement(shared_m2, on_walls, float((floor & stored.wall).sum()) / max(float(floor.sum()), 1.0))


def _on(layer: NDArray[np.bool_], old: GridFrame, new: GridFrame, new_T_old: Pose | None) -> NDArray[np.bool_]:
    """A layer of one grid on another, cell by cell; what falls outside is lost."""
    points = np.c_[old.centres_of(np.argwhere(layer)), np.zeros(int(layer.sum()))]
    cells = new.cells_of((points if new_T_old is None else transform(new_T_old, points))[:, :2])
    inside = ((cells >= 0) & (cells < [new.height, new.width])).all(1)
    out = np.zeros((new.height, new.width), np.bool_)
    out[cells[inside, 0], cells[inside, 1]] = True
    return out
