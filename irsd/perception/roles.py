"""What a perception model can be to us. Adapters of model families keep these promises; the chain asks for nothing else.

Everywhere: ``image_rgb`` uint8 [H, W, 3]; ``boxes_px`` float32 [n, 4] as x0, y0, x1, y1 in the pixels of that image; embeddings
float32 [n, D] with rows of unit length. A model that fails raises ModelError. ``StructureModel`` of mapping is a role too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Tags:
    """What a picture shows, best first: labels, and scores float32 [n] in 0..1."""

    labels: tuple[str, ...]
    scores: NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Boxes:
    """Where it shows it: boxes_px float32 [n, 4]; scores float32 [n] in 0..1; prompt int32 [n], index into the prompts asked."""

    boxes_px: NDArray[np.float32]
    scores: NDArray[np.float32]
    prompt: NDArray[np.int32]


@dataclass(frozen=True, slots=True)
class Masks:
    """Which pixels: masks bool [n, H, W]; scores float32 [n], the IoU that the model predicts for each."""

    masks: NDArray[np.bool_]
    scores: NDArray[np.float32]


class Tagger(Protocol):
    """Names what a picture shows."""

    def tag(self, image_rgb: NDArray[np.uint8]) -> Tags:
        """The tags above the model's own thresholds; possibly none."""
        ...


class Detector(Protocol):
    """Boxes for words."""

    def detect(self, image_rgb: NDArray[np.uint8], prompts: tuple[str, ...]) -> Boxes:
        """The boxes above the threshold, before any suppression of overlaps, for prompts such as ``office chair``."""
        ...


class Segmenter(Protocol):
    """Masks for boxes."""

    def segment(self, image_rgb: NDArray[np.uint8], boxes_px: NDArray[np.float32]) -> Masks:
        """One mask per box, in their order. The picture is encoded once, the boxes are decoded in batches where the file can."""
        ...


class ImageEncoder(Protocol):
    """Pictures as vectors. ``name`` says which space they live in: a text encoder of the same name shares it."""

    @property
    def name(self) -> str: ...

    @property
    def dimension(self) -> int: ...

    def encode_images(self, crops: Sequence[NDArray[np.uint8]]) -> NDArray[np.float32]:
        """float32 [n, D], unit rows, of n crops uint8 [h, w, 3] of any size."""
        ...


class TextEncoder(Protocol):
    """Words as vectors."""

    @property
    def name(self) -> str: ...

    @property
    def dimension(self) -> int: ...

    def encode_texts(self, texts: Sequence[str]) -> NDArray[np.float32]:
        """float32 [n, D], unit rows, of n texts."""
        ...
