"""EfficientSAM (Xiong et al. 2023) by its repository's split files: pictures of any size in 0..1, prompts in the picture's own pixels.

Resizing (proportions not kept), normalising and enlarging the masks are part of the graphs. The decoder reads any number of prompts at
once, or one where the export has frozen it (the public files).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from irsd.perception.families.contract import require
from irsd.perception.families.prompted import (
    BATCH,
    BOX_FIRST,
    BOX_LAST,
    POINT,
    SIDE_PX,
    Candidates,
    Encoded,
    Floats,
    Frame,
    PromptedSegmenter,
    candidates,
)
from irsd.perception.models import Session
from irsd.perception.pixels import UNIT_LEVELS, planes

_IMAGE, _FEATURES = "batched_images", "image_embeddings"
_POINTS, _LABELS, _SIZE = "batched_point_coords", "batched_point_labels", "orig_im_size"
_OUTPUTS = ("output_masks", "iou_predictions")


class EfficientSam(PromptedSegmenter):
    """A Segmenter."""

    def __init__(self, encoder: Session, decoder: Session) -> None:
        """ModelError when the files are no such pair."""
        require(encoder, (_IMAGE,), (_FEATURES,))
        require(decoder, (_FEATURES, _POINTS, _LABELS, _SIZE), _OUTPUTS)
        self._encoder, self._decoder = encoder, decoder
        shape = next(tensor.shape for tensor in decoder.input_tensors if tensor.name == _POINTS)
        self._at_once = shape[1] if isinstance(shape[1], int) else BATCH

    def encode(self, image_rgb: NDArray[np.uint8]) -> Encoded:
        (features,) = self._encoder.run({_IMAGE: planes(image_rgb, UNIT_LEVELS)[None]}, (_FEATURES,))
        # The masks come out in the picture's size, so the square is of no account.
        return Encoded({_FEATURES: features}, Frame(image_rgb.shape[0], image_rgb.shape[1], SIDE_PX))

    def decode_boxes(self, encoded: Encoded, boxes_px: Floats) -> Candidates:
        return self._decode(encoded, boxes_px.reshape(-1, 2, 2), (BOX_FIRST, BOX_LAST))

    def decode_points(self, encoded: Encoded, points_px: Floats) -> Candidates:
        return self._decode(encoded, points_px[:, None], (POINT,))

    def _decode(self, encoded: Encoded, points_px: Floats, labels: tuple[int, ...]) -> Candidates:
        """Of prompts [n, p, 2] with these p labels each."""
        size = np.array([encoded.frame.height, encoded.frame.width], np.int64)
        found = []
        for first in range(0, len(points_px), self._at_once):
            some = points_px[first : first + self._at_once]
            feeds: dict[str, NDArray[Any]] = {
                **encoded.features,
                _POINTS: some[None],
                _LABELS: np.tile(np.array(labels, np.float32), (1, len(some), 1)),
                _SIZE: size,
            }
            masks, ious = self._decoder.run(feeds, _OUTPUTS)
            found.append(candidates(masks, ious, len(some), self._decoder.path.name))
        return Candidates(np.concatenate([one.logits for one in found]), np.concatenate([one.ious for one in found]))
