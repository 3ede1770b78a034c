"""From numbered masks in a picture to masks of map points: projection, occlusion, uncertain edges, structure, floating points.

Kernels: pure functions over arrays, no state. The depth of a pixel is that of the LiDAR map: its voxels are drawn into a
coarse depth image as squares of their own size, and a voxel counts as seen when it is not behind what is drawn there.

Floating points are removed by connected components of occupied cells (edge ``link_m``, 26 neighbours). That equals DBSCAN with
min_pts = 1 and a Chebyshev radius between one and two cells; density plays no part because map points are voxels already.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from irsd.core.geometry import Pose, invert
from irsd.core.jit import kernel
from irsd.core.settings import setting
from irsd.core.types import CameraModel, CameraView, Detections, Structure
from irsd.instances.settle import large_parts

Floats = NDArray[np.float32]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

_NEAR_M = 0.15  # closer points are the robot itself
_FAR = np.float32(1e9)  # depth of a cell in which nothing is drawn
_MAX_SPLAT = 4  # half width in cells; larger only where a point is nearer than the robot's own size


@dataclass(frozen=True)
class LiftSettings:
    """Settings of lifting masks to 3D."""

    max_range_m: float = setting(8.0, "map points farther from the camera are not used", lo=0.5, hi=100.0)
    cell_px: int = setting(4, "edge of a cell of the depth image in pixels of the picture", lo=1, hi=32)
    splat_m: float = setting(0.06, "edge of the square that a map point covers in the depth image", lo=0.0, hi=0.5)
    depth_tolerance_m: float = setting(0.10, "a point this far behind the drawn surface is still seen", lo=0.0, hi=2.0)
    edge_px: float = setting(4.0, "points nearer than this to a mask's edge are uncertain", lo=0.0, hi=50.0)
    edge_share: float = setting(0.35, "never more of a mask's half width than this is uncertain", lo=0.0, hi=1.0)
    flat_share: float = setting(
        0.7, "a mask with this share of wall, floor or ceiling points is a flat thing", lo=0.0, hi=1.0
    )
    link_m: float = setting(0.10, "edge of the cells whose touching joins points", lo=0.01, hi=1.0)
    keep_share: float = setting(
        0.2, "parts smaller than this share of the largest part are floating points", lo=0.0, hi=1.0
    )
    min_cover: float = setting(0.15, "least share of a mask's pixels that its map points account for", lo=0.0, hi=1.0)
    min_points: int = setting(3, "masks with fewer points are not lifted", lo=1, hi=1000)


@dataclass(frozen=True, slots=True)
class LiftedMask:
    """One detection as map points: points_map float32 [n, 3]; flat = it lies within a structure's plane.

    labels: (name, score) best first; embedding: float32 [D] unit length as the detector gave it, or None; measured: it is of this
    picture, not what was known already.
    """

    number: int
    points_map: Floats
    labels: tuple[tuple[str, float], ...]
    score: float
    embedding: Floats | None
    flat: bool
    measured: bool = True


@dataclass(frozen=True, slots=True)
class LiftedView:
    """All lifted masks of one picture, in the order of their numbers, and what else was certainly seen.

    seen_map: float32 [V, 3], the map points that the camera saw away from uncertain mask edges, in a mask or not: where a
    known instance is absent from its mask, this is the evidence against it. trimmed: uncertain edges were left out of the masks.
    Iterating gives the masks.
    """

    stamp_ns: int
    masks: tuple[LiftedMask, ...]
    seen_map: Floats
    trimmed: bool = True

    def __iter__(self) -> Iterator[LiftedMask]:
        return iter(self.masks)

    def __len__(self) -> int:
        return len(self.masks)


def lift(view: CameraView, points_map: Floats, structure: NDArray[np.uint8], settings: LiftSettings) -> LiftedView:
    """The detections of a picture as masks of map points.

    points_map: float32 [K, 3] map voxels that may be in view; structure: uint8 [K] of ``Structure``. A view without
    detections gives an empty result.
    """
    detections = view.detections
    empty = LiftedView(view.stamp_ns, (), np.zeros((0, 3), np.float32))
    if detections is None or not len(points_map):
        return empty
    index, pixel, depth = points_in_sight(view, points_map, settings)
    if not len(index):
        return empty
    hw = (view.camera.height_px, view.camera.width_px)
    focal_px = float(view.camera.matrix[0, 0])
    number, certain = mask_of_points(detections.ids_px, pixel, hw, settings)
    if detections.unsure_px is not None:
        column, row = np.clip(np.round(pixel).astype(np.int64), 0, (hw[1] - 1, hw[0] - 1)).T
        certain &= (number > 0) | ~detections.unsure_px[row, column]
    points, labels = points_map[index], structure[index]
    # A point stands for the pixels of its own size; a mask that its points can't account for is out of the map's sight.
    point_px = (settings.splat_m * focal_px / depth) ** 2
    mask_px = pixel_counts(detections.ids_px, int(detections.number.max(initial=0)) + 1)
    masks = []
    inside = np.flatnonzero(certain & (number > 0))
    inside = inside[np.argsort(number[inside], kind="stable")]
    of_mask = number[inside]
    for k in np.argsort(detections.number, kind="stable").tolist():
        first, end = np.searchsorted(of_mask, [detections.number[k], int(detections.number[k]) + 1])
        mine = inside[first:end]
        mine, flat = object_points(points, labels, mine, settings)
        covered_px = point_px[mine].sum()
        if len(mine) >= settings.min_points and covered_px >= settings.min_cover * mask_px[detections.number[k]]:
            masks.append(_mask(detections, k, points[mine], flat))
    return LiftedView(view.stamp_ns, tuple(masks), points[certain])


def points_in_sight(
    view: CameraView, points_map: Floats, settings: LiftSettings
) -> tuple[Ints, NDArray[np.float64], NDArray[np.float64]]:
    """Which map points the camera sees, none hidden behind others: (index [M], pixel (u, v) float64 [M, 2], depth_m [M])."""
    index, pixel, depth = project(points_map, view.map_T_camera, view.camera, settings.max_range_m)
    if not len(index):
        return index, pixel, depth
    hw, focal_px = (view.camera.height_px, view.camera.width_px), float(view.camera.matrix[0, 0])
    seen = unoccluded(pixel, depth, hw, focal_px, settings)
    return index[seen], pixel[seen], depth[seen]


def _mask(detections: Detections, k: int, points: Floats, flat: bool) -> LiftedMask:
    score = float(detections.score[k])
    labels = detections.top_labels[k] or ((detections.label[k], score),)
    embedding = None if detections.embedding is None else detections.embedding[k]
    measured = detections.measured is None or bool(detections.measured[k])
    return LiftedMask(int(detections.number[k]), points, labels, score, embedding, flat, measured)


# ------------------------------------------------------------------------------------------------------------ kernels
def project(
    points_map: Floats, map_T_camera: Pose, camera: CameraModel, max_range_m: float
) -> tuple[Ints, NDArray[np.float64], NDArray[np.float64]]:
    """Which points fall into the picture: (index [M], pixel (u, v) float64 [M, 2], depth along the optical axis [M])."""
    camera_T_map = np.ascontiguousarray(invert(map_T_camera), np.float64)
    matrix = np.ascontiguousarray(camera.matrix, np.float64)
    index, points, pixel = pinhole(np.ascontiguousarray(points_map, np.float32), camera_T_map, matrix, max_range_m)
    size_wh = np.array([camera.width_px, camera.height_px])
    if camera.distortion.any() and len(index):
        # A distortion polynomial folds far-off rays back into the picture, so they are cut before it is applied.
        wide = ((pixel > -0.5 * size_wh) & (pixel < 1.5 * size_wh)).all(-1)
        if camera.model == "equidistant":
            wide = np.ones(len(index), np.bool_)
        index, points = index[wide], points[wide]
        pixel = _distorted(points, camera)
    inside = ((pixel > -0.5) & (pixel < size_wh - 0.5)).all(-1)
    return index[inside], pixel[inside], points[inside, 2]


@kernel
def pinhole(
    points_map: Floats, camera_T_map: NDArray[np.float64], matrix: NDArray[np.float64], max_range_m: float
) -> tuple[Ints, NDArray[np.float64], NDArray[np.float64]]:
    """Points ahead of the camera and in range: (index [M], in the optical frame [M, 3], pixel (u, v) [M, 2] without distortion)."""
    index, n = np.empty(len(points_map), np.int64), 0
    points, pixel = np.empty((len(points_map), 3)), np.empty((len(points_map), 2))
    for p in range(len(points_map)):
        x, y, z = float(points_map[p, 0]), float(points_map[p, 1]), float(points_map[p, 2])
        a = camera_T_map[0, 0] * x + camera_T_map[0, 1] * y + camera_T_map[0, 2] * z + camera_T_map[0, 3]
        b = camera_T_map[1, 0] * x + camera_T_map[1, 1] * y + camera_T_map[1, 2] * z + camera_T_map[1, 3]
        c = camera_T_map[2, 0] * x + camera_T_map[2, 1] * y + camera_T_map[2, 2] * z + camera_T_map[2, 3]
        if c > _NEAR_M and a * a + b * b + c * c < max_range_m * max_range_m:
            index[n] = p
            points[n, 0], points[n, 1], points[n, 2] = a, b, c
            pixel[n, 0], pixel[n, 1] = a / c * matrix[0, 0] + matrix[0, 2], b / c * matrix[1, 1] + matrix[1, 2]
            n += 1
    return index[:n], points[:n], pixel[:n]


@kernel
def pixel_counts(ids_px: NDArray[np.uint16], count: int) -> Ints:
    """int64 [count]: how many pixels of ids_px [H, W] hold each number; higher numbers are not counted."""
    out = np.zeros(count, np.int64)
    for row in range(ids_px.shape[0]):
        for column in range(ids_px.shape[1]):
            number = ids_px[row, column]
            if number < count:
                out[number] += 1
    return out


@kernel
def inner_pixels(ids_px: NDArray[np.uint16]) -> tuple[NDArray[np.uint8], bool]:
    """(uint8 [H, W], 0 where a neighbour to the side, above or below has another number, else 1; whether any is 0)."""
    rows, columns = ids_px.shape
    out, edges = np.ones((rows, columns), np.uint8), False
    for row in range(rows):
        for column in range(columns):
            if column + 1 < columns and ids_px[row, column] != ids_px[row, column + 1]:
                out[row, column] = out[row, column + 1] = 0
                edges = True
            if row + 1 < rows and ids_px[row, column] != ids_px[row + 1, column]:
                out[row, column] = out[row + 1, column] = 0
                edges = True
    return out, edges


def _distorted(points: NDArray[np.float64], camera: CameraModel) -> NDArray[np.float64]:
    """Pixels [M, 2] of points [M, 3] in the camera frame through the lens model."""
    if not len(points):
        return np.zeros((0, 2))
    zero = np.zeros(3)
    if camera.model == "equidistant":
        pixel, _ = cv2.fisheye.projectPoints(points[:, None], zero, zero, camera.matrix, camera.distortion[:4])
    else:
        pixel, _ = cv2.projectPoints(points, zero, zero, camera.matrix, camera.distortion)
    return np.asarray(pixel, np.float64).reshape(-1, 2)


def unoccluded(
    pixel: NDArray[np.float64], depth: NDArray[np.float64], hw: tuple[int, int], focal_px: float, settings: LiftSettings
) -> Bools:
    """[M] True where a point (pixel [M, 2], depth [M] metres) is at or in front of the surface drawn by all points."""
    cell = settings.cell_px
    rows, cols = -(-hw[0] // cell), -(-hw[1] // cell)
    col, row = np.floor((pixel + 0.5) / cell).astype(np.int64).T
    flat = row * cols + col
    half = np.clip(np.round(0.5 * settings.splat_m * focal_px / depth / cell), 0, _MAX_SPLAT).astype(np.int64)
    # One layer per splat size: draw the points, then let a minimum filter of that size widen them all at once.
    layers = np.full((_MAX_SPLAT + 1, rows, cols), _FAR, np.float32)
    np.minimum.at(layers.reshape(-1), half * (rows * cols) + flat, depth.astype(np.float32))
    wide = [cv2.erode(layer, np.ones((2 * r + 1, 2 * r + 1), np.uint8)) for r, layer in enumerate(layers)]
    front = np.min(wide, axis=0).reshape(-1)
    return np.asarray(depth <= front[flat] + settings.depth_tolerance_m)


def mask_of_points(
    ids_px: NDArray[np.uint16], pixel: NDArray[np.float64], hw: tuple[int, int], settings: LiftSettings
) -> tuple[Ints, Bools]:
    """(detection number [M] at each point's pixel, whether the point is certain: not near a mask's edge).

    Inside a mask the uncertain edge is at most ``edge_share`` of the mask's largest half width, so thin and small masks
    keep points; outside of masks it is ``edge_px``. The picture's own border is not an edge.
    """
    col, row = np.round(pixel).astype(np.int64).T
    col, row = np.clip(col, 0, hw[1] - 1), np.clip(row, 0, hw[0] - 1)
    distance = edge_distance(ids_px)
    number = ids_px[row, col].astype(np.int64)
    # Half widths from every second pixel of every second row: a pixel more or less does not matter here.
    sample, inner = ids_px[::2, ::2], distance[::2, ::2]
    half_width = np.zeros(int(ids_px.max(initial=0)) + 1, np.float32)
    np.maximum.at(half_width, sample[sample > 0], inner[sample > 0])
    band = np.minimum(settings.edge_px, settings.edge_share * half_width)
    band[0] = settings.edge_px
    return number, np.asarray(distance[row, col] > band[number])


def edge_distance(ids_px: NDArray[np.uint16]) -> NDArray[np.float32]:
    """float32 [H, W]: pixels to the nearest place where the number changes (0.5 beside it), large where it never does."""
    inner, edges = inner_pixels(np.ascontiguousarray(ids_px))
    if not edges:
        return np.full(ids_px.shape, float(sum(ids_px.shape)), np.float32)
    return np.asarray(cv2.distanceTransform(inner, cv2.DIST_L2, 3), np.float32) + np.float32(0.5)


def object_points(
    points: Floats, structure: NDArray[np.uint8], mine: Ints, settings: LiftSettings
) -> tuple[Ints, bool]:
    """Those of the point indices ``mine`` that are the object's, and whether it is flat: no structure, nothing floating."""
    keep, flat = without_structure(structure[mine], settings.flat_share)
    mine = mine[keep]
    return mine[main_parts(points[mine], settings.link_m, settings.keep_share)], flat


def without_structure(structure: NDArray[np.uint8], flat_share: float) -> tuple[Bools, bool]:
    """(which points [n] may join an object, whether the mask is a flat thing).

    Walls, floors and ceilings never join an object, except where nearly all of a mask is structure: then it is something
    that lies within the plane (a picture, a screen, a curtain, a rug) and its points are the object.
    """
    is_structure = structure != Structure.OTHER
    if len(structure) and is_structure.mean() >= flat_share:
        return np.ones(len(structure), np.bool_), True
    return ~is_structure, False


def main_parts(points: Floats, link_m: float, keep_share: float) -> Ints:
    """Indices of points [n, 3] in connected parts that hold at least keep_share of the largest part's points."""
    return np.flatnonzero(large_parts(points, link_m, keep_share))
