"""Our own segmenter: a picture and the LiDAR map's depth to masks of things, without boxes or words.

The network (training/train_segmenter.py) says per cell of a quarter of VGA whether a thing is there, whether two meet, how near the
middle of its thing it is, and where that middle lies (Panoptic-DeepLab, Cheng et al., CVPR 2020); ``nano_decode`` makes masks of it.
"""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from irsd.core.errors import ModelError
from irsd.core.types import Structure
from irsd.perception.job import Sight
from irsd.perception.models import Cancel, Session
from irsd.perception.nano_decode import MEASURES, Floats, Ints, Layers, chosen, regions_of, score_of
from irsd.perception.nano_map import COLUMNS, ROWS, alone_cells, map_picture
from irsd.perception.roles import Masks

_IMAGE, _MAP, _HEADS, _PARTS = "image", "map", "heads", "parts"
_WIDTH, _HEIGHT = 320, 240
CHANNELS = 5  # thing, border, middle (logits); offset across, down
PARTS = len(Structure)  # logits of what a cell is part of
LEAST_SCORE, MOST_OVER = 0.05, 0.3  # a mask less sure is not given; a region more covered by surer ones is left out


class NanoSegmenter:
    """A network with inputs ``image`` float32 [1, 3, 240, 320] (RGB, 0..1) and ``map`` float32 [1, 3, 120, 160] (``nano_map``),
    outputs ``heads`` float32 [1, 5, 120, 160] and ``parts`` [1, 6, 120, 160]. Beside it a .json of the same name: the layers that
    score a mask."""

    def __init__(self, path: Path, *, threads: int = 1, cancel: Cancel | None = None) -> None:
        self._session = Session(path, threads=threads, inputs=(_IMAGE, _MAP), outputs=(_HEADS, _PARTS), cancel=cancel)
        self._layers = read_layers(path.with_suffix(".json"))

    def segment_scene(self, image_rgb: NDArray[np.uint8], sight: Sight) -> Masks:
        """Masks bool [n, H, W] of all things in a picture uint8 [H, W, 3], none over another, best first.

        sight: the map in that picture's pixels; it may be empty. scores: the chance that a mask is right (IoU of a half with a thing).
        Walls, floors, ceilings, doors, windows and carpets are no things.
        """
        hw = (image_rgb.shape[0], image_rgb.shape[1])
        image, map_ = image_input(image_rgb), map_picture(sight, hw)
        heads, parts = self._session.run({_IMAGE: image, _MAP: map_[None]}, (_HEADS, _PARTS))
        for name, values, channels in ((_HEADS, heads, CHANNELS), (_PARTS, parts, PARTS)):
            if values.shape != (1, channels, ROWS, COLUMNS):
                raise ModelError(f"{self._session.path.name}: {name} has shape {values.shape}")
        seen = heads[0].astype(np.float32), parts[0].astype(np.float32)
        regions = regions_of(*seen, map_, cell_colours(image_rgb), alone_cells(sight, hw))
        cells, scores = chosen(regions, score_of(regions.measures, self._layers), LEAST_SCORE, MOST_OVER)
        return Masks(enlarged(cells, len(scores), hw), scores)


def image_input(image_rgb: NDArray[np.uint8]) -> Floats:
    """float32 [1, 3, 240, 320], 0..1, of a picture of any size."""
    small = cv2.resize(image_rgb, (_WIDTH, _HEIGHT), interpolation=cv2.INTER_AREA)
    return np.ascontiguousarray(small.transpose(2, 0, 1)[None], np.float32) / np.float32(255)


def cell_colours(image_rgb: NDArray[np.uint8]) -> Floats:
    """float32 [ROWS, COLUMNS, 3], 0..255."""
    return np.asarray(cv2.resize(image_rgb, (COLUMNS, ROWS), interpolation=cv2.INTER_AREA), np.float32)


def read_layers(path: Path) -> Layers:
    """The scoring perceptron's weights and biases as training wrote them. ModelError when the file is not as it should be."""
    try:
        rows = json.loads(path.read_text(encoding="utf-8"))["layers"]
        layers = tuple((np.array(r["weight"], np.float32), np.array(r["bias"], np.float32)) for r in rows)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ModelError(f"{path} must stand beside the segmenter and hold its scoring layers: {error}") from error
    widths = [MEASURES, *(bias.size for _, bias in layers)]
    fits = [weight.shape == (a, b) for (weight, _), a, b in zip(layers, widths[:-1], widths[1:], strict=True)]
    if not layers or not all(fits) or widths[-1] != 1:
        raise ModelError(f"{path}: the layers must lead from {MEASURES} measures to 1 score, found widths {widths}")
    return layers


def enlarged(cells: Ints, count: int, hw: tuple[int, int]) -> NDArray[np.bool_]:
    """Masks bool [count, H, W] of cells that hold 1 .. count, with smooth edges; disjoint."""
    best = np.full(hw, 0.5, np.float32)
    owner = np.full(hw, -1, np.int32)
    for place in range(count):
        rows, columns = np.nonzero(cells == place + 1)
        top, left = max(int(rows.min()) - 1, 0), max(int(columns.min()) - 1, 0)
        end, right = min(int(rows.max()) + 2, ROWS), min(int(columns.max()) + 2, COLUMNS)
        down = slice(top * hw[0] // ROWS, -(-end * hw[0] // ROWS))
        across = slice(left * hw[1] // COLUMNS, -(-right * hw[1] // COLUMNS))
        part = (cells[top:end, left:right] == place + 1).astype(np.float32)
        size = (across.stop - across.start, down.stop - down.start)
        soft = cv2.resize(part, size, interpolation=cv2.INTER_LINEAR)
        here = soft > best[down, across]
        best[down, across][here] = soft[here]
        owner[down, across][here] = place
    return np.asarray(owner[None] == np.arange(count)[:, None, None])
