"""Doors keep their numbers: the same opening, seen again, is the same door."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from irsd.core.types import Opening
from irsd.graph.model import DoorEdge

_OTHER_ROOMS_M = 0.5  # a door whose rooms were renumbered must lie this much nearer to be taken for the same


class DoorRegister:
    """Every door ever seen, so that one that vanishes for a while comes back under its number. Numbers are never used twice."""

    def __init__(self, match_m: float) -> None:
        self._match_m = match_m
        self._known: dict[int, DoorEdge] = {}
        self._square: dict[tuple[int, int], set[int]] = {}  # numbers of the doors in each square of the plan

    def restore(self, doors: Sequence[DoorEdge]) -> None:
        """Doors of a stored map."""
        for door in doors:
            self._keep(int(door.id[1:]), door)

    def _keep(self, number: int, door: DoorEdge) -> None:
        before = self._known.get(number)
        if before is not None:
            self._square[self._square_of(before)].discard(number)
        self._known[number] = door
        self._square.setdefault(self._square_of(door), set()).add(number)

    def _square_of(self, door: DoorEdge) -> tuple[int, int]:
        edge_m = max(self._match_m, 0.1)
        return math.floor(door.position_xy[0] / edge_m), math.floor(door.position_xy[1] / edge_m)

    def _near(self, door: DoorEdge) -> list[int]:
        """Numbers of the known doors that may lie within ``match_m``."""
        x, y = self._square_of(door)
        squares = [(x + dx, y + dy) for dx in (-1, 0, 1) for dy in (-1, 0, 1)]
        return [number for square in squares for number in self._square.get(square, ())]

    def match(self, openings: Sequence[Opening]) -> tuple[DoorEdge, ...]:
        """The doors that these openings are, by number. Nearest pairs are matched first; what matches none is a new door."""
        made = [_edge(opening) for opening in openings]
        pairs = sorted(
            (cost, number, k)
            for k, door in enumerate(made)
            for number in self._near(door)
            if (cost := _cost(door, self._known[number])) <= self._match_m
        )
        number_of: dict[int, int] = {}
        taken: set[int] = set()
        for _, number, k in pairs:
            if k not in number_of and number not in taken:
                number_of[k] = number
                taken.add(number)
        following = max((*self._known, *number_of.values()), default=0) + 1
        for k in range(len(made)):
            if k not in number_of:
                number_of[k], following = following, following + 1
        doors = {
            # Once gone through, always gone through: the rooms' own memory is lost when an opening vanishes for a while.
            n: replace(
                made[k], id=f"D{n}", traversed=made[k].traversed or (n in self._known and self._known[n].traversed)
            )
            for k, n in number_of.items()
        }
        for n, door in doors.items():
            self._keep(n, door)
        return tuple(doors[n] for n in sorted(doors))


def _edge(opening: Opening) -> DoorEdge:
    low, high = sorted(opening.rooms)
    x, y = opening.position_xy
    return DoorEdge("", (f"R{low}", f"R{high}"), (float(x), float(y)), float(opening.width_m), opening.traversed)


def _cost(door: DoorEdge, known: DoorEdge) -> float:
    return math.dist(door.position_xy, known.position_xy) + (0.0 if door.rooms == known.rooms else _OTHER_ROOMS_M)
