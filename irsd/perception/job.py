"""What goes to perception and what comes back: frozen, and complete in itself, so that a late result is lifted as a prompt one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from irsd.core.types import CameraView, Detections, KnownThings


@dataclass(frozen=True, slots=True)
class Sight:
    """The map as the picture's camera saw it: what is not hidden behind something nearer.

    pixel: float32 [M, 2] (u, v); depth_m: float32 [M] along the optical axis; of_point: int32 [M], row of ``KnownThings`` or -1;
    structural: bool [M], it is part of a wall, a floor or a ceiling; part: int32 [M], number of the part of the map that stands alone
    and in a thing's size, 0 none; None: not known.
    """

    pixel: NDArray[np.float32]
    depth_m: NDArray[np.float32]
    of_point: NDArray[np.int32]
    structural: NDArray[np.bool_]
    part: NDArray[np.int32] | None = None


@dataclass(frozen=True, slots=True)
class PerceptionJob:
    """One keyframe. view holds the picture, its camera and its pose.

    points_map: float32 [K, 3] and structure: uint8 [K], the map in view at the picture's time: what the result will be lifted with.
    floor_z_m: height of the floor near the robot.
    """

    seq: int
    view: CameraView
    points_map: NDArray[np.float32]
    structure: NDArray[np.uint8]
    sight: Sight
    known: KnownThings
    floor_z_m: float = 0.0


@dataclass(frozen=True, slots=True)
class PerceptionResult:
    """What was seen in a job's picture."""

    job: PerceptionJob
    detections: Detections
