"""A place that is being furnished: what has been put where so far.

Frame: z up from the floor, metres. Number 0 is structure; things count from 1.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from training.furniture import groups
from training.render_models import Body, Drawn, Surface, fitted, of_model, projected
from training.render_textures import Bank

Rng = np.random.Generator
NONE, WALL, FLOOR, CEILING, DOOR, WINDOW, CARPET = range(7)
_SUPPORTS = 0.35  # things lower than this carry nothing


@dataclass(slots=True)
class Yard:
    """What has been placed so far."""

    bank: Bank
    models: list[Drawn]
    rng: Rng
    height_m: float
    triangles: list = field(default_factory=list)
    uv: list = field(default_factory=list)
    surface: list = field(default_factory=list)
    surfaces: list = field(default_factory=list)
    thing: list = field(default_factory=list)
    part: list = field(default_factory=list)
    names: list = field(default_factory=list)
    boxes: list = field(default_factory=list)  # (low [3], high [3]) of things
    carriers: list = field(default_factory=list)  # triangles that face up, of things that can carry others

    def shell(self, solid, part: int, look: Surface, repeat_m: float = 1.0, flat: bool = False) -> None:
        uv = fitted(solid) if flat else projected(solid, repeat_m)
        self.add(solid, uv, np.zeros(len(solid), np.int32), (look,), 0, part)

    def stand(self, body: Body, x: float, y: float, z: float, yaw: float, *, overlap: bool = False) -> bool:
        """The body at a place, unless it would stand in another thing."""
        c, s = np.cos(yaw), np.sin(yaw)
        solid = body.triangles @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]], np.float32).T + np.array(
            [x, y, z], np.float32
        )
        low, high = solid.reshape(-1, 3).min(0), solid.reshape(-1, 3).max(0)
        if not overlap and not self.free(low, high):
            return False
        self.names.append(body.name)
        self.add(solid, body.uv, body.surface, body.surfaces, len(self.names), NONE)
        self.boxes.append((low, high))
        normal = np.cross(solid[:, 1] - solid[:, 0], solid[:, 2] - solid[:, 0])
        level = np.abs(normal[:, 2]) > 0.98 * np.linalg.norm(normal, axis=1) + 1e-9
        if high[2] > _SUPPORTS and level.any() and z < 1.5:
            flat = solid[level]
            if len(flat) < 4000:
                self.carriers.append((len(self.names), flat, high))
        for model, ahead, aside, up, turned in groups.upon(self.rng, body.name, body.triangles) if z == 0 else ():
            at = (x + c * ahead - s * aside, y + s * ahead + c * aside, up + 0.003)
            self.stand(of_model(model, self.bank, self.rng), *at, yaw + turned)
        return True

    def free(self, low, high, gap: float = 0.02) -> bool:
        return not any((low < theirs[1] - gap).all() and (high > theirs[0] + gap).all() for theirs in self.boxes)

    def add(self, solid, uv, number, looks, thing: int, part: int) -> None:
        self.triangles.append(solid)
        self.uv.append(uv)
        self.surface.append(number + len(self.surfaces))
        self.surfaces += looks
        self.thing.append(np.full(len(solid), thing, np.int32))
        self.part.append(np.full(len(solid), part, np.uint8))
