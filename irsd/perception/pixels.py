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
from scipy import ndimage

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


def within(height: int, width: int, shortest_px: int, longest_px: int) -> tuple[int, int]:
    """(height, width) with proportions kept: the shorter side shortest_px, unless the longer would exceed longest_px (DETR)."""
    short, long = min(height, width), max(height, width)
    size = float(shortest_px)
    if long / short * size > longest_px:
        size = longest_px * short / long
    whole = max(round(size), 1)
    if short == whole:
        return height, width
    longer = int(size * long / short)
    return (longer, whole) if width < height else (whole, longer)


def padded_square(image_rgb: NDArray[np.uint8], side_px: int, levels: Levels) -> NDArray[np.float32]:
    """float32 [3, side_px, side_px]: grey below or to the right up to a square, then resized (Owlv2ImageProcessor).

    OWLv2 resizes floats as scikit-image does: a Gaussian of half the excess in scale, then linear interpolation with mirrored borders.
    """
    height, width = image_rgb.shape[:2]
    long = max(height, width)
    square = np.full((long, long, 3), 0.5, np.float32)
    square[:height, :width] = image_rgb.astype(np.float64) * (1 / 255)
    factor = long / side_px
    if factor > 1:
        spread = (factor - 1) / 2
        square = ndimage.gaussian_filter(square, (spread, spread, 0), mode="mirror")
    zoom = (1 / factor, 1 / factor, 1)
    resized = ndimage.zoom(square, zoom, order=1, mode="mirror", grid_mode=True)
    resized = np.clip(resized, square.min(), square.max())
    out = (resized - np.array(levels.mean, np.float32)) / np.array(levels.std, np.float32)
    return np.ascontiguousarray(out.transpose(2, 0, 1), np.float32)
