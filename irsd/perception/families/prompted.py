"""What SAM and its relatives share (Kirillov et al. 2023): a picture is encoded once, then prompts are decoded into masks.

Each prompt (a box, a point) gets several masks as logits, for what it may mean (part, thing, group), and for each the IoU with
the truth that the network expects. Subclasses know the names and shapes of one family's files.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from irsd.core.errors import ModelError
from irsd.perception.models import Session
from irsd.perception.pixels import IMAGENET_LEVELS, planes, resize
from irsd.perception.roles import Masks

Floats = NDArray[np.float32]
POINT, BOX_FIRST, BOX_LAST, PADDING = 1, 2, 3, -1  # labels of prompt points
SIDE_PX = 1024  # of the square, where a file does not say
BATCH = 4  # prompts decoded at once: 33 MB each in SAM's decoder, and the same 80 ms each at 1 as at 16


@dataclass(frozen=True, slots=True)
class Frame:
    """How a picture lies in the network's square: resized by its longer side, at the top left, zeros below and to the right."""

    height: int
    width: int
    side_px: int

    @property
    def resized(self) -> tuple[int, int]:
        """(height, width) within the square, rounded as SAM does it."""
        scale = self.side_px / max(self.height, self.width)
        return max(int(self.height * scale + 0.5), 1), max(int(self.width * scale + 0.5), 1)

    def to_network(self, xy_px: Floats) -> Floats:
        """Places float32 [.., 2] of the picture in the square."""
        height, width = self.resized
        return np.asarray(xy_px * np.array([width / self.width, height / self.height]), np.float32)

    def enlarge(self, logits: Floats) -> NDArray[np.bool_]:
        """bool [n, height, width] of logits [n, h, w]: to the square, cut, to the picture, above 0 (as SAM and transformers do it).

        Logits that have the picture's size already are only compared. Both steps are bilinear and never average.
        """
        size = (self.height, self.width)
        out = np.empty((len(logits), *size), np.bool_)
        height, width = self.resized
        for row, low in enumerate(logits):
            full = low
            if low.shape != size:
                square = cv2.resize(low, (self.side_px, self.side_px), interpolation=cv2.INTER_LINEAR)
                full = cv2.resize(square[:height, :width], size[::-1], interpolation=cv2.INTER_LINEAR)
            np.greater(full, 0, out=out[row])
        return out


@dataclass(frozen=True, slots=True)
class Encoded:
    """A picture as its encoder left it: the decoder's inputs by name, and how the picture lies in them."""

    features: dict[str, Floats]
    frame: Frame


@dataclass(frozen=True, slots=True)
class Candidates:
    """Masks that prompts may mean: logits float32 [n, k, h, w] at any resolution, ious float32 [n, k] as the network expects them."""

    logits: Floats
    ious: Floats


class PromptedSegmenter(ABC):
    """A Segmenter whose prompts may also be points."""

    def segment(self, image_rgb: NDArray[np.uint8], boxes_px: Floats) -> Masks:
        """See ``roles.Segmenter``: of the masks that a box may mean the one with the highest expected IoU."""
        size = image_rgb.shape[:2]
        masks = np.zeros((len(boxes_px), *size), np.bool_)
        scores = np.zeros(len(boxes_px), np.float32)
        if len(boxes_px):
            encoded = self.encode(image_rgb)
        for first in range(0, len(boxes_px), BATCH):
            some = slice(first, min(first + BATCH, len(boxes_px)))
            found = self.decode_boxes(encoded, np.ascontiguousarray(boxes_px[some], np.float32))
            each = np.arange(len(found.ious))
            best = found.ious.argmax(1)
            masks[some] = encoded.frame.enlarge(found.logits[each, best])
            scores[some] = found.ious[each, best]
        return Masks(masks, scores)

    def prompt_points(self, encoded: Encoded, points_px: Floats) -> Iterator[Candidates]:
        """The masks that single points float32 [n, 2] of the picture may mean, some points at a time, in their order."""
        for first in range(0, len(points_px), BATCH):
            yield self.decode_points(encoded, np.ascontiguousarray(points_px[first : first + BATCH], np.float32))

    @abstractmethod
    def encode(self, image_rgb: NDArray[np.uint8]) -> Encoded:
        """A picture uint8 [H, W, 3] through the encoder: the expensive half."""

    @abstractmethod
    def decode_boxes(self, encoded: Encoded, boxes_px: Floats) -> Candidates:
        """The masks of 1 to ``BATCH`` boxes float32 [n, 4]."""

    @abstractmethod
    def decode_points(self, encoded: Encoded, points_px: Floats) -> Candidates:
        """The masks of 1 to ``BATCH`` points float32 [n, 2]."""


def candidates(logits: Floats, ious: Floats, prompts: int, name: str) -> Candidates:
    """What a decoder gave, as [prompts, k, h, w] and [prompts, k]. ModelError when the shapes are not those of so many prompts."""
    if logits.ndim < 4 or logits.size == 0 or ious.size % prompts or logits.shape[-3] * prompts != ious.size:
        raise ModelError(f"{name}: masks of shape {logits.shape} and scores {ious.shape} for {prompts} prompts")
    ious = ious.reshape(prompts, -1)
    return Candidates(logits.reshape(*ious.shape, *logits.shape[-2:]), ious)


def square_side(session: Session, name: str) -> int:
    """Edge in pixels of the square picture [.., side, side] that an input takes."""
    side = next(tensor.shape[-1] for tensor in session.input_tensors if tensor.name == name)
    return side if isinstance(side, int) else SIDE_PX


def square_pixels(image_rgb: NDArray[np.uint8], frame: Frame) -> Floats:
    """float32 [3, side, side]: resized as ``frame`` says, normalised, then padded with zeros (SamImageProcessor)."""
    height, width = frame.resized
    out = np.zeros((3, frame.side_px, frame.side_px), np.float32)
    out[:, :height, :width] = planes(resize(image_rgb, width, height, "bilinear"), IMAGENET_LEVELS)
    return out
