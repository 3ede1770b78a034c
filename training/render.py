"""Pictures of furnished rooms with their truth, and what a robot's LiDAR map would show of them.

python -m training.render --seed S --scenes N --out DIR [--frames 8]

Writes DIR/scene_SEED.npz, one per scene (an existing one is skipped: an interrupted run goes on where it stopped). Rays are cast by
Embree (embreex). The map is the product's: turns of the LiDAR from several places, 4 cm voxels, projected and tested for occlusion by
the code that irsd runs (``instances.lift.points_in_sight``).
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from irsd.core.jit import kernel
from irsd.core.types import CameraModel, CameraView
from irsd.instances.lift import LiftSettings, points_in_sight
from training.render_models import catalogue
from training.render_scene import Scene, make_scene
from training.render_textures import SIDE, Bank, bank
from training.render_yard import CEILING, FLOOR, NONE, WALL

Rng = np.random.Generator
HEIGHT, WIDTH = 240, 320
VOXEL_M = 0.04
_CACHE = Path("catalogue.pkl")


class Mesh:
    """Rays into a scene: range, triangle (-1 none) and where on it."""

    def __init__(self, triangles: NDArray[np.float32]) -> None:
        self._scene = EmbreeScene()
        self._mesh = TriangleMesh(self._scene, np.ascontiguousarray(triangles, np.float32))

    def cast(self, origins: NDArray[np.float32], directions: NDArray[np.float32]):
        found = self._scene.run(
            np.ascontiguousarray(origins, np.float32), np.ascontiguousarray(directions, np.float32), output=1
        )
        triangle = np.asarray(found["primID"], np.int32)
        return np.where(triangle < 0, np.inf, found["tfar"]).astype(np.float32), triangle, found["u"], found["v"]


@kernel
def shade(range_m, triangle, bu, bv, directions, normals, uv, density, surface, textures, colours, gloss, glow, levels, lights,
power, shadow, ambient, pixel_rad, origin):  # fmt: skip
    """Light [N, 3], 0..1 as the surfaces send it: Lambert and a little gloss under point lights, textures at the level that fits.

    levels: the bank's textures of all levels in one array uint8 [K, SIDE, 2 * SIDE, 3], level l from column SIDE * (2 - 2 ** (1 - l)).
    """
    out = np.empty((len(range_m), 3), np.float32)
    side = levels.shape[1]
    for n in range(len(range_m)):
        t = triangle[n]
        if t < 0:
            out[n] = 0.8
            continue
        d = directions[n]
        far = range_m[n]
        normal = normals[t]
        facing = -(normal[0] * d[0] + normal[1] * d[1] + normal[2] * d[2])
        sign = 1.0 if facing > 0 else -1.0
        facing = abs(facing)
        s = surface[t]
        b, c = bu[n], bv[n]
        x = uv[t, 0, 0] * (1 - b - c) + uv[t, 1, 0] * b + uv[t, 2, 0] * c
        y = uv[t, 0, 1] * (1 - b - c) + uv[t, 1, 1] * b + uv[t, 2, 1] * c
        texels = density[t] * side * far * pixel_rad / max(facing, 0.15)
        level = 0
        while texels > 1.5 and level < 5:
            texels *= 0.5
            level += 1
        own = side >> level
        first = 2 * side - (2 * side >> level)
        column = int(np.floor((x - np.floor(x)) * own)) % own
        row = int(np.floor((y - np.floor(y)) * own)) % own
        hit0, hit1, hit2 = origin[0] + d[0] * far, origin[1] + d[1] * far, origin[2] + d[2] * far
        lr = lg = lb = 0.0
        shine = 0.0
        for k in range(len(lights)):
            px, py, pz = lights[k, 0] - hit0, lights[k, 1] - hit1, lights[k, 2] - hit2
            dist = np.sqrt(px * px + py * py + pz * pz) + 1e-6
            lambert = sign * (normal[0] * px + normal[1] * py + normal[2] * pz) / dist
            if lambert <= 0 or (k == 0 and shadow[n]):
                continue
            fall = 1.0 / (1.0 + 0.12 * dist * dist)
            lr += power[k, 0] * lambert * fall
            lg += power[k, 1] * lambert * fall
            lb += power[k, 2] * lambert * fall
            mirror = 2 * lambert * facing - (-(d[0] * px + d[1] * py + d[2] * pz) / dist)
            if mirror > 0.9:
                shine += ((mirror - 0.9) * 10) ** 3 * fall
        hemi = 0.8 + 0.2 * sign * normal[2] + 0.15 * facing
        for k in range(3):
            light = (lr, lg, lb)[k] + ambient[k] * hemi
            light = light * (1 - glow[s]) + glow[s] * 1.1
            albedo = colours[s, k] * levels[textures[s], row, first + column, k] / 128.0
            out[n, k] = albedo * light + gloss[s] * shine * 0.5
    return out


def packed(textures: Bank) -> NDArray[np.uint8]:
    """All levels of the bank side by side, as ``shade`` wants them."""
    out = np.zeros((len(textures.levels[0]), SIDE, 2 * SIDE, 3), np.uint8)
    first = 0
    for level in textures.levels:
        side = level.shape[1]
        out[:, :side, first : first + side] = level
        first += side
    return out


# ------------------------------------------------------------------------------------------------ the map
@dataclass(frozen=True, slots=True)
class MapView:
    """The LiDAR map: points float32 [K, 3] and whether each is (said to be) wall, floor or ceiling [K]."""

    points: NDArray[np.float32]
    structural: NDArray[np.bool_]


def lidar_map(scene: Scene, mesh: Mesh, spots: NDArray[np.float64], rng: Rng) -> MapView:
    """Turns of a 16 to 64 ring LiDAR at spots [n, 2], merged into voxels; structure as an imperfect labeller says it."""
    rings = int(rng.choice([16, 32, 32, 48]))
    elevation = np.deg2rad(np.linspace(rng.uniform(-30, -15), rng.uniform(15, 55), rings))
    points, owners, parts = [], [], []
    height = rng.uniform(0.35, 0.9)
    for spot in spots:
        azimuth = np.arange(360) * (2 * np.pi / 360) + rng.uniform(0, 1)
        e, a = np.meshgrid(elevation, azimuth, indexing="ij")
        rays = np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], -1).reshape(-1, 3).astype(np.float32)
        origin = np.array([*spot, height], np.float32)
        far, triangle, _, _ = mesh.cast(np.broadcast_to(origin, rays.shape), rays)
        kept = (far > 0.25) & (far < 12) & (rng.random(len(far)) > 0.02)
        noisy = far[kept] + rng.normal(0, 0.012, int(kept.sum()))
        points.append(origin + rays[kept] * noisy[:, None])
        owners.append(scene.thing[triangle[kept]])
        parts.append(scene.part[triangle[kept]])
    xyz, owner, part = np.concatenate(points), np.concatenate(owners), np.concatenate(parts)
    drift = rng.normal(0, rng.choice([0.0, 0.01, 0.02]), 3) * np.array([1, 1, 0.3])
    xyz = xyz + drift
    _, first, member = np.unique(
        np.floor(xyz / VOXEL_M).astype(np.int64), axis=0, return_index=True, return_inverse=True
    )
    count = np.bincount(member.reshape(-1))
    mean = np.stack([np.bincount(member.reshape(-1), xyz[:, k]) / count for k in range(3)], -1)
    structural = np.isin(part[first], (WALL, FLOOR, CEILING))
    near = rng.uniform(0.02, 0.09)  # what is this near to a plane is swallowed by it
    x, y, z = mean.T
    plane = (z < near) | (z > scene.height_m - near)
    for x0, y0, x1, y1 in scene.rooms:
        plane |= (np.abs(x - x0) < near) | (np.abs(x - x1) < near) | (np.abs(y - y0) < near) | (np.abs(y - y1) < near)
    structural |= plane & (part[first] != NONE) | plane & (rng.random(len(mean)) < 0.7)
    wrong = rng.random(len(scene.names) + 1) < 0.06  # a wardrobe's side taken for a wall
    structural |= wrong[owner[first]] & (owner[first] > 0)
    centre, radius = mean[rng.integers(len(mean), size=4)], rng.uniform(0.2, 0.7, 4)
    for c, r in zip(centre, radius, strict=True):  # and patches of wall not recognised
        if rng.random() < 0.5:
            structural &= np.linalg.norm(mean - c, axis=1) > r
    return MapView(mean.astype(np.float32), structural)


# ------------------------------------------------------------------------------------------------ pictures
def free_spots(scene: Scene, count: int, rng: Rng, gap_m: float = 0.25) -> NDArray[np.float64]:
    """Places [n, 2] where a robot can stand, n <= count."""
    found = []
    for _ in range(count * 20):
        x0, y0, x1, y1 = scene.rooms[0] if rng.random() < 0.75 else scene.rooms[-1]
        spot = np.array([rng.uniform(x0 + 0.3, x1 - 0.3), rng.uniform(y0 + 0.3, y1 - 0.3)])
        low, high = scene.blocked[:, :2] - gap_m, scene.blocked[:, 2:] + gap_m
        if not ((spot > low) & (spot < high)).all(1).any():
            found.append(spot)
            if len(found) == count:
                break
    return np.array(found).reshape(-1, 2)


def look(spot, scene: Scene, rng: Rng) -> tuple[NDArray[np.float64], CameraModel]:
    """(map_T_camera, camera) of a robot there: level but for a few degrees, mostly facing into its room."""
    height = rng.uniform(0.4, 1.25)
    x0, y0, x1, y1 = min(scene.rooms, key=lambda r: abs((r[0] + r[2]) / 2 - spot[0]))
    aim = np.array([rng.uniform(x0, x1), rng.uniform(y0, y1)])
    yaw = np.arctan2(*(aim - spot)[::-1]) if rng.random() < 0.7 else rng.uniform(-np.pi, np.pi)
    pitch, roll = np.deg2rad(rng.normal(-4, 6)), np.deg2rad(rng.normal(0, 1.0))
    ahead = np.array([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), np.sin(pitch)])
    right = np.array([np.sin(yaw), -np.cos(yaw), 0.0])
    down = np.cross(ahead, right)
    right, down = np.cos(roll) * right + np.sin(roll) * down, np.cos(roll) * down - np.sin(roll) * right
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, down, ahead], 1)
    pose[:3, 3] = [*spot, height]
    focal = WIDTH / 2 / np.tan(np.deg2rad(rng.uniform(55, 90)) / 2)
    matrix = np.array([[focal, 0, (WIDTH - 1) / 2], [0, focal, (HEIGHT - 1) / 2], [0, 0, 1]])
    return pose, CameraModel("camera", WIDTH, HEIGHT, matrix, "plumb_bob", np.zeros(0))


@dataclass(frozen=True, slots=True)
class _Lit:
    """A scene's arrays for ``shade``."""

    normals: NDArray[np.float32]
    density: NDArray[np.float32]
    textures: NDArray[np.int32]
    colours: NDArray[np.float32]
    gloss: NDArray[np.float32]
    glow: NDArray[np.float32]
    lights: NDArray[np.float32]
    power: NDArray[np.float32]
    ambient: NDArray[np.float32]
    shadows: bool


def light(scene: Scene, rng: Rng) -> _Lit:
    """Point lights near the ceilings, of a warm or cold white, and light from all around."""
    edge0, edge1 = (scene.triangles[:, k] - scene.triangles[:, 0] for k in (1, 2))
    cross = np.cross(edge0, edge1)
    area = np.linalg.norm(cross, axis=1)
    flat0, flat1 = (scene.uv[:, k] - scene.uv[:, 0] for k in (1, 2))
    flat = np.abs(flat0[:, 0] * flat1[:, 1] - flat0[:, 1] * flat1[:, 0])
    count = int(rng.integers(1, 5))
    places = []
    for _ in range(count):
        x0, y0, x1, y1 = scene.rooms[int(rng.integers(len(scene.rooms)))]
        places.append([rng.uniform(x0, x1), rng.uniform(y0, y1), scene.height_m * rng.uniform(0.6, 0.97)])
    white = np.stack([1 + rng.normal(0, 0.12, count), np.ones(count), 1 + rng.normal(0, 0.12, count)], -1)
    strength = rng.uniform(0.2, 1.6, (count, 1))
    ambient = rng.uniform(0.15, 1.0) * (1 + rng.normal(0, 0.06, 3))
    return _Lit(
        (cross / np.maximum(area, 1e-12)[:, None]).astype(np.float32),
        np.sqrt(flat / np.maximum(area, 1e-9)).astype(np.float32),
        np.array([s.texture for s in scene.surfaces], np.int32),
        np.array([s.colour for s in scene.surfaces], np.float32),
        np.array([s.gloss for s in scene.surfaces], np.float32),
        np.clip(np.array([s.glow for s in scene.surfaces], np.float32), 0, 0.95),
        np.array(places, np.float32),
        (white * strength).astype(np.float32),
        ambient.astype(np.float32),
        bool(rng.random() < 0.5),
    )  # fmt: skip


def expose(scene: Scene, mesh: Mesh, lit: _Lit, levels, pose, camera: CameraModel, rng: Rng):
    """(rgb uint8 [H, W, 3], thing [H, W], part [H, W], depth float32 [H, W]) of a camera."""
    k = 2 if rng.random() < 0.35 else 1  # rays per pixel along each side
    u, v = np.meshgrid((np.arange(WIDTH * k) + 0.5) / k - 0.5, (np.arange(HEIGHT * k) + 0.5) / k - 0.5)
    focal = camera.matrix[0, 0]
    rays = np.stack(
        [(u - camera.matrix[0, 2]) / focal, (v - camera.matrix[1, 2]) / focal, np.ones_like(u)], -1
    ).reshape(-1, 3)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    along = rays[:, 2].astype(np.float32)
    world = (rays @ pose[:3, :3].T).astype(np.float32)
    origin = pose[:3, 3].astype(np.float32)
    far, triangle, bu, bv = mesh.cast(np.broadcast_to(origin, world.shape), world)
    shadow = np.zeros(len(far), np.bool_)
    if lit.shadows:
        seen = np.where(triangle >= 0, far, 0)[:, None] * world + origin
        way = lit.lights[0] - seen
        length = np.linalg.norm(way, axis=1, keepdims=True)
        way = (way / np.maximum(length, 1e-6)).astype(np.float32)
        block, _, _, _ = mesh.cast((seen + 0.01 * way).astype(np.float32), way)
        shadow = block < length[:, 0] - 0.05
    look_of = (lit.textures, lit.colours, lit.gloss, lit.glow, levels)
    shape = (lit.normals, scene.uv, lit.density, scene.surface)
    lamps = (lit.lights, lit.power, shadow, lit.ambient)
    rgb = shade(far, triangle, bu, bv, world, *shape, *look_of, *lamps, np.float32(1 / focal / k), origin)
    picture = rgb.reshape(HEIGHT, k, WIDTH, k, 3).mean((1, 3))
    bright = max(float(np.quantile(picture, 0.92)), 0.05)
    picture = np.clip(picture / bright * rng.uniform(150, 265), 0, 255).astype(np.uint8)
    one = triangle.reshape(HEIGHT, k, WIDTH, k)[:, 0, :, 0]
    thing, part = np.where(one < 0, 0, scene.thing[one]), np.where(one < 0, WALL, scene.part[one])
    depth = (far * along).reshape(HEIGHT, k, WIDTH, k)[:, 0, :, 0]
    return picture, thing, part.astype(np.uint8), depth


def render_scene(seed: int, frames: int, textures: Bank, levels, models) -> dict[str, np.ndarray] | None:
    """All that is kept of a scene; None when nothing worth keeping was seen."""
    rng = np.random.default_rng(seed)
    scene = make_scene(textures, models, rng)
    mesh, lit = Mesh(scene.triangles), light(scene, rng)
    spots = free_spots(scene, int(rng.integers(2, 14)), rng)
    places = free_spots(scene, frames * 3, rng, 0.15)
    if not len(spots) or not len(places):
        return None
    view_of = lidar_map(scene, mesh, spots, rng)
    kept: dict[str, list] = {
        key: [] for key in ("jpeg", "jpeg_len", "thing", "part", "depth", "pixel", "pixel_len", "pose", "matrix")
    }
    settings = LiftSettings()
    for place in places:
        if len(kept["pose"]) == frames:
            break
        pose, camera = look(place, scene, rng)
        picture, thing, part, depth = expose(scene, mesh, lit, levels, pose, camera, rng)
        sizes = np.bincount(thing.reshape(-1))[1:]
        if (
            (sizes >= 100).sum() < (1 if rng.random() < 0.2 else 2)
            or np.median(depth) < 0.5
            or sizes.max() > 0.75 * thing.size
        ):
            continue
        view = CameraView(0, pose, camera, None, None)
        index, pixel, depth_m = points_in_sight(view, view_of.points, settings)
        kept["pixel"].append(np.column_stack([pixel, depth_m, view_of.structural[index]]).astype(np.float16))
        kept["pixel_len"].append(len(index))
        good, blob = cv2.imencode(".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 96])
        assert good
        kept["jpeg"].append(blob.reshape(-1))
        kept["jpeg_len"].append(len(blob))
        kept["thing"].append(thing.astype(np.uint16))
        kept["part"].append(part)
        kept["depth"].append(np.clip(depth[::2, ::2] * 1000, 0, 60000).astype(np.uint16))
        kept["pose"].append(pose)
        kept["matrix"].append(camera.matrix)
    if not kept["pose"]:
        return None
    joined = {key: np.concatenate(value) for key, value in kept.items() if key in ("jpeg", "pixel")}
    stacked = {key: np.array(value) for key, value in kept.items() if key not in joined}
    return joined | stacked | {"names": np.array(scene.names)}


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--scenes", type=int, default=1000)
    parser.add_argument("--frames", type=int, default=8)
    parser.add_argument("--out", type=Path, required=True)
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    models, pictures = catalogue(arguments.out.parent / _CACHE)
    for number in range(arguments.seed, arguments.seed + arguments.scenes):
        if (number - arguments.seed) % 40 == 0:  # other textures now and then
            textures = bank(np.random.default_rng([7, number]), pictures)
            levels = packed(textures)
        path = arguments.out / f"scene_{number:06d}.npz"
        if path.exists():
            continue
        found = render_scene(number, arguments.frames, textures, levels, models)
        if found is not None:
            part = path.with_suffix(".part.npz")
            np.savez_compressed(part, **found)
            part.rename(path)


if __name__ == "__main__":
    main()
