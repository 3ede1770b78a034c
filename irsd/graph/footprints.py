"""Between footprints, as the room stage makes them, and rooms as they are published."""

from __future__ import annotations

from collections.abc import Mapping

import cv2
import numpy as np

from irsd.core.types import Opening, RoomFootprint
from irsd.graph.model import DoorEdge, RoomNode
from irsd.graph.room_types import UNKNOWN

_FLOOR_SLACK_M = 0.3  # what lies on the floor may be measured a little below it


def bare_room(room: str, place: RoomFootprint) -> RoomNode:
    """A room's node without what is in it and what it is. room: its id."""
    x0, y0, x1, y1 = (float(v) for v in place.aabb_xy)
    return RoomNode(
        id=room,
        label=UNKNOWN,
        labels=(),
        polygon_xy=tuple((float(x), float(y)) for x, y in place.polygon_xy),
        aabb_xy=(x0, y0, x1, y1),
        area_m2=float(place.area_m2),
        floor_z_m=float(place.floor_z_m),
        ceiling_z_m=None if place.ceiling_z_m is None else float(place.ceiling_z_m),
        instances=(),
        doors=(),
        floor=place.floor,
    )


def footprint_of(room: RoomNode) -> RoomFootprint:
    """A published room as the room stage takes it up again."""
    polygon = np.array(room.polygon_xy, np.float64).reshape(-1, 2)
    return RoomFootprint(polygon, room.aabb_xy, room.area_m2, room.floor_z_m, room.ceiling_z_m, room.floor)


def opening_of(door: DoorEdge) -> Opening:
    """A published door as the room stage takes it up again; its direction is not stored, so both ends lie in its middle."""
    low, high = (int(room[1:]) for room in door.rooms)
    ends = np.array([door.position_xy, door.position_xy], np.float64)
    return Opening((low, high), door.position_xy, door.width_m, ends, door.traversed)


def same_footprint(one: RoomFootprint, two: RoomFootprint) -> bool:
    """Whether two footprints say the same."""
    if one is two:
        return True
    rest = [(f.aabb_xy, f.area_m2, f.floor_z_m, f.ceiling_z_m, f.floor) for f in (one, two)]
    return rest[0] == rest[1] and np.array_equal(one.polygon_xy, two.polygon_xy)


def room_over(footprints: Mapping[str, RoomFootprint], point_m: tuple[float, float, float]) -> str | None:
    """The room whose outline holds a point, on the highest floor not above it; None when there is none. By id of the room."""
    x, y, z = point_m
    found = [
        (place.floor_z_m, room)
        for room, place in footprints.items()
        if place.floor_z_m <= z + _FLOOR_SLACK_M
        and len(place.polygon_xy) >= 3
        and cv2.pointPolygonTest(place.polygon_xy.astype(np.float32), (x, y), False) >= 0
    ]
    return max(found)[1] if found else None
