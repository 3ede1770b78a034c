"""CLIP and MobileCLIP: pictures and texts in one space (Radford et al. 2021, Vasu et al. 2024).

Files: one per tower (``pixel_values`` -> ``image_embeds``; ``input_ids`` -> ``text_embeds``, raw), or both in one, which then has the
inputs of both and gives unit vectors. One object can't tell them apart by their outputs, so vectors are normalised here in any case.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irsd.perception.families.contract import require, unit_rows
from irsd.perception.models import Session
from irsd.perception.pixels import CLIP_LEVELS, Filter, Levels, crop_square, planes
from irsd.perception.tokens import Tokens

_PIXELS, _IDS, _MASK = "pixel_values", "input_ids", "attention_mask"
_IMAGE, _TEXT = "image_embeds", "text_embeds"


class ClipImageEncoder:
    """An ImageEncoder."""

    def __init__(
        self, session: Session, name: str, *, side_px: int = 224, kind: Filter = "bicubic", levels: Levels = CLIP_LEVELS
    ) -> None:
        """name: of the space that the text encoder of the same model shares. The defaults are CLIP's; MobileCLIP-S0 takes
        256 pixels, bilinear and UNIT_LEVELS. ModelError when the file is no such model."""
        require(session, (_PIXELS,), (_IMAGE,))
        self._session, self._side_px, self._kind, self._levels = session, side_px, kind, levels
        # A file with both towers wants a text, too: the shortest there is.
        self._text = {n: np.ones((1, 2), np.int64) for n in (_IDS, _MASK) if n in session.inputs}
        self.name = name
        self.dimension = self._run(np.zeros((1, 3, side_px, side_px), np.float32)).shape[1]

    def encode_images(self, crops: Sequence[NDArray[np.uint8]]) -> NDArray[np.float32]:
        """float32 [n, dimension], unit rows, of n crops uint8 [h, w, 3] of any size."""
        out = np.empty((len(crops), self.dimension), np.float32)
        for row, crop in enumerate(crops):
            out[row] = self._run(planes(crop_square(crop, self._side_px, self._kind), self._levels)[None])[0]
        return out

    def _run(self, pixels: NDArray[np.float32]) -> NDArray[np.float32]:
        (vectors,) = self._session.run({_PIXELS: pixels, **self._text}, (_IMAGE,))
        return unit_rows(vectors, len(pixels), self._session)


class ClipTextEncoder:
    """A TextEncoder. One text a run: with int8 files a neighbour in the batch would change the last digits of a vector."""

    def __init__(
        self, session: Session, name: str, tokens: Tokens, *, pad_id: int | None = None, side_px: int = 224
    ) -> None:
        """pad_id: None for CLIP, which reads unpadded texts; 0 for MobileCLIP, whose texts always have full length.
        side_px: of the picture that a file with both towers wants."""
        require(session, (_IDS,), (_TEXT,))
        self._session, self._tokens, self._pad_id = session, tokens, pad_id
        self._picture = {_PIXELS: np.zeros((1, 3, side_px, side_px), np.float32)} if _PIXELS in session.inputs else {}
        self.name = name
        self.dimension = self._run("a").shape[1]

    def encode_texts(self, texts: Sequence[str]) -> NDArray[np.float32]:
        """float32 [n, dimension], unit rows, of n texts; what exceeds the context of the model is cut."""
        out = np.empty((len(texts), self.dimension), np.float32)
        for row, text in enumerate(texts):
            out[row] = self._run(text)[0]
        return out

    def _run(self, text: str) -> NDArray[np.float32]:
        if self._pad_id is None:
            ids = self._tokens.ids(text)[None]
        else:
            ids, _ = self._tokens.padded([text], self._pad_id)
        feeds: dict[str, NDArray[Any]] = {_IDS: ids, **self._picture}
        if _MASK in self._session.inputs:
            feeds[_MASK] = np.ones_like(ids)
        (vectors,) = self._session.run(feeds, (_TEXT,))
        return unit_rows(vectors, 1, self._session)
