"""SAM and SlimSAM as optimum splits them: ``vision_encoder`` and ``prompt_encoder_mask_decoder``.

The usual decoder takes points only: exporting drops what embeds boxes, and labels 2 and 3 mean nothing to it. A box is then asked
for as its centre, with the corners just outside of it as background, and the mask is cut to the box: a stopgap. Decoders with an
input ``input_boxes`` (revision ``boxes`` of Xenova/slimsam-77-uniform) take the box itself.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from irsd.core.errors import ModelError
from irsd.perception.families.contract import require
from irsd.perception.families.prompted import (
    POINT,
    Candidates,
    Encoded,
    Floats,
    Frame,
    PromptedSegmenter,
    candidates,
    square_pixels,
    square_side,
)
from irsd.perception.models import Session
from irsd.perception.roles import Masks

_PIXELS = "pixel_values"
_FEATURES = ("image_embeddings", "image_positional_embeddings")
_POINTS, _LABELS, _BOXES = "input_points", "input_labels", "input_boxes"
_IOUS, _MASKS = "iou_scores", "pred_masks"
_BACKGROUND, _IGNORED = 0, -10
_OUTSIDE_SHARE = 0.1  # of the box's size: how far outside its corners the background points lie


class Sam(PromptedSegmenter):
    """A Segmenter."""

    def __init__(self, encoder: Session, decoder: Session) -> None:
        """ModelError when the files are no such pair. takes_boxes: boxes are what the decoder wants, and points alone are not."""
        self.takes_boxes = _BOXES in decoder.inputs
        require(encoder, (_PIXELS,), _FEATURES)
        require(decoder, _FEATURES if self.takes_boxes else (_POINTS, _LABELS, *_FEATURES), (_IOUS, _MASKS))
        self._encoder, self._decoder = encoder, decoder
        self._side_px = square_side(encoder, _PIXELS)

    def segment(self, image_rgb: NDArray[np.uint8], boxes_px: Floats) -> Masks:
        found = super().segment(image_rgb, boxes_px)
        if self.takes_boxes:
            return found
        return Masks(found.masks & inside(boxes_px, image_rgb.shape[:2]), found.scores)

    def encode(self, image_rgb: NDArray[np.uint8]) -> Encoded:
        frame = Frame(image_rgb.shape[0], image_rgb.shape[1], self._side_px)
        values = self._encoder.run({_PIXELS: square_pixels(image_rgb, frame)[None]}, _FEATURES)
        return Encoded(dict(zip(_FEATURES, values, strict=True)), frame)

    def decode_boxes(self, encoded: Encoded, boxes_px: Floats) -> Candidates:
        if not self.takes_boxes:
            return self._decode_points(
                encoded, *points_for_boxes(boxes_px, (encoded.frame.height, encoded.frame.width))
            )
        prompts = len(boxes_px)
        feeds: dict[str, NDArray[Any]] = {
            _BOXES: encoded.frame.to_network(boxes_px.reshape(-1, 2, 2)).reshape(1, -1, 4)
        }
        if _POINTS in self._decoder.inputs:  # a file that takes both: no points
            feeds |= {_POINTS: np.zeros((1, prompts, 0, 2), np.float32), _LABELS: np.zeros((1, prompts, 0), np.int64)}
        return self._decode(encoded, prompts, feeds)

    def decode_points(self, encoded: Encoded, points_px: Floats) -> Candidates:
        return self._decode_points(encoded, points_px[:, None], np.full((len(points_px), 1), POINT, np.int64))

    def _decode_points(self, encoded: Encoded, points_px: Floats, labels: NDArray[np.int64]) -> Candidates:
        if self.takes_boxes:
            raise ModelError(f"{self._decoder.path.name} wants boxes and takes no points without them")
        feeds: dict[str, NDArray[Any]] = {
            _POINTS: encoded.frame.to_network(points_px)[None],
            _LABELS: labels[None],
        }
        return self._decode(encoded, len(points_px), feeds)

    def _decode(self, encoded: Encoded, prompts: int, feeds: dict[str, NDArray[Any]]) -> Candidates:
        ious, masks = self._decoder.run({**feeds, **encoded.features}, (_IOUS, _MASKS))
        return candidates(masks, ious, prompts, self._decoder.path.name)


def points_for_boxes(boxes_px: Floats, size: tuple[int, int]) -> tuple[Floats, NDArray[np.int64]]:
    """Boxes float32 [n, 4] as points float32 [n, 5, 2] and labels int64 [n, 5]: the centre, and the four corners a little outside
    of the box as background; a corner that leaves the picture of size (height, width) is none."""
    low, high = boxes_px[:, :2], boxes_px[:, 2:]
    away = _OUTSIDE_SHARE * (high - low)
    x0, y0, x1, y1 = np.concatenate([low - away, high + away], 1).T
    corners = np.stack([np.stack([x, y], 1) for y in (y0, y1) for x in (x0, x1)], 1)
    height, width = size
    seen = (corners >= 0).all(-1) & (corners < np.array([width, height])).all(-1)
    points = np.concatenate([(low + high)[:, None] / 2, corners], 1)
    labels = np.concatenate([np.full((len(points), 1), POINT), np.where(seen, _BACKGROUND, _IGNORED)], 1)
    return np.asarray(points, np.float32), np.asarray(labels, np.int64)


def inside(boxes_px: Floats, size: tuple[int, int]) -> NDArray[np.bool_]:
    """bool [n, height, width]: the pixels whose centres lie in each box."""
    rows, columns = (np.arange(side, dtype=np.float32) + 0.5 for side in size)
    x0, y0, x1, y1 = (side[:, None] for side in boxes_px.T)
    down, across = (rows >= y0) & (rows < y1), (columns >= x0) & (columns < x1)
    return np.asarray(down[:, :, None] & across[:, None, :])
