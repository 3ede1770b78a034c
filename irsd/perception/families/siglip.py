"""SigLIP: pictures and texts in one space, each pair judged by itself (Zhai et al. 2023).

Files: ``pixel_values`` -> ``pooler_output`` and ``input_ids`` -> ``pooler_output``; one with both towers calls them
``image_embeds`` and ``text_embeds``.
"""

from __future__ import annotations

import re
import string

import numpy as np
from numpy.typing import NDArray

from irsd.perception.families.towers import ImageTower, TextTower
from irsd.perception.models import Session
from irsd.perception.pixels import HALF_LEVELS, planes, resize
from irsd.perception.tokens import Tokens

CONTEXT = 64
_NO_PUNCTUATION = str.maketrans("", "", string.punctuation)


class SiglipImageEncoder(ImageTower):
    """An ImageEncoder."""

    def __init__(self, session: Session, name: str, *, side_px: int = 224, batch: int = 8) -> None:
        """name: of the space that the text encoder of the same model shares. batch: most crops a run. ModelError when the
        file is no such model."""

        def prepare(crop: NDArray[np.uint8]) -> NDArray[np.float32]:
            return planes(resize(crop, side_px, side_px, "bicubic"), HALF_LEVELS)  # whole crop, proportions not kept

        super().__init__(session, name, ("image_embeds", "pooler_output"), prepare, batch)


class SiglipTextEncoder(TextTower):
    """A TextEncoder. The padding to exactly 64 tokens is part of what the model was trained on: no mask hides it."""

    def __init__(self, session: Session, name: str, tokens: Tokens, *, pad_id: int = 1, side_px: int = 224) -> None:
        """tokens: cut at ``CONTEXT``. pad_id: 1, ``</s>``. side_px: of the picture that a file with both towers wants."""

        def tokenize(text: str) -> NDArray[np.int64]:
            ids, _ = tokens.padded([canonical(text)], pad_id)
            return np.asarray(ids[0])

        super().__init__(session, name, ("text_embeds", "pooler_output"), tokenize, side_px)


def canonical(text: str) -> str:
    """As the texts were in training: lower case, no ASCII punctuation, single spaces (big_vision, ``_canonicalize``)."""
    return re.sub(r"\s+", " ", text.lower().translate(_NO_PUNCTUATION)).strip()
