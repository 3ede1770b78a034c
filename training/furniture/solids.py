"""Triangles of simple solids, and moving them. A solid is float32 [T, 3, 3], metres; a Piece is a solid with what it is made of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Triangles = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Piece:
    """Triangles float32 [T, 3, 3] of one material (a key of ``materials.MATERIALS``)."""

    triangles: Triangles
    material: str


@dataclass(frozen=True, slots=True)
class Model:
    """A thing: its pieces in its own frame (origin on the floor, wall or ceiling point that carries it), and where it belongs.

    mount: floor | top (on furniture) | wall | ceiling. bottom_m: height of the origin above the floor, for wall and ceiling things.
    """

    name: str
    pieces: tuple[Piece, ...]
    mount: str = "floor"
    bottom_m: float = 0.0
    tags: tuple[str, ...] = field(default=())

    def triangles(self) -> Triangles:
        """All triangles [T, 3, 3]."""
        return np.concatenate([piece.triangles for piece in self.pieces])


def faces(vertices: NDArray[np.float64], index: Sequence[Sequence[int]]) -> Triangles:
    """Triangles from vertices [V, 3] and index rows of three or four corners."""
    rows = [(row[0], row[k], row[k + 1]) for row in index for k in range(1, len(row) - 1)]
    return np.asarray(vertices[np.array(rows)], np.float32)


def box(x0: float, x1: float, y0: float, y1: float, z0: float, z1: float) -> Triangles:
    """A box between two corners."""
    corner = np.array([[x, y, z] for x in (x0, x1) for y in (y0, y1) for z in (z0, z1)])
    sides = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    return faces(corner, sides)


def slab(dx: float, dy: float, z0: float, z1: float, x: float = 0.0, y: float = 0.0) -> Triangles:
    """A box dx by dy about (x, y)."""
    return box(x - dx / 2, x + dx / 2, y - dy / 2, y + dy / 2, z0, z1)


def lathe(profile: Sequence[tuple[float, float]], sides: int = 14, x: float = 0.0, y: float = 0.0) -> Triangles:
    """A profile of (radius, z) turned about the z axis through (x, y); radius 0 closes it."""
    ring = np.linspace(0, 2 * np.pi, sides, endpoint=False)
    rows = [np.column_stack([x + r * np.cos(ring), y + r * np.sin(ring), np.full(sides, z)]) for r, z in profile]
    vertices = np.concatenate(rows)
    index = []
    for k in range(len(profile) - 1):
        for j in range(sides):
            a, b = k * sides + j, k * sides + (j + 1) % sides
            index.append((a, b, b + sides, a + sides))
    return faces(vertices, index)


def cylinder(
    radius: float, z0: float, z1: float, x: float = 0.0, y: float = 0.0, top: float | None = None
) -> Triangles:
    """A closed cylinder, or a cone frustum when ``top`` (its upper radius) is given."""
    upper = radius if top is None else top
    return lathe(((0.0, z0), (radius, z0), (upper, z1), (0.0, z1)), x=x, y=y)


def ellipsoid(
    dx: float, dy: float, dz: float, x: float = 0.0, y: float = 0.0, z: float = 0.0, power: float = 2.0
) -> Triangles:
    """A superellipsoid of full size dx, dy, dz about (x, y, z): power 2 a ball, 5 a cushion, 10 nearly a box."""
    v, u = np.linspace(-np.pi / 2, np.pi / 2, 8), np.linspace(-np.pi, np.pi, 15)
    e = 2.0 / power

    def bent(c: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.sign(c) * np.abs(c) ** e

    gx = np.outer(bent(np.cos(v)), bent(np.cos(u))) * dx / 2 + x
    gy = np.outer(bent(np.cos(v)), bent(np.sin(u))) * dy / 2 + y
    gz = np.outer(bent(np.sin(v)), np.ones_like(u)) * dz / 2 + z
    return grid(np.stack([gx, gy, gz], -1))


def grid(points: NDArray[np.float64]) -> Triangles:
    """A sheet over a grid of points [R, C, 3]."""
    a, b, c, d = points[:-1, :-1], points[:-1, 1:], points[1:, 1:], points[1:, :-1]
    first, second = np.stack([a, b, c], -2), np.stack([a, c, d], -2)
    return np.concatenate([first.reshape(-1, 3, 3), second.reshape(-1, 3, 3)]).astype(np.float32)


def tube(path: Sequence[tuple[float, float, float]], radius: float, sides: int = 6) -> Triangles:
    """A pipe along a path of points."""
    points = np.array(path, np.float64)
    along = np.gradient(points, axis=0)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    helper = np.where(np.abs(along[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    u = np.cross(along, helper)
    u /= np.maximum(np.linalg.norm(u, axis=1, keepdims=True), 1e-9)
    v = np.cross(along, u)
    ring = np.linspace(0, 2 * np.pi, sides + 1)
    rows = points[:, None] + radius * (
        np.cos(ring)[None, :, None] * u[:, None] + np.sin(ring)[None, :, None] * v[:, None]
    )
    return grid(rows)


def extrude(outline: Sequence[tuple[float, float]], z0: float, z1: float) -> Triangles:
    """A convex outline in x, y pulled up from z0 to z1."""
    n = len(outline)
    low = np.array([[x, y, z0] for x, y in outline])
    vertices = np.concatenate([low, low + np.array([0, 0, z1 - z0])])
    sides = [(k, (k + 1) % n, n + (k + 1) % n, n + k) for k in range(n)]
    return faces(vertices, [*sides, tuple(range(n))[::-1], tuple(range(n, 2 * n))])


def move(solid: Triangles, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Triangles:
    """The solid moved."""
    return np.asarray(solid + np.array([x, y, z], np.float32), np.float32)


def turn(solid: Triangles, angle_rad: float, axis: str = "z") -> Triangles:
    """The solid turned about an axis through the origin."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    matrix = {
        "x": [[1, 0, 0], [0, c, -s], [0, s, c]],
        "y": [[c, 0, s], [0, 1, 0], [-s, 0, c]],
        "z": [[c, -s, 0], [s, c, 0], [0, 0, 1]],
    }[axis]
    return np.asarray(solid @ np.array(matrix, np.float32).T, np.float32)


def join(*solids: Triangles) -> Triangles:
    """Several solids as one."""
    return np.concatenate(solids)


def legs(
    dx: float, dy: float, height: float, thick: float, *, taper: float = 1.0, splay: float = 0.0, round_: bool = False
) -> Triangles:
    """Four legs inside the corners of dx by dy; taper: foot to head width; splay: how far the feet stand out, metres."""
    found = []
    for sx in (-1, 1):
        for sy in (-1, 1):
            hx, hy = sx * (dx / 2 - thick), sy * (dy / 2 - thick)
            fx, fy = hx + sx * splay, hy + sy * splay
            if round_:
                found.append(tube(((fx, fy, 0), (hx, hy, height)), thick / 2))
                continue
            f, h = thick * taper / 2, thick / 2
            low = [(fx - f, fy - f, 0), (fx + f, fy - f, 0), (fx + f, fy + f, 0), (fx - f, fy + f, 0)]
            high = [
                (hx - h, hy - h, height),
                (hx + h, hy - h, height),
                (hx + h, hy + h, height),
                (hx - h, hy + h, height),
            ]
            sides = [(k, (k + 1) % 4, 4 + (k + 1) % 4, 4 + k) for k in range(4)]
            found.append(faces(np.array(low + high), [*sides, (3, 2, 1, 0), (4, 5, 6, 7)]))
    return np.concatenate(found)
