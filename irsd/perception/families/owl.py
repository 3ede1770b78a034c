"""OWL-ViT and OWLv2: boxes for words, each patch of the picture compared with each text (Minderer et al. 2022, 2023).

File: ``pixel_values`` [1, 3, S, S], ``input_ids`` and ``attention_mask`` [n, 16] -> ``logits`` [1, P, n], ``pred_boxes`` [1, P, 4].
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from irsd.core.errors import ModelError
from irsd.perception.families.contract import boxes_in_picture, require, sigmoid
from irsd.perception.models import Session
from irsd.perception.pixels import CLIP_LEVELS, padded_square, planes, resize
from irsd.perception.roles import Boxes
from irsd.perception.tokens import Tokens

CONTEXT = 16
_PAD = 0
_INPUTS = ("pixel_values", "input_ids", "attention_mask")
_OUTPUTS = ("logits", "pred_boxes")
TEMPLATE = "a photo of a {}"


class Owl:
    """A Detector. Each patch votes for the prompt that suits it best; overlapping boxes are left to the caller."""

    def __init__(
        self,
        session: Session,
        tokens: Tokens,
        *,
        side_px: int = 768,
        padded: bool = False,
        threshold: float = 0.1,
        template: str = TEMPLATE,
    ) -> None:
        """tokens: cut at ``CONTEXT``. side_px, padded: 768 and False for OWL-ViT, which squashes a picture to a square; 960 and
        True for OWLv2, which pads it to one. template: what a prompt is put into, with ``{}`` in its place.
        ModelError when the file is no such model, found by running it once with one prompt and once with three."""
        require(session, _INPUTS, _OUTPUTS)
        self._session, self._tokens, self._side_px, self._padded = session, tokens, side_px, padded
        self._threshold, self._template = threshold, template
        for count in (1, 3):
            self._run(np.zeros((8, 8, 3), np.uint8), ("a",) * count)

    def detect(self, image_rgb: NDArray[np.uint8], prompts: tuple[str, ...]) -> Boxes:
        """See ``roles.Detector``. Scores are those of the prompt that won the patch."""
        if not prompts:
            return Boxes(np.empty((0, 4), np.float32), np.empty(0, np.float32), np.empty(0, np.int32))
        logits, centres = self._run(image_rgb, prompts)
        prompt = logits.argmax(1)
        scores = sigmoid(logits.max(1))
        height, width = image_rgb.shape[:2]
        # Boxes are fractions of what the network saw: of the picture, or of the square around it.
        scale = (float(max(width, height)),) * 2 if self._padded else (float(width), float(height))
        boxes, inside = boxes_in_picture(centres, scale, width, height)
        keep = inside & (scores > self._threshold)
        return Boxes(boxes[keep], scores[keep], prompt[keep].astype(np.int32))

    def _run(
        self, image_rgb: NDArray[np.uint8], prompts: tuple[str, ...]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Logits [P, n] of n prompts at P patches, and the box of each patch [P, 4] in fractions."""
        if self._padded:
            pixels = padded_square(image_rgb, self._side_px, CLIP_LEVELS)
        else:
            pixels = planes(resize(image_rgb, self._side_px, self._side_px, "bicubic"), CLIP_LEVELS)
        ids, mask = self._tokens.padded([self._template.format(prompt) for prompt in prompts], _PAD)
        logits, boxes = self._session.run(dict(zip(_INPUTS, (pixels[None], ids, mask), strict=True)), _OUTPUTS)
        patches = logits.shape[1] if logits.ndim == 3 else 0
        if logits.shape != (1, patches, len(prompts)) or boxes.shape != (1, patches, 4) or not patches:
            raise ModelError(
                f"{self._session.path.name}: logits {logits.shape} and boxes {boxes.shape} for {len(prompts)} prompts"
            )
        return logits[0], boxes[0]
