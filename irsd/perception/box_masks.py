"""Masks of boxes from the map's depth, for a chain without a segmenter: what hangs together in depth in the middle of the box.

The map's points are drawn into a coarse depth picture. Within a box, cells without a point take the depth of the nearest cell that
has one; neighbouring cells are joined unless their depths differ by more than a step; the joined part that holds most of the box's
middle is the mask. Walls, floors and ceilings, where they are known, cut too: depth alone does not part a table from the floor it
stands on. A box that is nearly all of them is a flat thing (a picture, a rug) and keeps them. Pure functions.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from irsd.core.settings import setting
from irsd.perception.roles import Masks

Floats = NDArray[np.float32]
Bools = NDArray[np.bool_]
_MIDDLE_SHARE = 0.25  # standard deviation of the weight that falls off from the box's middle, in sizes of the box


@dataclass(frozen=True)
class BoxMaskSettings:
    """Masks of boxes by depth."""

    cell_px: int = setting(4, "edge of a cell of the depth picture in pixels", lo=1, hi=32)
    step_m: float = setting(
        0.15, "neighbouring cells whose depths differ by more are not of one thing", lo=0.01, hi=2.0
    )
    step_share: float = setting(0.05, "the same as a share of the depth; the larger counts", lo=0.0, hi=1.0)
    reach_px: int = setting(40, "a place farther from all map points is of unknown depth", lo=1, hi=200)
    flat_share: float = setting(
        0.7, "a box with this share of walls, floors and ceilings is a flat thing", lo=0.0, hi=1.0
    )


@dataclass(frozen=True, slots=True)
class DepthPicture:
    """The nearest map point per cell: depth_m float32 [rows, cols], inf where none is near; structural bool [rows, cols], it is part
    of a wall, a floor or a ceiling. A cell is ``cell_px`` pixels wide and high; the last ones may reach over the picture's edge."""

    depth_m: Floats
    structural: Bools
    cell_px: int


def draw_depth(
    pixel: Floats, depth_m: Floats, structural: Bools, hw: tuple[int, int], settings: BoxMaskSettings
) -> DepthPicture:
    """Map points in view, pixel float32 [M, 2] (u, v), depth_m float32 [M], structural bool [M], of a picture of (height, width).

    Each cell has the depth of its nearest point, or that of the nearest cell with one, as far as ``reach_px``.
    """
    cell = settings.cell_px
    shape = -(-hw[0] // cell), -(-hw[1] // cell)
    depth, flat = np.full(shape, np.inf, np.float32), np.zeros(shape, np.bool_)
    column, row = np.floor((pixel.reshape(-1, 2) + 0.5) / cell).astype(np.int64).T
    inside = (row >= 0) & (row < shape[0]) & (column >= 0) & (column < shape[1])
    row, column, depth_m, structural = row[inside], column[inside], depth_m[inside], structural[inside]
    order = np.argsort(-depth_m, kind="stable")  # the nearest is written last
    depth[row[order], column[order]] = depth_m[order]
    flat[row[order], column[order]] = structural[order]
    empty = ~np.isfinite(depth)
    if empty.all() or not empty.any():
        return DepthPicture(depth, flat, cell)
    away, (near_row, near_column) = distance_transform_edt(empty, return_indices=True)
    near = away * cell <= settings.reach_px
    filled = np.where(near, depth[near_row, near_column], np.float32(np.inf))
    return DepthPicture(filled.astype(np.float32), near & flat[near_row, near_column], cell)


def masks_of_boxes(boxes_px: Floats, picture: DepthPicture, hw: tuple[int, int], settings: BoxMaskSettings) -> Masks:
    """One mask bool [H, W] per box float32 [n, 4], in their order, none larger than its box.

    scores: the share of the box that is of known depth; where that is nothing the mask is the box.
    """
    masks, scores = np.zeros((len(boxes_px), *hw), np.bool_), np.zeros(len(boxes_px), np.float32)
    limit = np.array([hw[1], hw[0]] * 2)
    for k, box in enumerate(np.clip(np.round(boxes_px), 0, limit).astype(np.int64).tolist()):
        x0, y0, x1, y1 = box
        if x1 <= x0 or y1 <= y0:
            continue
        cell = picture.cell_px
        rows, columns = slice(y0 // cell, -(-y1 // cell)), slice(x0 // cell, -(-x1 // cell))
        depth, structural = picture.depth_m[rows, columns], picture.structural[rows, columns]
        known = np.isfinite(depth)
        scores[k] = known.mean()
        part = main_part(depth, known & ~_to_drop(structural, known, settings), settings) if known.any() else ~known
        pixels = cv2.resize(part.view(np.uint8), None, fx=cell, fy=cell, interpolation=cv2.INTER_NEAREST).view(np.bool_)
        top, left = y0 - rows.start * cell, x0 - columns.start * cell
        masks[k, y0:y1, x0:x1] = pixels[top : top + y1 - y0, left : left + x1 - x0]
    return Masks(masks, scores)


def main_part(depth_m: Floats, usable: Bools, settings: BoxMaskSettings) -> Bools:
    """bool [h, w]: the connected part (4 neighbours, no step between) of the usable cells with most weight around the middle.

    The weight is a Gauss bell over the box. The first part, row by row, among equals; nothing where nothing is usable.
    """
    labels, count = parts(depth_m, usable, settings)
    if not count:
        return np.zeros_like(usable)
    height, width = depth_m.shape
    down, across = ((np.arange(side) + 0.5) / side - 0.5 for side in (height, width))
    weight = np.exp(-0.5 * (down[:, None] ** 2 + across**2) / _MIDDLE_SHARE**2)
    total = np.bincount(labels[usable], weights=weight[usable], minlength=count)
    return np.asarray(labels == total.argmax())


def parts(depth_m: Floats, usable: Bools, settings: BoxMaskSettings) -> tuple[NDArray[np.int32], int]:
    """(number of the connected part int32 [h, w], -1 where not usable, row by row; how many parts)."""
    number = np.full(depth_m.shape, -1, np.int64)
    cells = int(usable.sum())
    number[usable] = np.arange(cells)
    ends = []
    for one, other in (((slice(None), slice(None, -1)), (slice(None), slice(1, None))), (np.s_[:-1], np.s_[1:])):
        a, b = depth_m[one], depth_m[other]
        both = usable[one] & usable[other]
        near = np.where(both, np.minimum(a, b), 0)
        step = np.maximum(settings.step_m, settings.step_share * near)
        joined = both & (np.abs(np.where(both, a, 0) - np.where(both, b, 0)) <= step)
        ends.append(np.stack([number[one][joined], number[other][joined]]))
    first, second = np.concatenate(ends, 1)
    graph = coo_matrix((np.ones(len(first), np.bool_), (first, second)), (cells, cells))
    count, label = connected_components(graph, directed=False)
    labels = np.full(depth_m.shape, -1, np.int32)
    labels[usable] = label
    return labels, int(count)


def _to_drop(structural: Bools, known: Bools, settings: BoxMaskSettings) -> Bools:
    """The structural cells, unless the box is nearly all of them."""
    share = float(structural[known].mean())
    return structural if share < settings.flat_share else np.zeros_like(structural)
