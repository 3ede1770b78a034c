"""MobileSAM (Zhang et al. 2023) with the decoder of SAM's own ONNX export: one prompt a run, masks as large as the picture.

Two encoders are about. ``images`` [1, 3, side, side] wants pixels as SAM's. The public ``input_image`` [h, w, 3] (Acly/MobileSAM)
wants the resized picture as bytes in float, normalises it, then pads it with zeros. The mean colour is what becomes zero there: a
square padded with it is right for files of this kind that pad and for those that don't.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from irsd.perception.families.contract import require
from irsd.perception.families.prompted import (
    BOX_FIRST,
    BOX_LAST,
    PADDING,
    POINT,
    SIDE_PX,
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
from irsd.perception.pixels import IMAGENET_LEVELS, resize

_PLANES, _BYTES = "images", "input_image"
_FEATURES = "image_embeddings"
_PROMPT = ("point_coords", "point_labels", "mask_input", "has_mask_input", "orig_im_size")
_OUTPUTS = ("masks", "iou_predictions")
_WHOLE_CHOICE = 4  # masks of a decoder that leaves the choice to us; its first is for prompts of many points


class MobileSam(PromptedSegmenter):
    """A Segmenter."""

    def __init__(self, encoder: Session, decoder: Session) -> None:
        """ModelError when the files are no such pair."""
        self._input = _BYTES if _BYTES in encoder.inputs else _PLANES
        require(encoder, (self._input,), (_FEATURES,))
        require(decoder, (_FEATURES, *_PROMPT), _OUTPUTS)
        self._encoder, self._decoder = encoder, decoder
        self._side_px = SIDE_PX if self._input == _BYTES else square_side(encoder, _PLANES)

    def encode(self, image_rgb: NDArray[np.uint8]) -> Encoded:
        frame = Frame(image_rgb.shape[0], image_rgb.shape[1], self._side_px)
        pixels = square_bytes(image_rgb, frame) if self._input == _BYTES else square_pixels(image_rgb, frame)[None]
        (features,) = self._encoder.run({self._input: pixels}, (_FEATURES,))
        return Encoded({_FEATURES: features}, frame)

    def decode_boxes(self, encoded: Encoded, boxes_px: Floats) -> Candidates:
        return self._decode(encoded, boxes_px.reshape(-1, 2, 2), (BOX_FIRST, BOX_LAST))

    def decode_points(self, encoded: Encoded, points_px: Floats) -> Candidates:
        # A point without a box needs a second, empty one: the network was trained with either.
        points = np.stack([points_px, np.zeros_like(points_px)], 1)
        return self._decode(encoded, points, (POINT, PADDING))

    def _decode(self, encoded: Encoded, points_px: Floats, labels: tuple[int, int]) -> Candidates:
        """Of prompts [n, 2, 2] with these labels, one run each."""
        frame, features = encoded.frame, encoded.features[_FEATURES]
        common = {
            _FEATURES: features,
            "point_labels": np.array([labels], np.float32),
            "mask_input": np.zeros((1, 1, 4 * features.shape[-2], 4 * features.shape[-1]), np.float32),
            "has_mask_input": np.zeros(1, np.float32),
            "orig_im_size": np.array([frame.height, frame.width], np.float32),
        }
        found = []
        for points in frame.to_network(points_px):
            masks, ious = self._decoder.run({**common, "point_coords": points[None]}, _OUTPUTS)
            first = 1 if ious.size == _WHOLE_CHOICE else 0
            found.append(candidates(masks[:, first:], ious[:, first:], 1, self._decoder.path.name))
        return Candidates(np.concatenate([one.logits for one in found]), np.concatenate([one.ious for one in found]))


def square_bytes(image_rgb: NDArray[np.uint8], frame: Frame) -> Floats:
    """float32 [side, side, 3] in 0..255: resized as ``frame`` says, then padded with the mean colour."""
    height, width = frame.resized
    out = np.empty((frame.side_px, frame.side_px, 3), np.float32)
    out[:] = np.array(IMAGENET_LEVELS.mean, np.float32) * 255
    out[:height, :width] = resize(image_rgb, width, height, "bilinear")
    return out
