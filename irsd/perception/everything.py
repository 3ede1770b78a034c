"""Masks of everything in a picture, without words or boxes: a grid of points asks a promptable segmenter, the best answers stay.

After SAM's automatic mask generation (Kirillov et al. 2023, section 5), on one scale: each point gives its candidates; those that the
network doubts or that depend on where the logits are cut go; of masks that overlap the better stays. Unlike there, overlap is that of
the masks and not of their boxes, and better means expected IoU times stability.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from irsd.core.settings import setting
from irsd.perception.families.prompted import Frame, PromptedSegmenter
from irsd.perception.roles import Masks

_CUT = 1.0  # how far up and down the threshold of the logits is moved, as in SAM
_STEP_PX = 4  # overlaps are counted on every so many pixels, both ways


@dataclass(frozen=True)
class GridSettings:
    """Segmenting everything by a grid of points."""

    points_per_side: int = setting(
        12, "points along each side of the picture; the decoder runs for each of the grid", lo=1, hi=64
    )
    min_iou: float = setting(0.86, "masks of which the network expects less are dropped", lo=0.0, hi=1.0)
    min_stability: float = setting(
        0.90, "least IoU of a mask with itself when its threshold is moved up and down", lo=0.0, hi=1.0
    )
    overlap: float = setting(0.6, "of two masks with a larger IoU, the better stays", lo=0.0, hi=1.0)
    max_masks: int = setting(60, "at most so many masks, the best", lo=1, hi=1000)


class GridPrompter:
    """A segmenter without boxes."""

    def __init__(self, segmenter: PromptedSegmenter, settings: GridSettings) -> None:
        self._segmenter, self._settings = segmenter, settings

    def segment_all(self, image_rgb: NDArray[np.uint8]) -> Masks:
        """All that can be told apart in a picture uint8 [H, W, 3], best first. scores: the IoU that the network expects."""
        settings = self._settings
        encoded = self._segmenter.encode(image_rgb)
        size = (image_rgb.shape[0], image_rgb.shape[1])
        masks, scores, ranks = [np.zeros((0, *size), np.bool_)], [np.zeros(0, np.float32)], [np.zeros(0, np.float32)]
        for found in self._segmenter.prompt_points(encoded, grid_points(size, settings.points_per_side)):
            logits, ious = found.logits.reshape(-1, *found.logits.shape[-2:]), found.ious.reshape(-1)
            stable = stability(logits, encoded.frame)
            keep = (ious >= settings.min_iou) & (stable >= settings.min_stability)
            masks.append(encoded.frame.enlarge(logits[keep]))
            scores.append(ious[keep])
            ranks.append(ious[keep] * stable[keep])
        every, all_scores = np.concatenate(masks), np.concatenate(scores)
        best = distinct(every[:, ::_STEP_PX, ::_STEP_PX], np.concatenate(ranks), settings.overlap)[: settings.max_masks]
        return Masks(every[best], all_scores[best])


def grid_points(size: tuple[int, int], per_side: int) -> NDArray[np.float32]:
    """float32 [per_side ** 2, 2] (x, y): the middles of equal tiles of a picture of (height, width), row by row."""
    height, width = size
    y, x = np.meshgrid(*((np.arange(per_side) + 0.5) / per_side * side for side in (height, width)), indexing="ij")
    return np.stack([x.ravel(), y.ravel()], 1).astype(np.float32)


def stability(logits: NDArray[np.float32], frame: Frame) -> NDArray[np.float32]:
    """float32 [n] of logits [n, h, w]: |logits > 1| / |logits > -1| within the picture, 0 where there is nothing."""
    if logits.shape[1:] != (frame.height, frame.width):  # of the square: without the padding
        rows, columns = (
            max(round(side / frame.side_px * have), 1)
            for side, have in zip(frame.resized, logits.shape[1:], strict=True)
        )
        logits = logits[:, :rows, :columns]
    inner, outer = (logits > _CUT).sum((1, 2)), (logits > -_CUT).sum((1, 2))
    return np.asarray(inner / np.maximum(outer, 1), np.float32)


def distinct(masks: NDArray[np.bool_], ranks: NDArray[np.float32], overlap: float) -> NDArray[np.int64]:
    """Which masks bool [n, h, w] stay when of any two with an IoU above ``overlap`` the lower rank goes (greedy); best first."""
    order = np.argsort(-ranks, kind="stable")
    flat = masks.reshape(len(masks), masks.shape[1] * masks.shape[2])[order].astype(np.float32)
    both = flat @ flat.T
    area = flat.sum(1)
    iou = both / np.maximum(area[:, None] + area[None] - both, 1)
    stays = area > 0
    for row in range(len(order)):  # masks, not pixels
        if stays[row]:
            stays[row + 1 :] &= iou[row, row + 1 :] <= overlap
    return np.asarray(order[stays])
