"""One run of every model on noise: opens what opens late, and shows what runs cost before the first picture comes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from irsd.perception.budget import Stage
from irsd.perception.seer import Trial

if TYPE_CHECKING:
    from irsd.perception.chain import ModelSet

_HW = (480, 640)


def trials(models: ModelSet, vocabulary: Sequence[str]) -> Iterator[Trial]:
    """(stage, items, the run) of all models that there are, each with few and with more items where the number matters."""
    rng = np.random.default_rng(0)
    image = rng.integers(0, 256, (*_HW, 3), dtype=np.uint8)
    if models.tagger is not None:
        tagger = models.tagger
        yield Stage.TAG, 1, lambda: tagger.tag(image)
    if models.detector is not None:
        detector = models.detector
        yield Stage.DETECT, 1, lambda: detector.detect(image, tuple(vocabulary))
        yield Stage.DETECT, 1, lambda: detector.detect(image, tuple(vocabulary))
    elif models.everything is not None:
        everything = models.everything
        yield Stage.SEGMENT, 1, lambda: everything.segment_all(image)
    if models.detector is not None and models.segmenter is not None:
        segmenter = models.segmenter
        corner = rng.uniform(0, 300, (4, 2))
        boxes = np.concatenate([corner, corner + 100.0], 1).astype(np.float32)
        yield Stage.SEGMENT, 1, lambda: segmenter.segment(image, boxes[:1])
        yield Stage.SEGMENT, 4, lambda: segmenter.segment(image, boxes)
    for count in (3, 6):
        crops = [image[:200, :200]] * count
        yield Stage.EMBED, count, lambda crops=crops: models.image_encoder.encode_images(crops)  # type: ignore[misc]
