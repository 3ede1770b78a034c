"""NanoDet-m: a detector of COCO's 80 classes, small enough to run on every picture (RangiLyu/nanodet, Apache-2.0).

Its head is that of Generalized Focal Loss (Li et al. 2020): per cell and stride class scores (the sigmoid is in the graph) and, for
each side of the box, a distribution over 0..7 strides whose expectation is the distance from the cell's centre to that side.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from irsd.core.errors import ModelError
from irsd.perception.aliases import AliasTable
from irsd.perception.models import Session
from irsd.perception.roles import Boxes

_log = logging.getLogger(__name__)

# COCO's classes in the order of the head, in the words of our alias table; a class that spans two of our names has both.
_COCO = """
person, bicycle, car, motorcycle, airplane, bus, train, truck, boat, traffic light, fire hydrant, stop sign, parking meter, bench,
bird, cat, dog, horse, sheep, cow, elephant, bear, zebra, giraffe, backpack, umbrella, handbag, tie, suitcase, frisbee, skis,
snowboard, sports ball / ball, kite, baseball bat, baseball glove, skateboard, surfboard, tennis racket, bottle, wine glass, cup,
fork, knife, spoon, bowl, banana, apple, sandwich, orange, broccoli, carrot, hot dog, pizza, donut, cake, chair, sofa, potted plant,
bed, dining table, toilet, television / monitor, laptop, mouse, remote control, keyboard, cell phone, microwave, oven, toaster,
sink, refrigerator, book, clock, vase, scissors, teddy bear, hair dryer, toothbrush
"""
COCO_CLASSES: tuple[str, ...] = tuple(" ".join(_COCO.split()).split(", "))
SIDE_PX = 416
STRIDES = (8, 16, 32)
BINS = 8
_MEAN_BGR = np.array([103.53, 116.28, 123.675], np.float32)
_STD_BGR = np.array([57.375, 57.12, 58.395], np.float32)


class NanoDet:
    """A Detector with a closed vocabulary: a prompt that names none of its classes is not looked for (``unknown`` tells which)."""

    def __init__(
        self, session: Session, aliases: AliasTable, *, threshold: float = 0.35, classes: Sequence[str] = COCO_CLASSES
    ) -> None:
        """threshold: least class score, 0.35 as in the published runner. classes: what the head's columns mean."""
        self._session = session
        self._aliases = aliases
        self._threshold = threshold
        self._classes = len(classes)
        self._column: dict[str, int] = {}
        for column, names in enumerate(classes):
            for name in names.split(" / "):
                self._column.setdefault(aliases.canonical(name), column)
        self._said: set[str] = set()
        self._centres_px, self._strides_px = _grid(SIDE_PX)

    def unknown(self, prompts: Sequence[str]) -> tuple[str, ...]:
        """The prompts that name none of the classes, neither by name nor by a synonym: nothing will be found for them."""
        return tuple(prompt for prompt in prompts if self._aliases.canonical(prompt) not in self._column)

    def detect(self, image_rgb: NDArray[np.uint8], prompts: tuple[str, ...]) -> Boxes:
        """See ``roles.Detector``. Boxes of one class may overlap; two prompts for one class give their boxes to the first of them."""
        for prompt in self.unknown(prompts):
            if prompt not in self._said:
                self._said.add(prompt)
                _log.info("%s does not know %r: it is not looked for", self._session.path.name, prompt)
        prompt_of = np.full(self._classes, -1, np.int32)
        for number, prompt in reversed(list(enumerate(prompts))):
            known = self._column.get(self._aliases.canonical(prompt))
            if known is not None:
                prompt_of[known] = number
        pixels, scale_px, offset_px = letterbox(image_rgb, SIDE_PX)
        scores, sides = self._run(pixels)
        wanted = scores * (prompt_of >= 0) > self._threshold
        row, column = np.nonzero(wanted)
        boxes = decode_boxes(self._centres_px[row], self._strides_px[row], sides[row])
        height, width = image_rgb.shape[:2]
        boxes = (boxes - np.tile(offset_px, 2)) * np.tile(scale_px, 2)
        boxes = np.clip(boxes, 0, np.tile(np.array([width, height], np.float32), 2)).astype(np.float32)
        return Boxes(boxes, scores[row, column], prompt_of[column])

    def _run(self, pixels: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Class scores float32 [cells, classes] and sides float32 [cells, 4 * BINS], cells of stride 8 first."""
        values = self._session.run({self._session.inputs[0]: pixels}, self._session.outputs)
        levels = sorted((value.reshape(-1, value.shape[-1]) for value in values), key=len, reverse=True)
        scores = [level for level in levels if level.shape[1] == self._classes]
        sides = [level for level in levels if level.shape[1] == 4 * BINS]
        cells = [(SIDE_PX // stride) ** 2 for stride in STRIDES]
        if [len(level) for level in scores] != cells or [len(level) for level in sides] != cells:
            shapes = ", ".join(str(value.shape) for value in values)
            raise ModelError(f"{self._session.path.name} is no NanoDet of {self._classes} classes: outputs {shapes}")
        return np.concatenate(scores), np.concatenate(sides)


def letterbox(
    image_rgb: NDArray[np.uint8], side_px: int
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Picture to network: float32 [1, 3, side, side] BGR, normalised, the aspect kept, black bars around.

    Also scale_px, offset_px float32 [2] (x, y): ``(network - offset) * scale`` is a place in the picture. Sizes truncate and the
    resize averages areas, as in the published runner.
    """
    height, width = image_rgb.shape[:2]
    longest = max(height, width)
    new_width, new_height = max(side_px * width // longest, 1), max(side_px * height // longest, 1)
    left, top = (side_px - new_width) // 2, (side_px - new_height) // 2
    canvas = np.zeros((side_px, side_px, 3), np.uint8)
    canvas[top : top + new_height, left : left + new_width] = cv2.resize(
        image_rgb, (new_width, new_height), interpolation=cv2.INTER_AREA
    )
    pixels = (canvas[..., ::-1].astype(np.float32) - _MEAN_BGR) / _STD_BGR
    scale_px = np.array([width / new_width, height / new_height], np.float32)
    return np.ascontiguousarray(pixels.transpose(2, 0, 1))[None], scale_px, np.array([left, top], np.float32)


def decode_boxes(
    centres_px: NDArray[np.float32], strides_px: NDArray[np.float32], sides: NDArray[np.float32]
) -> NDArray[np.float32]:
    """float32 [n, 4] x0, y0, x1, y1 in network pixels, of n cells: centres [n, 2], strides [n], sides [n, 4 * BINS] (logits).

    distance = stride * sum_k k * softmax(side)_k, left, top, right, bottom.
    """
    logits = sides.reshape(-1, 4, BINS)
    weights = np.exp(logits - logits.max(-1, keepdims=True))
    expected = weights @ np.arange(BINS, dtype=np.float32) / weights.sum(-1)
    distance = expected * strides_px[:, None]
    return np.concatenate([centres_px - distance[:, :2], centres_px + distance[:, 2:]], 1).astype(np.float32)


def _grid(side_px: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Centres float32 [cells, 2] (x, y) and strides float32 [cells] of all cells, row by row, stride 8 first."""
    centres, strides = [], []
    for stride in STRIDES:
        axis = (np.arange(side_px // stride, dtype=np.float32) + 0.5) * stride - 0.5
        x, y = np.meshgrid(axis, axis)
        centres.append(np.stack([x.ravel(), y.ravel()], 1))
        strides.append(np.full(len(axis) ** 2, stride, np.float32))
    return np.concatenate(centres), np.concatenate(strides)
