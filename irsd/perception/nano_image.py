"""Our own image encoder: a mask's crop with its surroundings, and its measures, to the text encoder's space.

Crop and mask go in as channels, so one row per mask does what three views (L1 the region, L2 the mask, L3 its surroundings) do for an
encoder that takes pictures only. Measures in metres come from the LiDAR map's depth; without it they are zero.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from irsd.core.errors import ModelError
from irsd.core.types import CameraView
from irsd.perception.encoder import DIMENSION
from irsd.perception.job import Sight
from irsd.perception.kernels import unit_rows
from irsd.perception.models import Cancel, Session
from irsd.perception.nano_map import map_picture

Floats = NDArray[np.float32]
Bools = NDArray[np.bool_]
Box = tuple[int, int, int, int]  # first row, row end, first column, column end
SIDE, CHANNELS, MEASURES = 64, 5, 12
NAME = "all-MiniLM-L6-v2"
_WIDTH = 320  # of the pictures that it was trained on
_AROUND = 1.4  # the crop's side by the mask's longer side
_LEAST_PX = 16.0
_CROPS, _MEASURES, _EMBEDDING = "crops", "measures", "embedding"
_BATCH = 8


@dataclass(frozen=True, slots=True)
class Geometry:
    """matrix: float64 [3, 3] of the picture's pixels; up: float64 [3], unit, in the optical frame; height_m: camera over the floor."""

    matrix: NDArray[np.float64]
    up: NDArray[np.float64]
    height_m: float

    @classmethod
    def of(cls, view: CameraView, scale: float, floor_z_m: float) -> Geometry:
        """Of a view whose picture was scaled (1 = as taken), above a floor at a height in the map."""
        matrix = view.camera.matrix.copy()
        matrix[:2, :2] *= scale
        matrix[:2, 2] = (matrix[:2, 2] + 0.5) * scale - 0.5
        return cls(matrix, view.map_T_camera[2, :3].copy(), float(view.map_T_camera[2, 3]) - floor_z_m)


class NanoImageEncoder:
    """A network with inputs ``crops`` float32 [n, 5, 64, 64], ``measures`` float32 [n, 12], output ``embedding`` float32 [n, 384]."""

    def __init__(self, path: Path, *, threads: int = 1, cancel: Cancel | None = None) -> None:
        self._session = Session(path, threads=threads, inputs=(_CROPS, _MEASURES), outputs=(_EMBEDDING,), cancel=cancel)

    @property
    def name(self) -> str:
        """The space: that of ``TextEncoder``."""
        return NAME

    @property
    def dimension(self) -> int:
        """Of the embeddings."""
        return DIMENSION

    def encode_masks(
        self, image_rgb: NDArray[np.uint8], masks: Bools, sight: Sight, geometry: Geometry | None
    ) -> Floats:
        """float32 [n, 384], unit rows, of masks bool [n, H, W] of a picture uint8 [H, W, 3]; zero for an empty mask.

        sight: the map in that picture's pixels, may be empty. geometry None: nothing is known in metres.
        """
        out = np.zeros((len(masks), DIMENSION), np.float32)
        some = [k for k in range(len(masks)) if masks[k].any()]
        crops, measures = network_inputs(image_rgb, masks[some], sight, geometry)
        for start in range(0, len(some), _BATCH):
            part = slice(start, start + _BATCH)
            (got,) = self._session.run({_CROPS: crops[part], _MEASURES: measures[part]}, (_EMBEDDING,))
            if got.shape != (len(crops[part]), DIMENSION):
                raise ModelError(f"{self._session.path.name}: {_EMBEDDING} has shape {got.shape}")
            out[some[part]] = got
        return unit_rows(out)


def network_inputs(
    image_rgb: NDArray[np.uint8], masks: Bools, sight: Sight, geometry: Geometry | None
) -> tuple[Floats, Floats]:
    """(crops float32 [n, 5, 64, 64], measures float32 [n, 12]) of masks with at least one pixel each."""
    hw = (image_rgb.shape[0], image_rgb.shape[1])
    shown = map_picture(sight, hw)
    depth_m = np.where(shown[1] > 0, 1 / np.maximum(shown[0], 1e-3), 0).astype(np.float32)
    scale = min(_WIDTH / hw[1], 1.0)
    small = (max(round(hw[1] * scale), 1), max(round(hw[0] * scale), 1))
    image = cv2.resize(image_rgb, small, interpolation=cv2.INTER_AREA)
    crops = np.zeros((len(masks), CHANNELS, SIDE, SIDE), np.float32)
    measures = np.zeros((len(masks), MEASURES), np.float32)
    column, row = np.clip(np.round(sight.pixel.reshape(-1, 2)).astype(np.int64), 0, (hw[1] - 1, hw[0] - 1)).T
    for k, mask in enumerate(masks):
        box = _box(mask)
        inside = mask[row, column]
        solid = inside & ~sight.structural
        inside = solid if solid.sum() >= max(3, 0.2 * inside.sum()) else inside
        depth = sight.depth_m[inside]
        middle_m = float(np.median(depth)) if len(depth) >= 3 else 0.0
        measures[k] = _measures(mask, box, depth, middle_m, geometry, hw)
        centre = ((box[0] + box[1]) / 2, (box[2] + box[3]) / 2)  # row, column
        side = max(max(box[1] - box[0], box[3] - box[2]) * _AROUND, _LEAST_PX / scale)
        crops[k, :3] = _square(image, centre, side, hw, 127).transpose(2, 0, 1) / np.float32(255)
        soft = cv2.resize(mask.view(np.uint8) * np.uint8(255), small, interpolation=cv2.INTER_AREA)
        crops[k, 3] = _square(soft, centre, side, hw, 0) / np.float32(255)
        if middle_m > 0:
            near = np.where(depth_m > 0, np.clip(depth_m - middle_m, -1, 1), 0).astype(np.float32)
            crops[k, 4] = _square(near, centre, side, hw, 0)
    return crops, measures


def _box(mask: Bools) -> Box:
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    return int(rows[0]), int(rows[-1]) + 1, int(columns[0]), int(columns[-1]) + 1


def _measures(
    mask: Bools, box: Box, depth: Floats, middle_m: float, geometry: Geometry | None, hw: tuple[int, int]
) -> Floats:
    """Logarithms of width and height in metres; lowest and highest above the floor; logarithms of distance and of thickness; of the
    share of the picture and of width by height; share of its box; whether it touches the picture's sides, its top or bottom; whether
    metres are known."""
    high, wide = box[1] - box[0], box[3] - box[2]
    area = float(mask.sum())
    out = np.zeros(MEASURES, np.float32)
    out[6:9] = np.log(area / (hw[0] * hw[1])) / 4, np.log(wide / high), area / (high * wide)
    out[9:11] = float(box[2] == 0 or box[3] == hw[1]), float(box[0] == 0 or box[1] == hw[0])
    if geometry is None or middle_m <= 0:
        return out
    focal = geometry.matrix[0, 0], geometry.matrix[1, 1]
    middle_u = (box[2] + box[3]) / 2 - 0.5
    ends = []
    for v in (box[1] - 0.5, box[0] - 0.5):
        ray = np.array([(middle_u - geometry.matrix[0, 2]) / focal[0], (v - geometry.matrix[1, 2]) / focal[1], 1.0])
        ends.append(geometry.height_m + middle_m * float(ray @ geometry.up))
    spread = float(np.quantile(depth, 0.9) - np.quantile(depth, 0.1))
    out[:6] = (
        np.log(wide * middle_m / focal[0]),
        np.log(high * middle_m / focal[1]),
        *ends,
        np.log(middle_m),
        np.log(spread + 0.03),
    )
    out[11] = 1.0
    return out


def _square(
    picture: NDArray[Any], centre: tuple[float, float], side: float, hw: tuple[int, int], fill: int
) -> NDArray[Any]:
    """SIDE x SIDE of a picture that shows (height, width) pixels at any size: a square of ``side`` such pixels, ``fill`` beyond."""
    down, across = picture.shape[0] / hw[0], picture.shape[1] / hw[1]
    top, left = round((centre[0] - side / 2) * down), round((centre[1] - side / 2) * across)
    high, wide = max(round(side * down), 1), max(round(side * across), 1)
    y0, x0, y1, x1 = max(top, 0), max(left, 0), min(top + high, picture.shape[0]), min(left + wide, picture.shape[1])
    square = np.full((high, wide, *picture.shape[2:]), fill, picture.dtype)
    square[y0 - top : y1 - top, x0 - left : x1 - left] = picture[y0:y1, x0:x1]
    way = cv2.INTER_AREA if high > SIDE else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(square, (SIDE, SIDE), interpolation=way))
