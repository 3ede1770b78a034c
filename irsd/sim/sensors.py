"""The robot's LiDAR and camera: rays into the mesh, noise, and a sweep whose every column is seen from its own instant."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from irsd.core.geometry import Pose, pose_from_xy_yaw
from irsd.core.types import CameraImage, CameraModel, LidarScan, StaticTransform
from irsd.sim.building import Body, Building
from irsd.sim.raycast import Hits, RayScene

LIDAR_FRAME, CAMERA_LINK, CAMERA_FRAME = "lidar", "camera_link", "camera_optical"
T = TypeVar("T", bound=np.generic)
_MAX_RANGE_M, _MIN_RANGE_M = 30.0, 0.25
_SUN = np.array([0.35, 0.5, 0.79])


@dataclass(frozen=True, slots=True)
class LidarSettings:
    """A spinning LiDAR. rings are spread evenly between the elevations; columns per turn; drop_share of returns is lost."""

    rings: int = 32
    columns: int = 240
    low_rad: float = float(np.deg2rad(-25))
    high_rad: float = float(np.deg2rad(50))
    period_s: float = 0.2
    noise_m: float = 0.015
    drop_share: float = 0.005


@dataclass(frozen=True, slots=True)
class CameraSettings:
    """A pinhole camera. shrink: rays are cast for every shrink-th pixel in both directions and the picture is enlarged."""

    width_px: int = 640
    height_px: int = 480
    fov_rad: float = float(np.deg2rad(75))
    shrink: int = 2
    noise_levels: float = 2.5

    def model(self) -> CameraModel:
        """The calibration, without distortion; pixel centres are at whole numbers."""
        focal = self.width_px / 2 / np.tan(self.fov_rad / 2)
        cx, cy = (self.width_px - 1) / 2, (self.height_px - 1) / 2
        matrix = np.array([[focal, 0, cx], [0, focal, cy], [0, 0, 1.0]])
        return CameraModel(CAMERA_FRAME, self.width_px, self.height_px, matrix, "plumb_bob", np.zeros(5))


def mountings() -> tuple[StaticTransform, ...]:
    """base_link -> lidar, base_link -> camera_link (5 degrees nose down) -> camera_optical (z ahead, x right, y down)."""
    lidar = pose_from_xy_yaw(0.0, 0.0, 0.0, 0.6)
    c, s = np.cos(np.deg2rad(5)), np.sin(np.deg2rad(5))
    link = np.array([[c, 0, s, 0.15], [0, 1, 0, 0], [-s, 0, c, 0.9], [0, 0, 0, 1.0]])
    optical = np.array([[0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1.0]])
    return (
        StaticTransform("base_link", LIDAR_FRAME, lidar),
        StaticTransform("base_link", CAMERA_LINK, link),
        StaticTransform(CAMERA_LINK, CAMERA_FRAME, optical),
    )


@dataclass(frozen=True, slots=True)
class Exposure:
    """A picture and what is truly in it.

    ids_px: uint16 [H, W] Thing.id (0 = nothing); depth_m: float32 [h, w] z at the pixels that were cast.
    """

    image: CameraImage
    ids_px: NDArray[np.uint16]
    depth_m: NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Sweep:
    """A turn of the LiDAR: the scan as measured, intensity float32 [N] 0..255, thing: int32 [N] Thing.id of each return."""

    scan: LidarScan
    intensity: NDArray[np.float32]
    thing: NDArray[np.int32]


@dataclass(slots=True)
class _Walker:
    """Somebody who walks by: a body about the origin, where they are, and the number of their first triangle."""

    thing_id: int
    body: Body
    scene: RayScene
    place_m: NDArray[np.float32] = field(default_factory=lambda: np.zeros(3, np.float32))
    first: int = 0


class Eyes:
    """Casts the sensors' rays into one building."""

    def __init__(self, building: Building, lidar: LidarSettings, camera: CameraSettings) -> None:
        self.lidar, self.camera = lidar, camera
        self.camera_model = camera.model()
        self._walkers: dict[int, _Walker] = {}
        self.renew(building)
        self._pixel_rays = _pixel_rays(camera, self.camera_model)
        mounts = {mount.child: mount.parent_T_child for mount in mountings()}
        self._base_T_lidar = mounts[LIDAR_FRAME]
        self._base_T_camera = mounts[CAMERA_LINK] @ mounts[CAMERA_FRAME]
        self._elevation = np.linspace(lidar.low_rad, lidar.high_rad, lidar.rings)

    def renew(self, building: Building) -> None:
        """What stands in the building has changed."""
        self._scene = RayScene(building.triangles)
        self._thing = building.thing
        self._normal = _normals(building.triangles)
        self._colour = building.colour.astype(np.float32)
        for walker in self._walkers.values():
            self._append(walker)

    def show(self, thing_id: int, body: Body, place_xy: NDArray[np.float64] | None) -> None:
        """Somebody who walks by is at place_xy [2] now; None: no longer here."""
        if place_xy is None:
            self._walkers.pop(thing_id, None)
            return
        walker = self._walkers.get(thing_id)
        if walker is None:
            walker = _Walker(thing_id, body, RayScene(body.triangles))
            self._walkers[thing_id] = walker
            self._append(walker)
        walker.place_m = np.array([*place_xy, 0.0], np.float32)

    def _append(self, walker: _Walker) -> None:
        """A walker's surfaces behind those of the building."""
        walker.first = len(self._thing)
        self._thing = np.append(self._thing, np.full(len(walker.body.triangles), walker.thing_id, np.int32))
        self._normal = np.concatenate([self._normal, _normals(walker.body.triangles)])
        self._colour = np.concatenate([self._colour, walker.body.colour.astype(np.float32)])

    def _cast(self, origins: NDArray[np.float32], directions: NDArray[np.float32]) -> Hits:
        """First hits on the building or on whoever walks by."""
        hits = self._scene.cast(origins, directions)
        for walker in self._walkers.values():
            own = walker.scene.cast(origins - walker.place_m, directions)
            nearer = own.range_m < hits.range_m
            hits = Hits(
                np.where(nearer, own.range_m, hits.range_m),
                np.where(nearer, own.triangle + np.int32(walker.first), hits.triangle),
            )
        return hits

    def column_times_s(self) -> NDArray[np.float64]:
        """[columns] seconds after the turn's start at which each column is measured."""
        return np.arange(self.lidar.columns, dtype=np.float64) * (self.lidar.period_s / self.lidar.columns)

    def sweep(
        self, stamp_ns: int, world_xy_yaw: NDArray[np.float64], phase_rad: float, rng: np.random.Generator
    ) -> Sweep:
        """One turn, counter-clockwise from phase_rad. world_xy_yaw: float64 [columns, 3], the robot's true pose at each column."""
        settings = self.lidar
        azimuth = phase_rad + np.arange(settings.columns) * (2 * np.pi / settings.columns)
        ce, se = np.cos(self._elevation)[:, None], np.sin(self._elevation)[:, None]
        shape = (settings.rings, settings.columns)
        local = np.stack([ce * np.cos(azimuth), ce * np.sin(azimuth), np.broadcast_to(se, shape)], -1)
        heading = azimuth + world_xy_yaw[:, 2]
        world = np.stack([ce * np.cos(heading), ce * np.sin(heading), np.broadcast_to(se, shape)], -1)
        # The LiDAR stands above the robot's middle, so turning does not move it.
        origin = np.column_stack([world_xy_yaw[:, :2], np.full(settings.columns, self._base_T_lidar[2, 3])])
        directions = world.reshape(-1, 3).astype(np.float32)
        hits = self._cast(np.tile(origin, (settings.rings, 1)).astype(np.float32), directions)
        kept = (
            (hits.range_m > _MIN_RANGE_M)
            & (hits.range_m < _MAX_RANGE_M)
            & (rng.random(len(directions)) >= settings.drop_share)
        )
        measured = hits.range_m[kept] + rng.normal(0, settings.noise_m, int(kept.sum()))
        points = (local.reshape(-1, 3)[kept] * measured[:, None]).astype(np.float32)
        triangle = hits.triangle[kept]
        incidence = np.abs((self._normal[triangle] * directions[kept]).sum(1))
        intensity = np.clip(self._colour[triangle].mean(1) * (0.35 + 0.65 * incidence), 0, 255).astype(np.float32)
        times = np.broadcast_to(self.column_times_s(), shape).reshape(-1)[kept].astype(np.float32)
        return Sweep(LidarScan(stamp_ns, LIDAR_FRAME, points, times), intensity, self._thing[triangle])

    def expose(self, stamp_ns: int, world_T_base: Pose, rng: np.random.Generator) -> Exposure:
        """One picture, with simple shading and pixel noise."""
        world_T_camera = world_T_base @ self._base_T_camera
        height, width = self.camera.height_px // self.camera.shrink, self.camera.width_px // self.camera.shrink
        directions = self._pixel_rays @ world_T_camera[:3, :3].T.astype(np.float32)
        origin = np.broadcast_to(world_T_camera[:3, 3].astype(np.float32), directions.shape)
        hits = self._cast(origin, directions)
        missed = hits.triangle < 0
        triangle = np.where(missed, 0, hits.triangle)
        facing = np.abs(np.einsum("ij,ij->i", self._normal[triangle], directions))
        shade = (0.72 + 0.28 * facing) * _pattern(origin, directions, hits.range_m, self._normal[triangle])
        light = 0.8 + 0.25 * np.maximum(self._normal @ _SUN.astype(np.float32), 0)
        lit = self._colour * light[:, None]
        rgb = np.where(missed[:, None], np.float32(235.0), lit[triangle] * shade[:, None])
        rgb += rng.normal(0, self.camera.noise_levels, (len(rgb), 1)).astype(np.float32)
        bgr = np.clip(rgb[:, ::-1], 0, 255).astype(np.uint8).reshape(height, width, 3)
        full = cv2.resize(bgr, (self.camera.width_px, self.camera.height_px), interpolation=cv2.INTER_LINEAR)
        ids = np.where(missed, 0, self._thing[triangle]).astype(np.uint16).reshape(height, width)
        depth = (hits.range_m * self._pixel_rays[:, 2]).reshape(height, width)
        return Exposure(CameraImage(stamp_ns, CAMERA_FRAME, np.asarray(full, np.uint8)), self._enlarged(ids), depth)

    def _enlarged(self, pixels: NDArray[T]) -> NDArray[T]:
        k = self.camera.shrink
        return np.ascontiguousarray(pixels.repeat(k, 0).repeat(k, 1))


def _normals(triangles: NDArray[np.float32]) -> NDArray[np.float32]:
    """Unit normals [T, 3]."""
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    return np.asarray(normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12), np.float32)


def _pixel_rays(camera: CameraSettings, model: CameraModel) -> NDArray[np.float32]:
    """Unit directions [h*w, 3] in the optical frame through the middles of the shrink x shrink pixel blocks."""
    k = camera.shrink
    u = np.arange(camera.width_px // k) * k + (k - 1) / 2
    v = np.arange(camera.height_px // k) * k + (k - 1) / 2
    gu, gv = np.meshgrid((u - model.matrix[0, 2]) / model.matrix[0, 0], (v - model.matrix[1, 2]) / model.matrix[1, 1])
    rays = np.stack([gu, gv, np.ones_like(gu)], -1).reshape(-1, 3)
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True), np.float32)


def _pattern(
    origin: NDArray[np.float32],
    directions: NDArray[np.float32],
    range_m: NDArray[np.float32],
    normal: NDArray[np.float32],
) -> NDArray[np.float32]:
    """Brightness factor [N]: boards on what faces up, faint stripes elsewhere, so that pictures have texture."""
    near = np.where(np.isfinite(range_m), range_m, np.float32(0))
    x = origin[:, 0] + directions[:, 0] * near
    y = origin[:, 1] + directions[:, 1] * near
    boards = ((np.floor(x * 6.0) + np.floor(y * 0.8)) % 2).astype(np.float32)
    return np.where(normal[:, 2] > 0.5, 0.93 + 0.09 * boards, np.float32(1.0)).astype(np.float32)
