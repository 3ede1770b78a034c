"""The values that cross stage boundaries: frozen, named, with frames and units. Depends on numpy only.

Arrays inside are handed over, not shared: whoever makes a value never writes to its arrays again.
Stamps are int nanoseconds of the sensor clock. Frames are REP-105: ``map``, ``odom``, ``base_link``, sensor frames.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from irsd.core.geometry import Pose
from irsd.core.grid import GridFrame


class Structure(IntEnum):
    """What a voxel is part of. The values are those written to disk and to the wire."""

    OTHER = 0
    WALL = 1
    FLOOR = 2
    CEILING = 3
    DOOR = 4
    WINDOW = 5


# --------------------------------------------------------------------------------------- decoded sensor messages
@dataclass(frozen=True, slots=True)
class LidarScan:
    """One sweep as measured, each point seen from the sensor's pose at its own instant.

    points_sensor: float32 [N, 3] metres, finite, sensor frame. time_offset_s: float32 [N], seconds after ``stamp_ns``
    (may be negative or unsorted), or None when the sensor gives no time per point.
    """

    stamp_ns: int
    frame_id: str
    points_sensor: NDArray[np.float32]
    time_offset_s: NDArray[np.float32] | None


@dataclass(frozen=True, slots=True)
class CameraImage:
    """A decoded picture: bgr uint8 [H, W, 3]."""

    stamp_ns: int
    frame_id: str
    bgr: NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class CameraModel:
    """Pinhole camera with OpenCV distortion. matrix: float64 [3, 3] pixels; distortion: float64 [K], K in 0, 4, 5, 8, 12, 14.

    model: ``plumb_bob``, ``rational_polynomial`` or ``equidistant`` (fisheye). frame_id: the optical frame (z ahead, x right).
    """

    frame_id: str
    width_px: int
    height_px: int
    matrix: NDArray[np.float64]
    model: str
    distortion: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class OdomSample:
    """Pose of the robot: position [3] metres, quat_xyzw [4], of ``child_frame_id`` (base_link) in ``frame_id`` (odom)."""

    stamp_ns: int
    frame_id: str
    child_frame_id: str
    position_m: NDArray[np.float64]
    quat_xyzw: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class StaticTransform:
    """A fixed mounting: parent_T_child 4x4 float64."""

    parent: str
    child: str
    parent_T_child: Pose


@dataclass(frozen=True, slots=True)
class Detections:
    """What some perception saw in one picture, as a struct of arrays; zero detections is a normal value.

    ids_px: uint16 [H, W], 0 = nothing, else the number of the detection that owns the pixel (numbers mean nothing across frames).
    number: int32 [n], the values that occur in ids_px. score: float32 [n] in 0..1. label: n names.
    top_labels: per detection, (name, score) best first, at least one. embedding: float32 [n, D], unit length, or None.
    measured: bool [n], False where the embedding is what is known of the thing already, not seen in this picture; None: all are.
    unsure_px: bool [H, W], True where something was found and not looked into, so that nothing follows from it; None: nowhere.
    """

    stamp_ns: int
    frame_id: str
    ids_px: NDArray[np.uint16]
    number: NDArray[np.int32]
    score: NDArray[np.float32]
    label: tuple[str, ...]
    top_labels: tuple[tuple[tuple[str, float], ...], ...]
    embedding: NDArray[np.float32] | None
    measured: NDArray[np.bool_] | None = None
    unsure_px: NDArray[np.bool_] | None = None


Sensed = LidarScan | CameraImage | CameraModel | OdomSample | StaticTransform | Detections


# --------------------------------------------------------------------------------------- after synchronisation
@dataclass(frozen=True, slots=True)
class DeskewedScan:
    """One sweep in the map frame, motion removed: points_map float32 [N, 3]; origin_map [3] float64, the sensor's mean position."""

    stamp_ns: int
    points_map: NDArray[np.float32]
    origin_map: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class CameraView:
    """A picture's content and where it was taken. map_T_camera: optical frame, at the picture's stamp."""

    stamp_ns: int
    map_T_camera: Pose
    camera: CameraModel
    detections: Detections | None
    image: CameraImage | None


@dataclass(frozen=True, slots=True)
class SyncedFrame:
    """What the pipeline eats: one deskewed scan and the camera views since the scan before it, oldest first.

    As it leaves the synchroniser its ``map`` is the odometry's frame, named odom_frame; the localiser lays it in the map.
    """

    seq: int
    stamp_ns: int
    map_T_base: Pose
    scan: DeskewedScan
    views: tuple[CameraView, ...]
    odom_frame: str = "odom"


@dataclass(frozen=True, slots=True)
class Localisation:
    """Where a sweep has put the robot, and with it the odometry's frame (named odom_frame), in the map.

    map_T_odom is upright: a shift and a turn about z. state: map (the sweep was laid on the map), odometry (it could not be), or
    off (the odometry is taken as it is).
    """

    stamp_ns: int
    odom_frame: str
    map_T_odom: Pose
    map_T_base: Pose
    state: str


# --------------------------------------------------------------------------------------- mapping
@dataclass(frozen=True, slots=True)
class MapBlock:
    """Voxels of the map and what geometry knows of each; one frame for all, z up, metres.

    points float32 [N, 3]; normals float32 [N, 3], unit, towards where they were seen from, zero = not known; surface float32
    [N, 3], centroid of the patch around; levels float32 [N, 4]: height of floor and ceiling there (inf: not known), how far point
    and patch lie in front of the nearest wall line that faces as the patch does (NaN: none near); geometry uint8 [N],
    ``Structure`` by geometry alone.
    """

    points: NDArray[np.float32]
    normals: NDArray[np.float32]
    surface: NDArray[np.float32]
    levels: NDArray[np.float32]
    geometry: NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class MapUpdate:
    """What one scan changed. rows: int32 [M], the voxel rows that were touched (see ``mapping.voxels.VoxelMap``).

    floor_z_m / ceiling_z_m: heights near the robot now (ceiling None until seen).
    changed_xy_m: (xmin, ymin, xmax, ymax) of the plan cells whose evidence changed, None when nothing did.
    """

    seq: int
    stamp_ns: int
    rows: NDArray[np.int32]
    floor_z_m: float
    ceiling_z_m: float | None
    changed_xy_m: tuple[float, float, float, float] | None


@dataclass(frozen=True, slots=True)
class LooseChange:
    """Parts of the map that are no structure and hang together, where something about them changed.

    rows: int32 [N] voxel rows, those of part k at offset[k]:offset[k + 1] (int64 [K + 1]); points_map: float32 [N, 3] of them; gone:
    int32 [G], rows that belong to no part any more.
    """

    rows: NDArray[np.int32]
    points_map: NDArray[np.float32]
    offset: NDArray[np.int64]
    gone: NDArray[np.int32]


@dataclass(frozen=True, slots=True)
class PlanEvidence:
    """The map seen from above, the input of room segmentation: per plan cell, what stands and what is open above furniture.

    wall: bool [H, W], structure stands here above furniture height. free: bool [H, W], rays passed or the floor/ceiling was
    seen here and nothing stands above furniture height. low: bool [H, W], something stands here at robot height.
    known: bool [H, W], anything was seen. All on ``frame``. lintel: bool [H, W] or None, structure stands here between the height of
    doors and the ceiling (a lintel, a step of the ceiling, the upper part of a wall). floor: index of the building's floor.
    """

    frame: GridFrame
    wall: NDArray[np.bool_]
    free: NDArray[np.bool_]
    low: NDArray[np.bool_]
    known: NDArray[np.bool_]
    floor_z_m: float
    ceiling_z_m: float | None
    lintel: NDArray[np.bool_] | None = None
    floor: int = 0


@dataclass(frozen=True, slots=True)
class Plan:
    """A floor from above, as it is kept and compared: structure above furniture and free space, bool [H, W] on ``frame``."""

    frame: GridFrame
    floor_z_m: float
    wall: NDArray[np.bool_]
    free: NDArray[np.bool_]


# --------------------------------------------------------------------------------------- rooms
@dataclass(frozen=True, slots=True)
class RoomFootprint:
    """One room's place: polygon_xy float64 [K, 2] metres counter-clockwise, not closed; aabb_xy (xmin, ymin, xmax, ymax).

    floor: index of the building's floor that the room is on, in the order in which floors were found.
    """

    polygon_xy: NDArray[np.float64]
    aabb_xy: tuple[float, float, float, float]
    area_m2: float
    floor_z_m: float
    ceiling_z_m: float | None
    floor: int = 0


@dataclass(frozen=True, slots=True)
class Opening:
    """Where one can pass between two rooms: rooms are indices (in a segmentation) of the two sides; segment_xy float64 [2, 2].

    traversed: the robot went through itself, it was not just seen.
    """

    rooms: tuple[int, int]
    position_xy: tuple[float, float]
    width_m: float
    segment_xy: NDArray[np.float64]
    traversed: bool = False


@dataclass(frozen=True, slots=True)
class RoomSegmentation:
    """Rooms of one instant, without identity. labels: int32 [H, W], 0 = none, k = rooms[k - 1]. Opening.rooms hold k values."""

    frame: GridFrame
    labels: NDArray[np.int32]
    rooms: tuple[RoomFootprint, ...]
    openings: tuple[Opening, ...]


@dataclass(frozen=True, slots=True)
class Rooms:
    """Rooms with stable ids. ids: int per room, parallel to ``footprints``, of all floors; labels: int32 [H, W] of ids (0 = none) on
    the floor where the robot is.

    openings: Opening.rooms hold room ids. lineage: lines such as ``R4 split into R4, R9`` of this update.
    """

    frame: GridFrame
    labels: NDArray[np.int32]
    ids: tuple[int, ...]
    footprints: tuple[RoomFootprint, ...]
    openings: tuple[Opening, ...]
    lineage: tuple[str, ...]


# --------------------------------------------------------------------------------------- instances
@dataclass(frozen=True, slots=True)
class InstanceState:
    """All that fusion knows of one instance at one instant.

    points_map: float32 [N, 3]; embedding: float32 [D] unit length or None; labels: (name, score) best first, scores sum to <= 1.
    room: id of the room that holds it, 0 = none. observations: pictures that saw it, 0 for what only the LiDAR saw. existence: 0..1.
    state: present | moved (it stands elsewhere than where it was first found) | gone (its place was found empty; it ends soon).
    score_kind: what the scores of labels are: votes (shares of what a detector said) | chances (of irsd's own eyes).
    """

    id: int
    points_map: NDArray[np.float32]
    embedding: NDArray[np.float32] | None
    labels: tuple[tuple[str, float], ...]
    room: int
    observations: int
    existence: float
    first_seen_ns: int
    last_seen_ns: int
    state: str = "present"
    score_kind: str = "votes"


@dataclass(frozen=True, slots=True)
class KnownThings:
    """The instances that own some of K map points, as perception needs them to see only what is new.

    of_point: int32 [K], row of the point's owner, -1 = nobody's. id: int64 [k]. embedding: float32 [k, D], unit length, zero where
    there is none of that D. looks: int32 [k], pictures whose embedding is in it. observations: int32 [k]. last_seen_ns: int64 [k].
    """

    of_point: NDArray[np.int32]
    id: NDArray[np.int64]
    embedding: NDArray[np.float32]
    looks: NDArray[np.int32]
    observations: NDArray[np.int32]
    last_seen_ns: NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class InstanceUpdate:
    """What changed in the instance memory: states that are new or changed, ids that ended, (kept, absorbed) merges."""

    stamp_ns: int
    changed: tuple[InstanceState, ...]
    ended: tuple[int, ...]
    merged: tuple[tuple[int, int], ...]


@dataclass(frozen=True, slots=True)
class Prototype:
    """What an operator taught: a name and what the thing looked like, an example by which the next one can be recognised.

    points_m: float32 [N, 3], N <= 512: x, y about the middle of the thing in plan (the map's axes), z above the floor.
    embedding: float32 [D], unit length, of the encoder of its time, or None.
    """

    name: str
    points_m: NDArray[np.float32]
    embedding: NDArray[np.float32] | None
