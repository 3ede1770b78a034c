"""Furnished buildings with names, and what the product's own map holds of them after a robot's LiDAR drove through.

python -m training.scene --first 0 --count 400 --seed 1 --out DIR     # one file a building; those that are there are left

Training sees the same voxels, normals, levels and wall lines as the product, because they come out of ``mapping.mapper``.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from irsd.core.geometry import pose_from_xy_yaw
from irsd.core.types import DeskewedScan, Structure, SyncedFrame
from irsd.mapping.mapper import Mapper, MappingSettings
from irsd.mapping.voxels import VoxelSettings
from irsd.sim.raycast import RayScene
from training import sweethome
from training.furniture import groups, seating
from training.furniture.collection import draw
from training.furniture.solids import Triangles, turn
from training.house import Opening, Rect, Rng, Room, Shell, make_shell

MAX_TRIANGLES = 25_000  # of one catalogue model
_TABLES = frozenset(
    {"dining table", "desk", "workbench", "conference table", "console table"}
)  # with chairs pushed under
_PITCH_M = 0.65  # from chair to chair along a table


@dataclass(frozen=True, slots=True)
class Scene:
    """triangles [T, 3, 3]; structure uint8 [T]; instance int32 [T], k for names[k - 1], 0 for the shell; rooms; solids' plan boxes."""

    triangles: Triangles
    structure: NDArray[np.uint8]
    instance: NDArray[np.int32]
    names: tuple[str, ...]
    rooms: tuple[Room, ...]
    taken: tuple[Rect, ...]


@dataclass(frozen=True, slots=True)
class Thing:
    """A model to be placed: triangles about its own origin, front +x."""

    name: str
    triangles: Triangles
    mount: str
    bottom_m: float


def draw_thing(rng: Rng, catalogue: list[tuple[sweethome.Entry, Triangles]], share: float) -> Thing:
    """A parametric thing, or (share) a catalogue's."""
    if catalogue and rng.random() < share:
        entry, triangles = catalogue[int(rng.integers(len(catalogue)))]
        return Thing("sh3d:" + entry.name, triangles, sweethome.mount_of(entry), entry.elevation_m)
    model = draw(rng)
    return Thing(model.name, model.triangles(), model.mount, model.bottom_m)


class _Furnisher:
    """Places things in rooms one after the other."""

    def __init__(self, shell: Shell, rng: Rng) -> None:
        self._shell, self._rng = shell, rng
        self.solids: list[Triangles] = []
        self.names: list[str] = []
        self.boxes: list[tuple[Rect, float, float]] = []  # plan box, lowest and highest z
        self._tops: list[tuple[Rect, float]] = []

    def place(self, room: Room, thing: Thing) -> bool:
        """Finds a place that fits, or gives up: False."""
        rng = self._rng
        solid = thing.triangles * rng.uniform(0.9, 1.1, 3).astype(np.float32)
        size = np.ptp(solid.reshape(-1, 3), axis=0)
        if size[2] > room.height_m - 0.05 or max(size[:2]) > 0.9 * max(
            room.rect[2] - room.rect[0], room.rect[3] - room.rect[1]
        ):
            return
        for _ in range(8):
            yaw, x, y, z = self._guess(room, thing, solid)
            turned = turn(solid, yaw) + np.float32([x, y, z])
            corners = turned.reshape(-1, 3)
            low, high = corners.min(0), corners.max(0)
            if (
                low[0] < room.rect[0] - 0.01
                or low[1] < room.rect[1] - 0.01
                or high[0] > room.rect[2] + 0.01
                or high[1] > room.rect[3] + 0.01
            ):
                continue
            gap = 0.0 if rng.random() < 0.35 else 0.08
            rect = (float(low[0]), float(low[1]), float(high[0]), float(high[1]))
            clash = any(
                rect[0] < r[2] + gap
                and r[0] < rect[2] + gap
                and rect[1] < r[3] + gap
                and r[1] < rect[3] + gap
                and low[2] < b - 0.005
                and a < high[2] - 0.005
                for r, a, b in self.boxes
            )
            if clash or (low[2] < 1.0 and any(_before(rect, o) for o in self._shell.openings if o.kind == "door")):
                continue
            self.solids.append(turned)
            self.names.append(thing.name)
            self.boxes.append((rect, float(low[2]), float(high[2])))
            if thing.mount == "floor" and 0.3 < high[2] < 1.5:
                self._tops.append((rect, float(high[2])))
                self._dress(room, thing.name, solid, yaw, x, y)
            return True
        return False

    def tuck(self, room: Room) -> None:
        """Chairs round the table that was placed last, pushed under it more or less: in a map they are hardly apart."""
        rng, ((x0, y0, x1, y1), _, _) = self._rng, self.boxes[-1]
        maker = seating.MAKERS[int(rng.integers(3))][0] if rng.random() < 0.3 else seating.chair
        sides = (
            (x1, y0, y1, True, np.pi),
            (x0, y0, y1, True, 0.0),
            (y1, x0, x1, False, -np.pi / 2),
            (y0, x0, x1, False, np.pi / 2),
        )
        for k, (edge, a, b, upright, yaw) in enumerate(sides):
            if rng.random() < 0.35:
                continue
            for along in np.arange(a + _PITCH_M / 2, b - 0.2, _PITCH_M):
                out = float(rng.uniform(0.02, 0.4)) * (1 if k % 2 == 0 else -1)
                at = np.float32([edge + out, along, 0.0] if upright else [along, edge + out, 0.0])
                model = maker(rng)
                self._add(room, model.name, turn(model.triangles(), yaw + float(rng.normal(0, 0.1))) + at)

    def _dress(self, room: Room, name: str, solid: Triangles, yaw: float, x: float, y: float) -> None:
        """What usually stands on such a thing."""
        c, s = float(np.cos(yaw)), float(np.sin(yaw))
        for model, ahead, aside, up, turned in groups.upon(self._rng, name, solid):
            at = np.float32([x + c * ahead - s * aside, y + s * ahead + c * aside, up + 0.003])
            self._add(room, model.name, turn(model.triangles(), yaw + turned) + at)

    def _add(self, room: Room, name: str, solid: Triangles) -> None:
        """A thing where it is, if that is within the room and in nothing but a table."""
        corners = solid.reshape(-1, 3)
        low, high = corners.min(0), corners.max(0)
        rect = (float(low[0]), float(low[1]), float(high[0]), float(high[1]))
        x0, y0, x1, y1 = room.rect
        inside = rect[0] > x0 and rect[1] > y0 and rect[2] < x1 and rect[3] < y1
        others = [box for box, name in zip(self.boxes, self.names, strict=True) if name not in _TABLES]
        clash = any(
            rect[0] < r[2] and r[0] < rect[2] and rect[1] < r[3] and r[1] < rect[3] and low[2] < t and b < high[2]
            for r, b, t in others
        )
        if inside and not clash and not any(_before(rect, o) for o in self._shell.openings if o.kind == "door"):
            self.solids.append(solid)
            self.names.append(name)
            self.boxes.append((rect, float(low[2]), float(high[2])))

    def _guess(self, room: Room, thing: Thing, solid: Triangles) -> tuple[float, float, float, float]:
        """yaw, x, y, z of a place where such things are."""
        rng, (x0, y0, x1, y1) = self._rng, room.rect
        anywhere = (float(rng.uniform(x0, x1)), float(rng.uniform(y0, y1)))
        if thing.mount == "ceiling":
            return (float(rng.uniform(0, 6.28)), *anywhere, room.height_m - float(solid[..., 2].max()))
        if thing.mount == "top":
            tops = [t for t in self._tops if x0 <= t[0][0] and t[0][2] <= x1 and y0 <= t[0][1] and t[0][3] <= y1]
            if not tops or rng.random() < 0.12:
                return (float(rng.uniform(0, 6.28)), *anywhere, 0.0)
            (a, b, c, d), z = tops[int(rng.integers(len(tops)))]
            return float(rng.uniform(0, 6.28)), float(rng.uniform(a, c)), float(rng.uniform(b, d)), z
        if thing.mount == "wall" or rng.random() < 0.65:
            quarter = int(rng.integers(4))
            back = -float(solid[..., 0].min()) + (
                0.0 if thing.mount == "wall" else float(rng.choice([0.0, 0.02, 0.05, 0.12]))
            )
            along = float(rng.uniform(y0, y1) if quarter % 2 == 0 else rng.uniform(x0, x1))
            x, y = ((x0 + back, along), (along, y0 + back), (x1 - back, along), (along, y1 - back))[quarter]
            z = max(0.0, thing.bottom_m * float(rng.uniform(0.85, 1.15))) if thing.mount == "wall" else 0.0
            return quarter * np.pi / 2, x, y, z
        return float(rng.uniform(0, 6.28)), *anywhere, 0.0


def _before(rect: Rect, opening: Opening) -> bool:
    """Does something stand in a doorway?"""
    a, b = (opening.half_m, 0.5) if opening.along_x else (0.5, opening.half_m)
    return (
        rect[0] < opening.x_m + a
        and rect[2] > opening.x_m - a
        and rect[1] < opening.y_m + b
        and rect[3] > opening.y_m - b
    )


def make_scene(rng: Rng, catalogue: list[tuple[sweethome.Entry, Triangles]], share: float = 0.25) -> Scene:
    """A building and what stands in it."""
    shell = make_shell(rng)
    furnisher = _Furnisher(shell, rng)
    for room in shell.rooms:
        area = (room.rect[2] - room.rect[0]) * (room.rect[3] - room.rect[1])
        things = [draw_thing(rng, catalogue, share) for _ in range(int(min(area * rng.uniform(0.5, 2.2), 40)))]
        # Big things first, so that they find room, and what stands on them finds them.
        for thing in sorted(
            things, key=lambda t: (t.mount == "top", -float(np.ptp(t.triangles[..., :2].reshape(-1, 2), axis=0).prod()))
        ):
            if furnisher.place(room, thing) and thing.name in _TABLES and rng.random() < 0.7:
                furnisher.tuck(room)
    counts = [len(s) for s in furnisher.solids]
    shell_triangles, shell_class = np.concatenate(shell.solids), np.concatenate(shell.classes)
    number = np.repeat(np.arange(1, len(counts) + 1, dtype=np.int32), counts)
    return Scene(
        np.concatenate([shell_triangles, *furnisher.solids]),
        np.concatenate([shell_class, np.zeros(len(number), np.uint8)]),
        np.concatenate([np.zeros(len(shell_triangles), np.int32), number]),
        tuple(furnisher.names),
        tuple(shell.rooms),
        tuple(r for r, low, _ in furnisher.boxes if low < 1.0),
    )


def drive(scene: Scene, rng: Rng) -> list[NDArray[np.float64]]:
    """(x, y, yaw) [K, 3] of each room's scans: along lines between free places of the room."""
    ways = []
    for room in scene.rooms:
        x0, y0, x1, y1 = room.rect
        places = []
        for _ in range(60):
            x, y = float(rng.uniform(x0 + 0.3, x1 - 0.3)), float(rng.uniform(y0 + 0.3, y1 - 0.3))
            if all(not (a - 0.2 < x < c + 0.2 and b - 0.2 < y < d + 0.2) for a, b, c, d in scene.taken):
                places.append((x, y))
            if len(places) == int(2 + (x1 - x0) * (y1 - y0) / 10):
                break
        if not places:
            continue
        step = float(rng.uniform(0.12, 0.4))
        corners = np.array(places)
        legs = [np.linspace(a, b, max(int(np.hypot(*(b - a)) / step), 2)) for a, b in pairwise(corners)]
        way = np.concatenate([*legs, np.repeat(corners[-1:], 3, 0)])[:60]
        ways.append(np.column_stack([way, rng.uniform(0, 2 * np.pi, len(way))]))
    return ways


def _rays(rng: Rng) -> NDArray[np.float32]:
    """Unit directions [R, 3] of one kind of LiDAR."""
    if rng.random() < 0.15:  # no rings: points spread over a dome
        low, high = np.deg2rad(-10), np.deg2rad(55)
        elevation = np.arcsin(rng.uniform(np.sin(low), np.sin(high), 7000))
        azimuth = rng.uniform(0, 2 * np.pi, 7000)
    else:
        rings, low, high = [(32, -25, 50), (32, -25, 50), (32, -25, 50), (16, -15, 15), (64, -25, 40), (40, -45, 45)][
            int(rng.integers(6))
        ]
        columns = 7600 // rings
        elevation = np.repeat(np.deg2rad(np.linspace(low, high, rings)), columns)
        azimuth = np.tile(np.arange(columns) * 2 * np.pi / columns, rings)
    out = np.stack([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], -1)
    return out.astype(np.float32)


def observe(scene: Scene, rng: Rng) -> list[dict[str, NDArray]]:  # type: ignore[type-arg]
    """The map's voxels at the end of the drive, and for a building of several rooms also half way: what ``snapshot`` gives."""
    caster, rays = RayScene(scene.triangles), _rays(rng)
    mapper = Mapper(MappingSettings(voxels=VoxelSettings(max_voxels=900_000)))
    sensor_z, noise = float(rng.uniform(0.35, 1.2)), float(rng.choice([0.005, 0.01, 0.015, 0.015, 0.02]))
    drift, yaw_noise = float(rng.choice([0.0, 0.003, 0.008])), float(np.deg2rad(rng.choice([0.0, 0.1, 0.2])))
    ways = drive(scene, rng)
    poses = np.concatenate(ways) if ways else np.zeros((0, 3))
    points, owners, taken = [], [], []
    for k, (x, y, yaw) in enumerate(poses):
        c, s = np.cos(yaw), np.sin(yaw)
        turned = rays @ np.float32([[c, s, 0], [-s, c, 0], [0, 0, 1]])
        origin = np.float32([x, y, sensor_z])
        hits = caster.cast(np.broadcast_to(origin, turned.shape), turned)
        kept = (hits.triangle >= 0) & (hits.range_m < 25) & (hits.range_m > 0.25) & (rng.random(len(turned)) > 0.005)
        measured = hits.range_m[kept] + rng.normal(0, noise, int(kept.sum())).astype(np.float32)
        error = float(rng.normal(0, yaw_noise))
        ray = turned[kept] @ np.float32(
            [[np.cos(error), np.sin(error), 0], [-np.sin(error), np.cos(error), 0], [0, 0, 1]]
        )
        cloud = (origin + np.float32([*rng.normal(0, drift, 2), 0]) + ray * measured[:, None]).astype(np.float32)
        scan = DeskewedScan(k * 200_000_000, cloud, origin.astype(np.float64))
        mapper.integrate(SyncedFrame(k, scan.stamp_ns, pose_from_xy_yaw(x, y, yaw, 0.0), scan, ()))
        points.append(cloud)
        owners.append(hits.triangle[kept])
        if k + 1 == len(poses) or (k + 1 == len(poses) // 2 and len(scene.rooms) > 1):
            taken.append(
                snapshot(mapper, scene, np.concatenate(points), np.concatenate(owners))
                | {"base": np.float32([x, y, 0.0])}
            )
    return taken


def snapshot(
    mapper: Mapper, scene: Scene, points: NDArray[np.float32], owners: NDArray[np.int32]
) -> dict[str, NDArray]:  # type: ignore[type-arg]
    """What the map knows of each voxel [N], and what it truly is: the triangle that most of its points are of."""
    rows = mapper.voxels.rows_at(points).astype(np.int64)
    kind = np.where(scene.instance[owners] > 0, scene.instance[owners] + 10, scene.structure[owners]).astype(np.int64)
    pairs, counts = np.unique(rows * 100_000 + kind, return_counts=True)
    pairs, counts = pairs[pairs >= 0], counts[pairs >= 0]
    order = np.lexsort((counts, pairs // 100_000))
    row, kind = pairs[order] // 100_000, pairs[order] % 100_000
    last = np.append(row[1:] != row[:-1], True)
    row, kind = row[last], kind[last]
    block = mapper.block(row.astype(np.int32))
    return {
        "points": block.points,
        "normals": block.normals.astype(np.float16),
        "surface": (block.surface - block.points).astype(np.float16),
        "levels": block.levels.astype(np.float16),
        "geometry": block.geometry,
        "instance": np.where(kind > 10, kind - 10, 0).astype(np.int16),
        "truth": np.where(kind > 10, int(Structure.OTHER), kind).astype(np.uint8),
    }


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=400)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--share", type=float, default=0.25, help="share of catalogue models")
    parser.add_argument("--out", type=Path, required=True)
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    catalogue = sweethome.collection(arguments.out / "catalogue.npz", MAX_TRIANGLES) if arguments.share else []
    for k in range(arguments.first, arguments.first + arguments.count):
        path = arguments.out / f"scene_{arguments.seed}_{k:05d}.npz"
        if path.exists():
            continue
        rng = np.random.default_rng([arguments.seed, k])
        scene = make_scene(rng, catalogue, arguments.share)
        shots = observe(scene, rng)
        arrays = {f"{name}_{i}": value for i, shot in enumerate(shots) for name, value in shot.items()}
        part = path.with_suffix(".part.npz")
        np.savez(part, names=np.array(scene.names), shots=len(shots), **arrays)
        part.rename(path)


if __name__ == "__main__":
    main()
