"""Our own segmenter: a picture and the LiDAR map's depth to masks of things, without boxes or words.

The network (training/train_segmenter.py) says per cell of a quarter of VGA whether a thing is there, whether two things meet, how near
the middle of its thing it is, and where that middle lies (Panoptic-DeepLab, Cheng et al., CVPR 2020). Cells go to the middle
they point at.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from irsd.core.errors import ModelError
from irsd.core.jit import kernel
from irsd.perception.job import Sight
from irsd.perception.models import Cancel, Session
from irsd.perception.nano_map import COLUMNS, ROWS, map_picture
from irsd.perception.roles import Masks

Floats = NDArray[np.float32]
_IMAGE, _MAP, _HEADS = "image", "map", "heads"
_WIDTH, _HEIGHT = 320, 240
CHANNELS = 5  # thing, border, middle (logits); offset across, down
OFFSET_CELLS = 16.0  # an offset of 1 is so many cells
FEATURES = 7


@dataclass(frozen=True)
class DecodeSettings:
    """Chosen on rendered rooms that the network was not trained on.

    thing: least chance of a cell; middle: least chance of a peak; window_cells: a peak is the highest within; least_cells of a mask.
    """

    thing: float = 0.5
    middle: float = 0.15
    window_cells: int = 3
    least_cells: int = 12


class NanoSegmenter:
    """A network with inputs ``image`` float32 [1, 3, 240, 320] (RGB, 0..1) and ``map`` float32 [1, 3, 120, 160] (``nano_map``)
    and output
    ``heads`` float32 [1, 5, 120, 160]. Beside it a .json of the same name: weights of a mask's score."""

    def __init__(self, path: Path, *, threads: int = 1, cancel: Cancel | None = None) -> None:
        self._session = Session(path, threads=threads, inputs=(_IMAGE, _MAP), outputs=(_HEADS,), cancel=cancel)
        self._settings, self._weights = read_decoding(path.with_suffix(".json"))

    def segment_scene(self, image_rgb: NDArray[np.uint8], sight: Sight) -> Masks:
        """Masks bool [n, H, W] of all things in a picture uint8 [H, W, 3], none over another, best first.

        sight: the map in that picture's pixels; it may be empty. scores: the chance that a mask is right (IoU of a half with
        one thing).
        Walls, floors, ceilings, doors, windows and carpets are no things.
        """
        hw = (image_rgb.shape[0], image_rgb.shape[1])
        feeds = {_IMAGE: image_input(image_rgb), _MAP: map_picture(sight, hw)[None]}
        (heads,) = self._session.run(feeds, (_HEADS,))
        if heads.shape != (1, CHANNELS, ROWS, COLUMNS):
            raise ModelError(f"{self._session.path.name}: {_HEADS} has shape {heads.shape}")
        cells, features = decode(heads[0].astype(np.float32), self._settings)
        scores = score_of(features, self._weights)
        order = np.argsort(-scores, kind="stable")
        return Masks(enlarged(cells, order, hw), scores[order].astype(np.float32))


def image_input(image_rgb: NDArray[np.uint8]) -> Floats:
    """float32 [1, 3, 240, 320], 0..1, of a picture of any size."""
    small = cv2.resize(image_rgb, (_WIDTH, _HEIGHT), interpolation=cv2.INTER_AREA)
    return np.ascontiguousarray(small.transpose(2, 0, 1)[None], np.float32) / np.float32(255)


def read_decoding(path: Path) -> tuple[DecodeSettings, Floats]:
    """Settings and score weights float32 [FEATURES + 1] as training found them. ModelError when the file is not as it should be."""
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
        settings = DecodeSettings(**document["decode"])
        weights = np.array(document["score"], np.float32)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ModelError(f"{path} must stand beside the segmenter and hold its settings: {error}") from error
    if weights.shape != (FEATURES + 1,):
        raise ModelError(f"{path}: score has {weights.size} numbers, expected {FEATURES + 1}")
    return settings, weights


def score_of(features: Floats, weights: Floats) -> Floats:
    """The chance float32 [n] that a mask is right, from what ``decode`` measured of it: a logistic regression."""
    return np.asarray(1 / (1 + np.exp(-(features @ weights[:-1] + weights[-1]))), np.float32)


def decode(heads: Floats, settings: DecodeSettings) -> tuple[NDArray[np.int32], Floats]:
    """(cells int32 [ROWS, COLUMNS]: k + 1 where mask k lies, 0 where none; features float32 [n, FEATURES]) of ``heads`` [5,
    ROWS, COLUMNS].

    Features: the peak's chance; mean chance of a thing; mean chance of a border; logarithm of the cells; share of its cells in its
    largest part; mean distance of the cells' votes from the middle, by the mask's size; touches the picture's edge.
    """
    chance = (1 / (1 + np.exp(-np.clip(heads[:3], -30, 30)))).astype(np.float32)
    smooth = cv2.GaussianBlur(chance[2], (3, 3), 0)
    peaks = find_peaks(smooth, chance[0], settings.middle, settings.thing, settings.window_cells)
    cells = assign(chance[0] > settings.thing, heads[3:] * np.float32(OFFSET_CELLS), peaks)
    return _measured(cells, chance, smooth, heads[3:] * np.float32(OFFSET_CELLS), peaks, settings.least_cells)


def _measured(
    cells: NDArray[np.int32], chance: Floats, smooth: Floats, offset: Floats, peaks: NDArray[np.int32], least: int
) -> tuple[NDArray[np.int32], Floats]:
    """The masks' largest parts, renumbered, with their features; small ones are left out."""
    out, rows = np.zeros_like(cells), []
    grid_y, grid_x = np.mgrid[:ROWS, :COLUMNS].astype(np.float32)
    for k, (row, column) in enumerate(peaks.tolist(), start=1):
        mask = cells == k
        size = int(mask.sum())
        if size < least:
            continue
        count, parts, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
        share = stats[1:, cv2.CC_STAT_AREA] / size
        big = np.flatnonzero(share > 0.05) + 1  # what stands behind a leg is in several parts
        mask = np.isin(parts, big) if count > 2 else mask
        away = np.hypot(grid_x[mask] + offset[0][mask] - column, grid_y[mask] + offset[1][mask] - row)
        edge = mask[0].any() or mask[-1].any() or mask[:, 0].any() or mask[:, -1].any()
        rows.append(
            (smooth[row, column], chance[0][mask].mean(), chance[1][mask].mean(), np.log(mask.sum()), share.max(),
             away.mean() / np.sqrt(size), float(edge))
        )  # fmt: skip
        out[mask] = len(rows)
    return out, np.array(rows, np.float32).reshape(-1, FEATURES)


@kernel
def find_peaks(middle: Floats, thing: Floats, least: float, least_thing: float, window: int) -> NDArray[np.int32]:
    """(row, column) int32 [n, 2] of cells whose ``middle`` is the highest within the window, and high enough, on a thing or
    beside it."""
    found = np.empty((ROWS * COLUMNS, 2), np.int32)
    n = 0
    for r in range(ROWS):
        for c in range(COLUMNS):
            if middle[r, c] < least:
                continue
            best = True
            near = False
            for y in range(max(r - window, 0), min(r + window + 1, ROWS)):
                for x in range(max(c - window, 0), min(c + window + 1, COLUMNS)):
                    near |= thing[y, x] > least_thing
                    higher = middle[y, x] > middle[r, c]
                    earlier = middle[y, x] == middle[r, c] and (y < r or (y == r and x < c))
                    if higher or earlier:
                        best = False
            if best and near:
                found[n, 0], found[n, 1] = r, c
                n += 1
    return found[:n].copy()


@kernel
def assign(thing: NDArray[np.bool_], offset: Floats, peaks: NDArray[np.int32]) -> NDArray[np.int32]:
    """int32 [ROWS, COLUMNS]: 1 + the peak that a cell's vote (cell + offset [2], across and down, in cells) is nearest to; 0
    for no thing."""
    out = np.zeros((ROWS, COLUMNS), np.int32)
    for r in range(ROWS):
        for c in range(COLUMNS):
            if not thing[r, c]:
                continue
            y, x = r + offset[1, r, c], c + offset[0, r, c]
            best, nearest = 0, 1e9
            for k in range(len(peaks)):
                away = (y - peaks[k, 0]) ** 2 + (x - peaks[k, 1]) ** 2
                if away < nearest:
                    best, nearest = k + 1, away
            out[r, c] = best
    return out


def enlarged(cells: NDArray[np.int32], order: NDArray[np.int64], hw: tuple[int, int]) -> NDArray[np.bool_]:
    """Masks bool [n, H, W] of the cells, in an order of their numbers, with smooth edges; disjoint."""
    masks = np.zeros((len(order), *hw), np.bool_)
    best = np.full(hw, 0.5, np.float32)
    owner = np.full(hw, -1, np.int32)
    for place, k in enumerate(order.tolist()):
        rows, columns = np.nonzero(cells == k + 1)
        top, left = max(int(rows.min()) - 1, 0), max(int(columns.min()) - 1, 0)
        end, right = min(int(rows.max()) + 2, ROWS), min(int(columns.max()) + 2, COLUMNS)
        box = (
            slice(top * hw[0] // ROWS, -(-end * hw[0] // ROWS)),
            slice(left * hw[1] // COLUMNS, -(-right * hw[1] // COLUMNS)),
        )
        part = (cells[top:end, left:right] == k + 1).astype(np.float32)
        size = (box[1].stop - box[1].start, box[0].stop - box[0].start)
        soft = cv2.resize(part, size, interpolation=cv2.INTER_LINEAR)
        here = soft > best[box]
        best[box][here] = soft[here]
        owner[box][here] = place
    for place in range(len(order)):
        masks[place] = owner == place
    return masks
