"""The three views of a mask that are encoded, and their fusion (section III-B of the paper): L = a1 L1 + a2 L2 + a3 L3.

L1 is the masked RGB region, L2 the binary mask, L3 the boundary-enhanced region: the mask's surroundings, dimmed, with its outline
drawn. The paper leaves the drawing open; ours keeps for L3 what L1 throws away, the context.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from irsd.core.errors import ConfigError
from irsd.core.settings import setting
from irsd.perception.kernels import Floats, unit_rows

VIEWS = 3
_GREY = np.array([122, 116, 104], np.uint8)  # CLIP's mean: no signal after its normalisation
_OUTLINE = (255, 255, 255)
_MARGIN, _CONTEXT = 0.05, 0.25  # around the box, as share of its longer side
_DIM = 0.5
_LEAST_PX = 8  # of a crop's side


@dataclass(frozen=True)
class ViewSettings:
    """Weights of the three views of a mask in its embedding; they sum to 1."""

    a1: float = setting(0.5, "of L1, the masked RGB region", lo=0.0, hi=1.0)
    a2: float = setting(0.1, "of L2, the binary mask", lo=0.0, hi=1.0)
    a3: float = setting(0.4, "of L3, the boundary-enhanced region", lo=0.0, hi=1.0)

    @property
    def weights(self) -> tuple[float, float, float]:
        return self.a1, self.a2, self.a3


def check_weights(settings: ViewSettings) -> None:
    """ConfigError unless the weights sum to 1."""
    total = sum(settings.weights)
    if abs(total - 1.0) > 1e-6:
        raise ConfigError(f"perception.views: a1 + a2 + a3 = {total:g}: must be 1")


def views_of(image_rgb: NDArray[np.uint8], mask: NDArray[np.bool_]) -> tuple[NDArray[np.uint8], ...]:
    """(L1, L2, L3) uint8 [h, w, 3] of a mask bool [H, W] with at least one pixel; L1 and L2 have the same size."""
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    box = (int(rows[0]), int(rows[-1]) + 1, int(columns[0]), int(columns[-1]) + 1)
    tight, wide = _around(box, mask.shape, _MARGIN), _around(box, mask.shape, _CONTEXT)
    inside = mask[tight]
    masked = np.where(inside[..., None], image_rgb[tight], _GREY)
    binary = np.repeat(np.where(inside, 255, 0).astype(np.uint8)[..., None], 3, 2)
    around = image_rgb[wide]
    enhanced = np.where(mask[wide][..., None], around, (around * _DIM).astype(np.uint8))
    outline, _ = cv2.findContours(mask[wide].astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    thick = max(1, round(min(around.shape[:2]) / 100))
    enhanced = cv2.drawContours(np.ascontiguousarray(enhanced), outline, -1, _OUTLINE, thick)
    return masked, binary, np.asarray(enhanced, np.uint8)


def fuse(embeddings: Floats, weights: tuple[float, float, float]) -> Floats:
    """Unit rows float32 [n, D] of the views' embeddings float32 [3 n, D], three rows in the order of ``views_of`` per mask."""
    parts = embeddings.reshape(-1, VIEWS, embeddings.shape[1])
    return unit_rows(np.einsum("nvd,v->nd", parts, np.array(weights, np.float32)))


def _around(box: tuple[int, int, int, int], shape: tuple[int, ...], margin: float) -> tuple[slice, slice]:
    """The box (row, row end, column, column end) with a margin, at least ``_LEAST_PX`` wide and high, cut to the picture."""
    more = margin * max(box[1] - box[0], box[3] - box[2])
    out = []
    for low, high, size in ((box[0], box[1], shape[0]), (box[2], box[3], shape[1])):
        grow = max(more, (_LEAST_PX - (high - low)) / 2)
        out.append(slice(max(int(low - grow), 0), min(int(np.ceil(high + grow)), size)))
    return out[0], out[1]
