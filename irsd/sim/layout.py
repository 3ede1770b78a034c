"""The shell of the embedded building: a corridor with rooms on both sides, walls with doors, wide openings and windows."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from irsd.sim.furnish import Rect, RoomSpace, Solid
from irsd.sim.parts import Colour, Part, box

WALL_HEIGHT_M = 2.6
DOOR_WIDTH_M = 0.9
DOOR_HEIGHT_M = 2.05
_FRAME_M = 0.03
_SILL_M, _WINDOW_TOP_M = 0.9, 2.15
_DOOR_CLEAR_M = 1.0
_WALL_COLOUR: Colour = (212, 206, 194)
_GLASS: Colour = (150, 190, 220)
_FLOORS: tuple[Colour, ...] = ((140, 112, 82), (120, 120, 118), (156, 138, 112), (104, 112, 122))


@dataclass(frozen=True, slots=True)
class Gap:
    """An opening of a wall along its length: from start to end metres, between heights z0 and z1."""

    start: float
    end: float
    z0: float
    z1: float
    kind: str  # door, opening, window, entrance


@dataclass(frozen=True, slots=True)
class Wall:
    """A straight wall: rect in plan, its length along x or y, and its gaps (not overlapping)."""

    rect: Rect
    along_x: bool
    gaps: tuple[Gap, ...]


@dataclass(frozen=True, slots=True)
class Fixture:
    """A structural thing: label (wall, floor, ceiling, door, window) and its parts in the building's frame."""

    label: str
    parts: tuple[Part, ...]


@dataclass(frozen=True, slots=True)
class RoomShell:
    """A room's kind and inner rectangle."""

    kind: str
    rect: Rect


@dataclass(frozen=True, slots=True)
class Passage:
    """A way between two rooms (indices): middle of the gap and its width."""

    rooms: tuple[int, int]
    x_m: float
    y_m: float
    width_m: float


@dataclass(frozen=True, slots=True)
class Shell:
    """rooms: the corridor last. fixtures: walls, floors, ceilings, doors, windows. size_m: outer length and width."""

    rooms: tuple[RoomShell, ...]
    walls: tuple[Wall, ...]
    passages: tuple[Passage, ...]
    fixtures: tuple[Fixture, ...]
    size_m: tuple[float, float]

    def space(self, index: int) -> RoomSpace:
        """The empty room as furnishing sees it."""
        rect = self.rooms[index].rect
        keep_free: list[Rect] = []
        points: list[tuple[float, float]] = []
        for passage in self.passages:
            if index not in passage.rooms:
                continue
            half = passage.width_m / 2 + 0.12
            nx, ny = _inward(rect, passage)
            x, y = passage.x_m, passage.y_m
            far = (x + nx * (_DOOR_CLEAR_M + 0.1), y + ny * (_DOOR_CLEAR_M + 0.1))
            sides = (abs(ny) * half, abs(nx) * half)
            keep_free.append(
                (
                    min(x, far[0]) - sides[0],
                    min(y, far[1]) - sides[1],
                    max(x, far[0]) + sides[0],
                    max(y, far[1]) + sides[1],
                )
            )
            points.append((x + nx * 0.5, y + ny * 0.5))
        return RoomSpace(rect, tuple(keep_free), self._windows(rect), tuple(points))

    def _windows(self, rect: Rect) -> tuple[Solid, ...]:
        """Window spans as taken space just inside the wall, so that nothing tall or hung covers them."""
        reach = (rect[0] - 0.3, rect[1] - 0.3, rect[2] + 0.3, rect[3] + 0.3)
        found = []
        for wall in self.walls:
            for gap in wall.gaps:
                if gap.kind not in ("window", "entrance"):
                    continue
                deep = 0.7 if gap.kind == "entrance" else 0.12
                w = wall.rect
                span = (gap.start, w[1] - deep, gap.end, w[3] + deep) if wall.along_x else (
                    w[0] - deep, gap.start, w[2] + deep, gap.end
                )  # fmt: skip
                if span[0] < reach[2] and span[2] > reach[0] and span[1] < reach[3] and span[3] > reach[1]:
                    found.append(Solid(span, gap.z0, gap.z1))
        return tuple(found)


def _inward(rect: Rect, passage: Passage) -> tuple[int, int]:
    """Unit normal (x, y) from the passage into the room."""
    x, y = passage.x_m, passage.y_m
    if x < rect[0]:
        return 1, 0
    if x > rect[2]:
        return -1, 0
    return (0, 1) if y < rect[1] else (0, -1)


def make_shell(rng: np.random.Generator) -> Shell:
    """A building of six rooms and a corridor, about 14 m by 9 m, mirrored and arranged at random."""
    t = float(rng.uniform(0.12, 0.15))
    length = float(rng.uniform(13.2, 14.4))
    depths = rng.uniform(3.3, 3.7, 2)
    corridor = float(rng.uniform(1.6, 1.9))
    south_top = t + float(depths[0])
    north_bottom = south_top + t + corridor + t
    width = north_bottom + float(depths[1]) + t
    rows = [["laboratory", "bathroom", "office"], ["kitchen", _either(rng, "meeting room", "dining room")]]
    rows[1].append(_either(rng, "lounge", "bedroom"))
    rows = [[row[int(i)] for i in rng.permutation(3)] for row in rows]
    if rng.random() < 0.5:
        rows.reverse()
    rooms: list[RoomShell] = []
    walls: list[Wall] = []
    passages: list[Passage] = []
    hall: Rect = (t, south_top + t, length - t, north_bottom - t)
    for row, (y0, y1) in zip(rows, ((t, south_top), (north_bottom, width - t)), strict=True):
        _add_row(rng, row, (y0, y1), length, t, rooms, walls, passages)
    rooms.append(RoomShell("corridor", hall))
    ends = ((0.0, 0.0, t, width), (length - t, 0.0, length, width))
    middle = (hall[1] + hall[3]) / 2
    entrance = Gap(middle - DOOR_WIDTH_M / 2, middle + DOOR_WIDTH_M / 2, 0.0, DOOR_HEIGHT_M, "entrance")
    walls.append(Wall(ends[0], False, (entrance,)))
    walls.append(Wall(ends[1], False, (Gap(middle - 0.4, middle + 0.4, _SILL_M, _WINDOW_TOP_M, "window"),)))
    fixtures = [fixture for wall in walls for fixture in _wall_fixtures(wall)]
    fixtures += [_floor(rng, rect) for rect in _floor_rects(rooms, length, width)]
    fixtures.append(
        Fixture("ceiling", (box(0, length, 0, width, WALL_HEIGHT_M, WALL_HEIGHT_M + 0.1, (228, 226, 220)),))
    )
    return Shell(tuple(rooms), tuple(walls), tuple(passages), tuple(fixtures), (length, width))


def _either(rng: np.random.Generator, a: str, b: str) -> str:
    return a if rng.random() < 0.5 else b


_SHARE = {"laboratory": 1.25, "bathroom": 0.55, "office": 1.1, "kitchen": 1.0, "lounge": 1.1, "bedroom": 1.0}


def _add_row(
    rng: np.random.Generator,
    row: list[str],
    span_y: tuple[float, float],
    length: float,
    t: float,
    rooms: list[RoomShell],
    walls: list[Wall],
    passages: list[Passage],
) -> None:
    """Three rooms side by side: their walls to each other, to the corridor and outside, and the ways between them."""
    y0, y1 = span_y
    south = y0 <= t + 1e-9
    hall_index = 6
    share = np.array([_SHARE.get(kind, 1.05) for kind in row]) * rng.uniform(0.95, 1.05, len(row))
    widths = share / share.sum() * (length - (len(row) + 1) * t)
    inner_y = y1 if south else y0 - t  # lower face of the wall to the corridor
    outer_y = y0 - t if south else y1
    inner_gaps: list[Gap] = []
    outer_gaps: list[Gap] = []
    x = t
    first = len(rooms)
    for k, (kind, wide) in enumerate(zip(row, widths, strict=True)):
        x1 = x + float(wide)
        rooms.append(RoomShell(kind, (x, y0, x1, y1)))
        open_plan = kind in ("kitchen", "lounge") and rng.random() < 0.5
        gap = float(rng.uniform(1.4, 1.8)) if open_plan else DOOR_WIDTH_M
        at = float(rng.uniform(x + gap / 2 + 0.3, x1 - gap / 2 - 0.3))
        inner_gaps.append(Gap(at - gap / 2, at + gap / 2, 0.0, 2.2 if open_plan else DOOR_HEIGHT_M,
                              "opening" if open_plan else "door"))  # fmt: skip
        passages.append(Passage((first + k, hall_index), at, inner_y + t / 2, gap))
        pane = float(rng.uniform(0.6, 0.8) if kind == "bathroom" else rng.uniform(1.2, 1.7))
        middle = (x + x1) / 2 + float(rng.uniform(-0.3, 0.3))
        outer_gaps.append(Gap(middle - pane / 2, middle + pane / 2, _SILL_M, _WINDOW_TOP_M, "window"))
        if k + 1 < len(row):
            between: tuple[Gap, ...] = ()
            if "bathroom" not in (kind, row[k + 1]) and rng.random() < 0.35:
                at = float(rng.uniform(y0 + 0.9, y1 - 0.9))
                between = (Gap(at - DOOR_WIDTH_M / 2, at + DOOR_WIDTH_M / 2, 0.0, DOOR_HEIGHT_M, "door"),)
                passages.append(Passage((first + k, first + k + 1), x1 + t / 2, at, DOOR_WIDTH_M))
            walls.append(Wall((x1, y0, x1 + t, y1), False, between))
        x = x1 + t
    walls.append(Wall((t, inner_y, length - t, inner_y + t), True, tuple(inner_gaps)))
    walls.append(Wall((t, outer_y, length - t, outer_y + t), True, tuple(outer_gaps)))


def _wall_fixtures(wall: Wall) -> list[Fixture]:
    """The wall's solid boxes around its gaps, and what fills the gaps: door frames, panes, the closed entrance."""
    x0, y0, x1, y1 = wall.rect
    low, high = (x0, x1) if wall.along_x else (y0, y1)

    def piece(a: float, b: float, z0: float, z1: float, colour: Colour, inset: float = 0.0) -> Part:
        if wall.along_x:
            return box(a, b, y0 + inset, y1 - inset, z0, z1, colour)
        return box(x0 + inset, x1 - inset, a, b, z0, z1, colour)

    solid: list[Part] = []
    filled: list[Fixture] = []
    at = low
    for gap in sorted(wall.gaps, key=lambda g: g.start):
        solid.append(piece(at, gap.start, 0, WALL_HEIGHT_M, _WALL_COLOUR))
        solid.append(piece(gap.start, gap.end, gap.z1, WALL_HEIGHT_M, _WALL_COLOUR))
        if gap.z0 > 0:
            solid.append(piece(gap.start, gap.end, 0, gap.z0, _WALL_COLOUR))
        if gap.kind == "window":
            filled.append(Fixture("window", (piece(gap.start, gap.end, gap.z0, gap.z1, _GLASS, 0.04),)))
        elif gap.kind == "entrance":
            filled.append(Fixture("door", (piece(gap.start, gap.end, gap.z0, gap.z1, (120, 82, 52), 0.04),)))
        elif gap.kind == "door":
            brown: Colour = (134, 96, 66)
            frame = (
                piece(gap.start, gap.start + _FRAME_M, 0, gap.z1, brown, -0.015),
                piece(gap.end - _FRAME_M, gap.end, 0, gap.z1, brown, -0.015),
                piece(gap.start, gap.end, gap.z1 - _FRAME_M, gap.z1, brown, -0.015),
            )
            filled.append(Fixture("door", frame))
        at = gap.end
    solid.append(piece(at, high, 0, WALL_HEIGHT_M, _WALL_COLOUR))
    return [Fixture("wall", tuple(solid)), *filled]


def _floor_rects(rooms: list[RoomShell], length: float, width: float) -> list[Rect]:
    """Floor pieces that tile the building, one per room with half of the walls around it."""
    bands = sorted({room.rect[1] for room in rooms} | {room.rect[3] for room in rooms})
    cuts = [0.0, (bands[1] + bands[2]) / 2, (bands[3] + bands[4]) / 2, width]
    rects: list[Rect] = []
    for y0, y1 in pairwise(cuts):
        row = sorted((room.rect for room in rooms if y0 <= (room.rect[1] + room.rect[3]) / 2 <= y1), key=lambda r: r[0])
        xs = [0.0, *((a[2] + b[0]) / 2 for a, b in pairwise(row)), length]
        rects += [(a, y0, b, y1) for a, b in pairwise(xs)]
    return rects


def _floor(rng: np.random.Generator, rect: Rect) -> Fixture:
    colour = _FLOORS[int(rng.integers(len(_FLOORS)))]
    return Fixture("floor", (box(rect[0], rect[2], rect[1], rect[3], -0.1, 0.0, colour),))
