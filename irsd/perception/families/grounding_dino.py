"""Grounding DINO: boxes for the phrases of a caption (Liu et al. 2023).

File: ``pixel_values`` [1, 3, H, W], ``pixel_mask`` [1, H, W], ``input_ids``, ``token_type_ids``, ``attention_mask`` [1, s] ->
``logits`` [1, Q, 256], one per token of the caption, ``pred_boxes`` [1, Q, 4]. The caption is ``chair. bedside table. tv.``; the
network lets the tokens of a phrase see each other only. An export by tracing alone freezes that for the number of phrases it was
traced with, and gives wrong scores for any other without complaint: hence the self-test.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irsd.core.errors import ModelError
from irsd.perception.families.contract import boxes_in_picture, require, sigmoid
from irsd.perception.models import Session
from irsd.perception.pixels import IMAGENET_LEVELS, planes, resize, within
from irsd.perception.roles import Boxes
from irsd.perception.tokens import Tokens

CONTEXT = 256
_CLS, _SEP, _DOT = 101, 102, 1012  # of BERT's uncased vocabulary; the graph looks for these numbers
_INPUTS = ("pixel_values", "pixel_mask", "input_ids", "token_type_ids", "attention_mask")
_OUTPUTS = ("logits", "pred_boxes")
_TEST_SIZES = ((224, 288), (288, 224))
_TEST_TOLERANCE = 0.01  # in probability: int8 files differ by some thousandths between orders of one caption


class GroundingDino:
    """A Detector. Each box gets the phrase that suits it best; overlapping boxes are left to the caller."""

    def __init__(
        self,
        session: Session,
        tokens: Tokens,
        *,
        shortest_px: int = 800,
        longest_px: int = 1333,
        fixed_px: tuple[int, int] | None = None,
        threshold: float = 0.3,
    ) -> None:
        """tokens: BERT uncased, cut at ``CONTEXT``. A picture is resized to shortest_px, at most longest_px, or squashed to fixed_px
        (height, width) where the file takes only that; sizes that the file declares come before both.
        ModelError when the file is no such model or fails the self-test."""
        require(session, _INPUTS, _OUTPUTS)
        if [int(n) for n in tokens.ids(".")] != [_CLS, _DOT, _SEP]:
            raise ModelError(f"{session.path.name} wants BERT's uncased vocabulary; this tokenizer is another")
        declared = next(t.shape for t in session.input_tensors if t.name == "pixel_values")[2:]
        if len(declared) == 2 and isinstance(declared[0], int) and isinstance(declared[1], int):
            fixed_px = (declared[0], declared[1])
        self._session, self._tokens, self._threshold = session, tokens, threshold
        self._shortest_px, self._longest_px, self._fixed_px = shortest_px, longest_px, fixed_px
        self._self_test()

    def detect(self, image_rgb: NDArray[np.uint8], prompts: tuple[str, ...]) -> Boxes:
        """See ``roles.Detector``. A phrase scores as its best token. What exceeds one caption goes into further runs."""
        height, width = image_rgb.shape[:2]
        size = self._fixed_px or within(height, width, self._shortest_px, self._longest_px)
        found = [Boxes(np.empty((0, 4), np.float32), np.empty(0, np.float32), np.empty(0, np.int32))]
        phrases = [self._phrase(prompt) for prompt in prompts]
        pixels = planes(resize(image_rgb, size[1], size[0], "bilinear"), IMAGENET_LEVELS)[None]
        for numbers in _captions(phrases):
            scores, centres = self._run(pixels, [phrases[number] for number in numbers])
            best = scores.max(1)
            boxes, inside = boxes_in_picture(centres, (float(width), float(height)), width, height)
            keep = inside & (best > self._threshold)
            prompt = np.array(numbers, np.int32)[scores[keep].argmax(1)]
            found.append(Boxes(boxes[keep], best[keep], prompt))
        return Boxes(
            np.concatenate([part.boxes_px for part in found]),
            np.concatenate([part.scores for part in found]),
            np.concatenate([part.prompt for part in found]),
        )

    def _phrase(self, prompt: str) -> NDArray[np.int64]:
        """A prompt's tokens, without the opening and closing ones, at most as many as a caption holds; none for an empty prompt."""
        return self._tokens.ids(re.sub(r"[.?]", " ", prompt))[1:-1][: CONTEXT - 3]  # both end a phrase for the network

    def _run(
        self, pixels: NDArray[np.float32], phrases: Sequence[NDArray[np.int64]]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Scores [Q, n] of n phrases, and boxes [Q, 4] in fractions of the picture."""
        ids = np.concatenate([[_CLS], *(piece for phrase in phrases for piece in (phrase, [_DOT])), [_SEP]])
        ids = ids.astype(np.int64)[None]
        mask = np.ones((1, *pixels.shape[2:]), np.int64)
        feeds: dict[str, NDArray[Any]] = dict(
            zip(_INPUTS, (pixels, mask, ids, np.zeros_like(ids), np.ones_like(ids)), strict=True)
        )
        logits, boxes = self._session.run(feeds, _OUTPUTS)
        queries = logits.shape[1] if logits.ndim == 3 else 0
        if logits.shape[0] != 1 or not queries or logits.shape[2] < ids.shape[1] or boxes.shape != (1, queries, 4):
            raise ModelError(
                f"{self._session.path.name}: logits {logits.shape}, boxes {boxes.shape} for {ids.shape[1]} tokens"
            )
        starts = 1 + np.cumsum([0, *(len(phrase) + 1 for phrase in phrases[:-1])])
        spans = [logits[0, :, a : a + len(phrase)].max(1) for a, phrase in zip(starts, phrases, strict=True)]
        return sigmoid(np.stack(spans, 1)), boxes[0]

    def _self_test(self) -> None:
        """ModelError unless the file serves one phrase and three, wide pictures and tall ones, and does not care which phrase comes
        first: phrases do not see each other, so their scores may not depend on the order."""
        phrases = [self._phrase(text) for text in ("chair", "bedside table", "tv")]
        for size in dict.fromkeys((self._fixed_px,) if self._fixed_px else _TEST_SIZES):
            y, x = np.mgrid[: size[0], : size[1]]
            picture = np.stack([x * 3 + y, (x // 40 + y // 30) * 60, x * y // 50], 2).astype(np.uint8)
            pixels = planes(picture, IMAGENET_LEVELS)[None]
            try:
                self._run(pixels, phrases[:1])
                forward = self._run(pixels, phrases)[0]
                turned = self._run(pixels, phrases[1:] + phrases[:1])[0][:, [2, 0, 1]]
            except ModelError as error:
                raise ModelError(
                    f"{self._session.path.name} serves one number of phrases or one size of pictures only: {error}"
                ) from error
            # Sorted, since queries of nearly equal rank may change places.
            worst = float(np.abs(np.sort(forward, 0) - np.sort(turned, 0)).max())
            if not worst <= _TEST_TOLERANCE:
                raise ModelError(
                    f"{self._session.path.name}: scores depend on the order of phrases (by {worst:.3f}); "
                    "the number of phrases was frozen when the file was made"
                )


def _captions(phrases: Sequence[NDArray[np.int64]]) -> list[list[int]]:
    """Numbers of the phrases, empty ones left out, in captions of at most ``CONTEXT`` tokens."""
    captions: list[list[int]] = []
    room = 0
    for number, phrase in enumerate(phrases):
        if not len(phrase):
            continue
        if len(phrase) + 1 > room:
            captions.append([])
            room = CONTEXT - 2
        captions[-1].append(number)
        room -= len(phrase) + 1
    return captions
