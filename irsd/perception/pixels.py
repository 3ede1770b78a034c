"""Pictures as networks want them: resized, cropped or padded, and scaled to floats, equal to the reference processors bit by bit.

Resizing is Pillow's, since that is what the networks were trained and published with: its filters widen when they shrink a picture,
OpenCV's do not, and the difference (up to 1.5 standard deviations of a pixel) is enough to move an embedding.
All functions are pure; pictures are RGB uint8 [H, W, 3]. Sizes are truncated or rounded exactly as each reference does it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from irsd.core.errors import ModelError

Filter = Literal["bilinear", "bicubic"]
_FILTERS = {"bilinear": Image.Resampling.BILINEAR, "bicubic": Image.Resampling.BICUBIC}
# Of a sliver only this many squares around its centre are resized: a crop of 2 x 400 pixels would else pass through 224 x 44800.
_SLIVER = 8


@dataclass(frozen=True, slots=True)
class Levels:
    """How bytes become floats: (value / 255 - mean) / std per channel, R G B."""

    mean: tuple[float, float, float]
    std: tuple[float, float, float]


CLIP_LEVELS = Levels((0.48145466, 0.4578275, 0.40821073), (0.26862954, 0.26130258, 0.27577711))
IMAGENET_LEVELS = Levels((0.485, 0.456, 0.406), (0.229, 0.224, 0.225))
HALF_LEVELS = Levels((0.5, 0.5, 0.5), (0.5, 0.5, 0.5))
UNIT_LEVELS = Levels((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))


def resize(image_rgb: NDArray[np.uint8], width_px: int, height_px: int, kind: Filter) -> NDArray[np.uint8]:
    """uint8 [height_px, width_px, 3], proportions not kept. ModelError for an empty picture."""
    if image_rgb.ndim != 3 or image_rgb.shape[2] != 3 or not image_rgb.size:
        raise ModelError(f"a picture of shape {image_rgb.shape}, not [height, width, 3]")
    resized = Image.fromarray(image_rgb).resize((width_px, height_px), _FILTERS[kind])
    return np.asarray(resized)


def crop_square(image_rgb: NDArray[np.uint8], side_px: int, kind: Filter) -> NDArray[np.uint8]:
    """The middle of the picture, its shorter side resized to side_px: uint8 [side_px, side_px, 3] (CLIPImageProcessor)."""
    height, width = image_rgb.shape[:2]
    short = min(height, width)
    if max(height, width) > _SLIVER * short > 0:
        top, left = (max(0, (side - _SLIVER * short) // 2) for side in (height, width))
        image_rgb = image_rgb[top : top + _SLIVER * short, left : left + _SLIVER * short]
        height, width = image_rgb.shape[:2]
    if short:
        height, width = int(side_px * height / short), int(side_px * width / short)
    resized = resize(image_rgb, width, height, kind)
    top, left = (height - side_px) // 2, (width - side_px) // 2
    return resized[top : top + side_px, left : left + side_px]


def planes(image_rgb: NDArray[np.uint8], levels: Levels) -> NDArray[np.float32]:
    """float32 [3, H, W]: the levels of a picture, channel by channel."""
    # A table of 256 values per channel, computed as the references do: scaled in double precision, normalised in single.
    ramp = (np.arange(256, dtype=np.float64) * (1 / 255)).astype(np.float32)
    out = np.empty((3, *image_rgb.shape[:2]), np.float32)
    for channel in range(3):
        table = (ramp - np.float32(levels.mean[channel])) / np.float32(levels.std[channel])
        np.take(table, image_rgb[..., channel], out=out[channel])
    return out
