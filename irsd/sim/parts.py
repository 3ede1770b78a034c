"""Solid parts, things made of them, and groups of things placed together: the vocabulary of the embedded world.

A part is a box or an upright cylinder in its item's own frame: +x is the item's front, z is up, the origin is on the floor
below the item's middle. Everything is metres and radians. Colours are RGB 0..255.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Colour = tuple[int, int, int]
CYLINDER_SIDES = 14

_BOX_CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], np.float64)
_BOX_FACES = np.array(
    [
        *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]),
        *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
    ]
)


@dataclass(frozen=True, slots=True)
class Part:
    """An axis-aligned box, or (round) the upright cylinder inscribed in it. lo, hi: corners [3] in the item's frame."""

    lo: tuple[float, float, float]
    hi: tuple[float, float, float]
    colour: Colour
    round: bool = False

    def triangles(self) -> NDArray[np.float64]:
        """[T, 3, 3] with outward counter-clockwise winding."""
        lo, hi = np.asarray(self.lo), np.asarray(self.hi)
        if self.round:
            return np.asarray(_cylinder() * (hi - lo) + lo)
        return np.asarray((_BOX_CORNERS * (hi - lo) + lo)[_BOX_FACES])


@dataclass(frozen=True, slots=True)
class Item:
    """A thing: its name, other names people use, its parts, and where it stands in its group (x, y, z, yaw)."""

    label: str
    synonyms: tuple[str, ...]
    parts: tuple[Part, ...]
    x_m: float = 0.0
    y_m: float = 0.0
    z_m: float = 0.0
    yaw_rad: float = 0.0

    def at(self, x_m: float, y_m: float, z_m: float = 0.0, yaw_rad: float = 0.0) -> Item:
        """The same thing elsewhere in its group."""
        return replace(self, x_m=x_m, y_m=y_m, z_m=z_m, yaw_rad=yaw_rad)

    def corners(self) -> NDArray[np.float64]:
        """[K, 3] corners of all parts in the group's frame (its extent in plan and height)."""
        boxes = np.array([[p.lo, p.hi] for p in self.parts])
        corners = (_BOX_CORNERS[None] * (boxes[:, 1] - boxes[:, 0])[:, None] + boxes[:, 0][:, None]).reshape(-1, 3)
        return moved(corners, self.x_m, self.y_m, self.z_m, self.yaw_rad)


@dataclass(frozen=True, slots=True)
class Group:
    """Things that are placed together, such as a desk with its monitor and chair.

    place: ``wall`` (back to a wall, corners first), ``middle`` (of the room). front_clear_m: floor that must stay open in
    front; required: the building is thrown away when this finds no place.
    """

    items: tuple[Item, ...]
    place: str = "wall"
    front_clear_m: float = 0.0
    required: bool = False

    def extent(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(lo [3], hi [3]) of all items in the group's frame."""
        corners = np.concatenate([item.corners() for item in self.items])
        return corners.min(0), corners.max(0)


def box(x0: float, x1: float, y0: float, y1: float, z0: float, z1: float, colour: Colour) -> Part:
    """A box part from its two corners."""
    return Part((x0, y0, z0), (x1, y1, z1), colour)


def cylinder(x: float, y: float, radius: float, z0: float, z1: float, colour: Colour) -> Part:
    """An upright cylinder part."""
    return Part((x - radius, y - radius, z0), (x + radius, y + radius, z1), colour, round=True)


def moved(
    points: NDArray[np.float64], x_m: float, y_m: float, z_m: float = 0.0, yaw_rad: float = 0.0
) -> NDArray[np.float64]:
    """Points [..., 3] turned about z by yaw, then shifted."""
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(points @ rotation.T + np.array([x_m, y_m, z_m]))


def _cylinder() -> NDArray[np.float64]:
    """Triangles of the upright cylinder inscribed in the unit cube."""
    angle = np.arange(CYLINDER_SIDES + 1) * 2 * np.pi / CYLINDER_SIDES
    rim = np.stack([0.5 + 0.5 * np.cos(angle), 0.5 + 0.5 * np.sin(angle), np.zeros_like(angle)], -1)
    a, b = rim[:-1], rim[1:]
    up = np.array([0.0, 0.0, 1.0])
    centre = np.broadcast_to([0.5, 0.5, 0.0], a.shape)
    faces = [(a, b, b + up), (a, b + up, a + up), (centre + up, a + up, b + up), (centre, b, a)]
    return np.concatenate([np.stack(face, 1) for face in faces])
