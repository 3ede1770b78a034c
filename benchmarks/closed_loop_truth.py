"""The judge of the closed loop: what of a building is out of the robot's sight, and what may be asked for there."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from irsd.graph.model import GraphSnapshot
from irsd.sim.building import Building, Thing
from irsd.sim.space import ROBOT_RADIUS_M
from nav_bridge.approach import in_polygon
from nav_bridge.route import CostMap, RouteSettings, plan_route

SURE_M = 0.45  # within a cell of the map's resolution, a refusal is as right as an arrival
CLEARANCE_M = 0.03  # what the robot's own steering keeps free round its body


@dataclass(frozen=True, slots=True)
class Goal:
    """What is asked for. accepted: ids of the true things that it may mean; best_m: how near one can get to any of them."""

    query: str
    accepted: tuple[int, ...]
    best_m: float

    @property
    def possible(self) -> bool:
        return self.best_m <= SURE_M


class Truth:
    """The judge: what of a building is out of the robot's sight."""

    def __init__(self, building: Building) -> None:
        self._building = building
        space = building.space
        free = space.clearance_m >= ROBOT_RADIUS_M
        clear = space.clearance_m.astype(np.float32)
        self._costs = CostMap(space.frame, ~free, clear, free, np.ones_like(clear), np.ones_like(free))
        labels, _ = ndimage.label(clear >= ROBOT_RADIUS_M + CLEARANCE_M)
        row, col = space.frame.cells_of(np.zeros((1, 2)))[0]
        self._standing = space.frame.centres_of(np.argwhere(labels == labels[row, col]))
        self._triangles = {
            t.id: building.triangles[building.thing == t.id][:, :, :2].astype(float) for t in building.things
        }

    def distance(self, thing: int, places_xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """[N] plan distance of places [N, 2] to a thing's surface."""
        corners = self._triangles[thing]
        best = np.full(len(places_xy), np.inf)
        for a, b, c in corners:
            inside = np.ones(len(places_xy), bool)
            turn = np.sign((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))
            for p, q in ((a, b), (b, c), (c, a)):
                span, offset = q - p, places_xy - p
                along = np.clip(offset @ span / max(float(span @ span), 1e-12), 0.0, 1.0)
                best = np.minimum(best, np.hypot(*(offset - along[:, None] * span).T))
                inside &= turn * (span[0] * offset[:, 1] - span[1] * offset[:, 0]) >= 0
            best[inside & (turn != 0)] = 0.0
        return best

    def goals(self, graph: Callable[[], GraphSnapshot], count: int, rng: np.random.Generator) -> Iterator[Goal]:
        """Random goals until ``count`` of them are possible. graph: says what irsd calls the rooms by now."""
        things = [thing for thing in self._building.things if not thing.structural and thing.room >= 0]
        for index in rng.permutation(len(things)):
            goal = self._goal(things[index], graph())
            count -= goal.possible
            yield goal
            if not count:
                return

    def _goal(self, thing: Thing, graph: GraphSnapshot) -> Goal:
        names = {thing.label, *thing.synonyms}
        alike = [t for t in self._building.things if t.room >= 0 and names & {t.label, *t.synonyms}]
        query = f"the {thing.label}"
        if len(alike) > 1:
            name, rooms = self._room_name(thing.room, graph)
            alike = [other for other in alike if other.room in rooms]
            query = f"{'any' if len(alike) > 1 else 'the'} {thing.label} in {name}"
        accepted = tuple(other.id for other in alike)
        return Goal(query, accepted, min(float(self.distance(t, self._standing).min()) for t in accepted))

    def _room_name(self, room: int, graph: GraphSnapshot) -> tuple[str, set[int]]:
        """What to call a true room, and the true rooms that this means."""
        rooms = self._building.rooms
        kind, middle = rooms[room].label, rooms[room].polygon_xy.mean(0)
        sure = {node.id for node in graph.rooms if node.label == kind}
        for node in graph.rooms:
            if in_polygon(middle[None], node.polygon_xy)[0]:
                alike = {k for k, other in enumerate(rooms) if other.label == kind}
                return (f"the {kind}", alike) if sure == {node.id} and len(alike) == 1 else (node.id, {room})
        return f"the {kind}", {room}

    def shortest_m(self, start_xy: NDArray[np.float64], end_xy: NDArray[np.float64]) -> float | None:
        """Any-angle way on the true map for the robot's body."""
        start, end = (*map(float, start_xy), 0.0), (*map(float, end_xy), 0.0)
        options = RouteSettings(robot_radius_m=ROBOT_RADIUS_M, clearance_m=0.0, comfort_m=0.0)
        ways = [plan_route(self._costs, a, b, options) for a, b in ((start, end), (end, start))]
        return min((way.length_m for way in ways if way is not None), default=None)
