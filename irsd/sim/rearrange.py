"""Things carried away, brought and moved: a building with one thing more, less, or elsewhere. Ids are never used twice."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from irsd.sim import furniture
from irsd.sim.building import Body, Building, Thing, body_of
from irsd.sim.parts import Item, moved
from irsd.sim.space import ROBOT_RADIUS_M, FreeSpace, Obstacles, inside_polygon

Maker = Callable[[np.random.Generator], Item]


def _picture(rng: np.random.Generator) -> Item:
    colours = (furniture.pick(rng, furniture.WOODS), furniture.pick(rng, furniture.FABRICS))
    return furniture.flat_on_wall("picture", ("painting", "framed picture"), 0.7, 0.5, colours)


# What can be brought by name.
CATALOGUE: Mapping[str, Maker] = {
    "box": furniture.cardboard_box,
    "chair": furniture.chair,
    "lamp": furniture.floor_lamp,
    "microwave": furniture.microwave,
    "office chair": furniture.office_chair,
    "picture": _picture,
    "plant": furniture.plant,
    "printer": furniture.printer,
    "stool": furniture.stool,
    "trash can": furniture.trash_can,
}


def without(building: Building, thing_id: int) -> Building:
    """The building after a thing was carried away. Raises ValueError for what is not there or is part of the shell."""
    thing_of(building, thing_id)
    stays, stand = building.thing != thing_id, building.shape_thing != thing_id
    obstacles = Obstacles(building.obstacles.shapes[stand])
    return replace(
        building,
        things=tuple(thing for thing in building.things if thing.id != thing_id),
        triangles=building.triangles[stays],
        colour=building.colour[stays],
        thing=building.thing[stays],
        obstacles=obstacles,
        shape_thing=building.shape_thing[stand],
        space=FreeSpace(building.space.frame, obstacles),
    )


def with_thing(building: Building, thing: Thing, body: Body, robot_xy: NDArray[np.float64]) -> Building:
    """The building after a thing was put down. Raises ValueError where the robot stands in the way."""
    own = Obstacles(body.shapes)
    if len(body.shapes) and float(own.distance(robot_xy[None])[0]) < ROBOT_RADIUS_M:
        raise ValueError(f"the robot stands where the {thing.label} shall go")
    obstacles = Obstacles(np.concatenate([building.obstacles.shapes, body.shapes]))
    return replace(
        building,
        things=(*building.things, thing),
        triangles=np.concatenate([building.triangles, body.triangles]),
        colour=np.concatenate([building.colour, body.colour]),
        thing=np.concatenate([building.thing, np.full(len(body.triangles), thing.id, np.int32)]),
        obstacles=obstacles,
        shape_thing=np.concatenate([building.shape_thing, np.full(len(body.shapes), thing.id, np.int32)]),
        space=FreeSpace(building.space.frame, obstacles),
    )


def thing_of(building: Building, thing_id: int) -> Thing:
    """The movable thing with an id. Raises ValueError for what is not there or is part of the shell."""
    for thing in building.things:
        if thing.id == thing_id and not thing.structural:
            return thing
    raise ValueError(f"no thing {thing_id} that could be carried")


def made(building: Building, thing_id: int, item: Item, pose: tuple[float, float, float, float]) -> tuple[Thing, Body]:
    """A new thing at a pose (x, y, z, yaw) of the world and its solid."""
    body = body_of(item.label, item.parts, pose)
    return _thing(building, thing_id, item.label, item.synonyms, body), body


def shifted(building: Building, thing_id: int, to_m: tuple[float, float, float], turn_rad: float) -> tuple[Thing, Body]:
    """A thing of the building and its solid, its middle (in plan) and lowest point brought to to_m, turned about its middle."""
    thing = thing_of(building, thing_id)
    middle = (thing.aabb_min_m + thing.aabb_max_m) / 2
    base = np.array([middle[0], middle[1], thing.aabb_min_m[2]])
    mine, shape = building.thing == thing_id, building.shape_thing == thing_id
    triangles = moved(building.triangles[mine].astype(np.float64) - base, *to_m, turn_rad).astype(np.float32)
    shapes = building.obstacles.shapes[shape].copy()
    shapes[:, :2] = moved(np.column_stack([shapes[:, :2] - base[:2], np.zeros(len(shapes))]), *to_m, turn_rad)[:, :2]
    shapes[:, 4] += turn_rad
    body = Body(triangles, building.colour[mine], shapes)
    return _thing(building, thing_id, thing.label, thing.synonyms, body), body


def _thing(building: Building, thing_id: int, label: str, synonyms: tuple[str, ...], body: Body) -> Thing:
    corners = body.triangles.reshape(-1, 3).astype(np.float64)
    low, high = corners.min(0), corners.max(0)
    x, y = ((low + high) / 2)[:2].tolist()
    inside = [k for k, room in enumerate(building.rooms) if inside_polygon(np.array([[x, y]]), room.polygon_xy)[0]]
    return Thing(thing_id, label, synonyms, inside[0] if inside else -1, low, high)


@dataclass(frozen=True, slots=True)
class Walk:
    """Somebody walking along path_xy [K, 2] from start_ns on, and out of sight at its end. body: about the origin."""

    thing: Thing
    body: Body
    path_xy: NDArray[np.float64]
    speed_m_s: float
    start_ns: int

    def place(self, now_ns: int) -> NDArray[np.float64] | None:
        """[2] where they are now, None once they have left."""
        steps = np.linalg.norm(np.diff(self.path_xy, axis=0), axis=1)
        along = np.concatenate([[0.0], np.cumsum(steps)])
        at = (now_ns - self.start_ns) * 1e-9 * self.speed_m_s
        if at > along[-1]:
            return None
        return np.array([np.interp(at, along, self.path_xy[:, k]) for k in range(2)])
