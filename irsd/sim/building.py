"""The embedded building: shell and furniture compiled into one mesh with instance ids, and the ground truth of it.

The world's frame is where the robot starts: origin below it, x ahead. The odometry frame begins there too, so that ground
truth and a perfect map agree.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from irsd.core.grid import GridFrame
from irsd.sim.furnish import Placement, furnish, programme
from irsd.sim.layout import Shell, make_shell
from irsd.sim.parts import Part, moved
from irsd.sim.space import FreeSpace, Obstacles

_ATTEMPTS = 60
_ROBOT_HEIGHT_M = 1.1
STRUCTURAL = ("wall", "floor", "ceiling", "door", "window", "carpet")


@dataclass(frozen=True, slots=True)
class Thing:
    """An instance of the world: id (1..), names, room index (-1 = of the shell), corners of its axis-aligned box."""

    id: int
    label: str
    synonyms: tuple[str, ...]
    room: int
    aabb_min_m: NDArray[np.float64]
    aabb_max_m: NDArray[np.float64]

    @property
    def structural(self) -> bool:
        """True for what a detector rarely or never names: walls, floors, ceilings, doors, windows, carpets."""
        return self.label in STRUCTURAL


@dataclass(frozen=True, slots=True)
class RoomTruth:
    """A room: its kind and inner outline (x, y) [4, 2], counter-clockwise, world frame."""

    label: str
    polygon_xy: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class DoorTruth:
    """A way between two rooms (indices into ``Building.rooms``)."""

    rooms: tuple[int, int]
    position_xy: tuple[float, float]
    width_m: float


@dataclass(frozen=True, slots=True)
class Building:
    """Everything about the world that does not move.

    triangles: float32 [T, 3, 3] world frame; colour: uint8 [T, 3] RGB; thing: int32 [T] Thing.id of each triangle;
    shape_thing: int32 [S] that of each shape of the obstacles.
    """

    seed: int
    rooms: tuple[RoomTruth, ...]
    doors: tuple[DoorTruth, ...]
    things: tuple[Thing, ...]
    triangles: NDArray[np.float32]
    colour: NDArray[np.uint8]
    thing: NDArray[np.int32]
    obstacles: Obstacles
    shape_thing: NDArray[np.int32]
    space: FreeSpace


class Body(NamedTuple):
    """A thing's solid: triangles float32 [T, 3, 3], colour uint8 [T, 3], shapes float64 [S, 5] at the robot's height."""

    triangles: NDArray[np.float32]
    colour: NDArray[np.uint8]
    shapes: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class _Piece:
    """A thing before ids: parts with their pose in the building's frame."""

    label: str
    synonyms: tuple[str, ...]
    room: int
    parts: tuple[Part, ...]
    pose: tuple[float, float, float, float]  # x, y, z, yaw


def make_building(seed: int, *, yaw_rad: float = 0.0) -> Building:
    """The building of a seed. yaw_rad turns it about the robot's start (walls are then not parallel to the axes).

    The same seed gives the same building. Raises ValueError when no arrangement is found (not seen for any seed).
    """
    for attempt in range(_ATTEMPTS):
        rng = np.random.default_rng([seed, attempt])
        shell = make_shell(rng)
        pieces = _furnish_all(shell, rng)
        if pieces is None:
            continue
        building = _compile(seed, shell, pieces, yaw_rad)
        if building.space.all_connected([room.polygon_xy for room in building.rooms]):
            return building
    raise ValueError(f"no building could be made from seed {seed}")


def _furnish_all(shell: Shell, rng: np.random.Generator) -> list[_Piece] | None:
    """Shell and furniture as pieces; None when a required thing finds no place."""
    pieces = [_Piece(x.label, (), -1, x.parts, (0.0, 0.0, 0.0, 0.0)) for x in shell.fixtures]
    for index, room in enumerate(shell.rooms):
        space = shell.space(index)
        if room.kind == "corridor":  # the start must stay free
            start = _start_xy(shell)
            free = (start[0] - 0.6, start[1] - 0.6, start[0] + 0.6, start[1] + 0.6)
            space = type(space)(space.rect, (*space.keep_free, free), space.wall_taken, (*space.door_points, start))
        placements = furnish(space, programme(room.kind, rng), rng)
        if placements is None:
            return None
        pieces += [piece for placement in placements for piece in _items(placement, index)]
    return pieces


def _items(placement: Placement, room: int) -> list[_Piece]:
    """The items of a placed group, each with its pose in the building's frame."""
    found = []
    for item in placement.group.items:
        offset = np.array([item.x_m, item.y_m, item.z_m])
        x, y, z = (float(v) for v in moved(offset, placement.x_m, placement.y_m, 0.0, placement.yaw_rad))
        found.append(_Piece(item.label, item.synonyms, room, item.parts, (x, y, z, item.yaw_rad + placement.yaw_rad)))
    return found


def _start_xy(shell: Shell) -> tuple[float, float]:
    """Where the robot starts: in the corridor, a quarter of its length from the entrance."""
    x0, y0, x1, y1 = shell.rooms[-1].rect
    return x0 + (x1 - x0) * 0.25, (y0 + y1) / 2


def _compile(seed: int, shell: Shell, pieces: list[_Piece], yaw_rad: float) -> Building:
    """Triangles, ids, truth and free space in the world's frame."""
    start = np.array([*_start_xy(shell), 0.0])

    def to_world(points: NDArray[np.float64]) -> NDArray[np.float64]:
        return moved(points - start, 0.0, 0.0, 0.0, yaw_rad)

    bodies = [body_of(p.label, p.parts, _in_world(p.pose, start, yaw_rad)) for p in pieces]
    corners = [body.triangles.reshape(-1, 3).astype(np.float64) for body in bodies]
    things = [
        Thing(number, piece.label, piece.synonyms, piece.room, every.min(0), every.max(0))
        for number, (piece, every) in enumerate(zip(pieces, corners, strict=True), start=1)
    ]
    outlines = [_outline(room.rect) for room in shell.rooms]
    rooms = tuple(
        RoomTruth(room.kind, to_world(outline)[:, :2]) for room, outline in zip(shell.rooms, outlines, strict=True)
    )
    doors = tuple(
        DoorTruth(p.rooms, _xy(to_world(np.array([[p.x_m, p.y_m, 0.0]]))[0]), p.width_m) for p in shell.passages
    )
    number = np.arange(1, len(bodies) + 1, dtype=np.int32)
    obstacles = Obstacles(np.concatenate([body.shapes for body in bodies]))
    triangles = np.concatenate([body.triangles for body in bodies])
    return Building(
        seed,
        rooms,
        doors,
        tuple(things),
        triangles,
        np.concatenate([body.colour for body in bodies]),
        np.repeat(number, [len(body.triangles) for body in bodies]),
        obstacles,
        np.repeat(number, [len(body.shapes) for body in bodies]),
        FreeSpace(_grid_frame(triangles), obstacles),
    )


def body_of(label: str, parts: tuple[Part, ...], pose: tuple[float, float, float, float]) -> Body:
    """The solid of a thing at a pose (x, y, z, yaw)."""
    x, y, z, yaw = pose
    meshes = [moved(part.triangles(), x, y, z, yaw).astype(np.float32) for part in parts]
    colours = [np.tile(np.array(p.colour, np.uint8), (len(m), 1)) for p, m in zip(parts, meshes, strict=True)]
    shapes = []
    for part in parts:
        if part.hi[2] + z > 0.02 and part.lo[2] + z < _ROBOT_HEIGHT_M and label not in ("floor", "carpet"):
            lo, hi = np.array(part.lo), np.array(part.hi)
            at = moved((lo + hi) / 2, x, y, z, yaw)
            half = (hi - lo)[:2] / 2
            shapes.append((at[0], at[1], half[0], -1.0 if part.round else half[1], yaw))
    return Body(np.concatenate(meshes), np.concatenate(colours), np.array(shapes, np.float64).reshape(-1, 5))


def _in_world(
    pose: tuple[float, float, float, float], start: NDArray[np.float64], yaw_rad: float
) -> tuple[float, float, float, float]:
    """A pose (x, y, z, yaw) of the building's frame seen from where the robot starts."""
    x, y, z = moved(np.array(pose[:3]) - start, 0.0, 0.0, 0.0, yaw_rad).tolist()
    return x, y, z, pose[3] + yaw_rad


def _grid_frame(triangles: NDArray[np.float32], resolution_m: float = 0.05) -> GridFrame:
    lo, hi = triangles.reshape(-1, 3)[:, :2].min(0) - 0.2, triangles.reshape(-1, 3)[:, :2].max(0) + 0.2
    width, height = (int(v) for v in np.ceil((hi - lo) / resolution_m))
    return GridFrame((float(lo[0]), float(lo[1])), resolution_m, height, width)


def _outline(rect: tuple[float, float, float, float]) -> NDArray[np.float64]:
    x0, y0, x1, y1 = rect
    return np.array([[x0, y0, 0.0], [x1, y0, 0.0], [x1, y1, 0.0], [x0, y1, 0.0]])


def _xy(point: NDArray[np.float64]) -> tuple[float, float]:
    return float(point[0]), float(point[1])


def truth_document(building: Building) -> dict[str, Any]:
    """The ground truth as a JSON document: rooms, doors and instances in the world's frame (= map frame at the start)."""
    rooms = [
        {"id": k, "label": room.label, "polygon": room.polygon_xy.round(4).tolist()}
        for k, room in enumerate(building.rooms)
    ]
    doors = [
        {"rooms": list(door.rooms), "position": [round(v, 4) for v in door.position_xy], "width_m": door.width_m}
        for door in building.doors
    ]
    instances = [
        {
            "id": thing.id,
            "label": thing.label,
            "synonyms": list(thing.synonyms),
            "structural": thing.structural,
            "room": thing.room if thing.room >= 0 else None,
            "aabb_min": thing.aabb_min_m.round(4).tolist(),
            "aabb_max": thing.aabb_max_m.round(4).tolist(),
        }
        for thing in building.things
    ]
    return {
        "schema": "irs/sim/truth/1",
        "frame": "map",
        "seed": building.seed,
        "start_pose": [0.0, 0.0, 0.0],
        "rooms": rooms,
        "doors": doors,
        "instances": instances,
    }
