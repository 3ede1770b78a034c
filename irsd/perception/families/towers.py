"""Encoders with one tower for pictures and one for texts: what CLIP, MobileCLIP and SigLIP have in common.

A file may hold one tower or both; one with both wants a text with each picture and a picture with each text, and gets a blank one.
Vectors are normalised here in any case: files with one tower give them raw, files with both mostly not.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irsd.core.errors import ModelError
from irsd.perception.families.contract import require
from irsd.perception.models import Session

PIXELS, IDS, MASK = "pixel_values", "input_ids", "attention_mask"


class ImageTower:
    """An ImageEncoder."""

    def __init__(
        self,
        session: Session,
        name: str,
        outputs: tuple[str, ...],
        prepare: Callable[[NDArray[np.uint8]], NDArray[np.float32]],
        batch: int,
    ) -> None:
        """outputs: possible names of the vector, the first that the file has is it. prepare: picture to float32 [3, S, S].
        ModelError when the file is no such model, found by running it once."""
        output = next((name for name in outputs if name in session.outputs), outputs[0])
        require(session, (PIXELS,), (output,))
        self._session, self._output, self._prepare = session, output, prepare
        declared = next(tensor.shape[0] for tensor in session.input_tensors if tensor.name == PIXELS)
        self._batch = declared if isinstance(declared, int) else batch
        self._text = {n: np.ones((1, 2), np.int64) for n in (IDS, MASK) if n in session.inputs}
        self.name = name
        self.dimension = self._run([np.zeros((8, 8, 3), np.uint8)]).shape[1]

    def encode_images(self, crops: Sequence[NDArray[np.uint8]]) -> NDArray[np.float32]:
        """float32 [n, dimension], unit rows, of n crops uint8 [h, w, 3] of any size."""
        out = np.empty((len(crops), self.dimension), np.float32)
        for first in range(0, len(crops), self._batch):
            out[first : first + self._batch] = self._run(crops[first : first + self._batch])
        return out

    def _run(self, crops: Sequence[NDArray[np.uint8]]) -> NDArray[np.float32]:
        pixels = np.stack([self._prepare(crop) for crop in crops])
        (vectors,) = self._session.run({PIXELS: pixels, **self._text}, (self._output,))
        return unit_rows(vectors, len(crops), self._session)


class TextTower:
    """A TextEncoder. One text a run: with int8 files a neighbour in the batch changes the last digits of a vector."""

    def __init__(
        self,
        session: Session,
        name: str,
        outputs: tuple[str, ...],
        tokenize: Callable[[str], NDArray[np.int64]],
        side_px: int,
    ) -> None:
        """tokenize: text to ids int64 [s]. side_px: of the blank picture for a file with both towers. Else as ImageTower."""
        output = next((name for name in outputs if name in session.outputs), outputs[0])
        require(session, (IDS,), (output,))
        self._session, self._output, self._tokenize = session, output, tokenize
        blank = np.zeros((1, 3, side_px, side_px), np.float32)
        self._picture = {PIXELS: blank} if PIXELS in session.inputs else {}
        self.name = name
        self.dimension = self._run("a").shape[1]

    def encode_texts(self, texts: Sequence[str]) -> NDArray[np.float32]:
        """float32 [n, dimension], unit rows, of n texts; what exceeds the context of the model is cut."""
        out = np.empty((len(texts), self.dimension), np.float32)
        for row, text in enumerate(texts):
            out[row] = self._run(text)[0]
        return out

    def _run(self, text: str) -> NDArray[np.float32]:
        ids = self._tokenize(text)[None]
        feeds: dict[str, NDArray[Any]] = {IDS: ids, **self._picture}
        if MASK in self._session.inputs:
            feeds[MASK] = np.ones_like(ids)
        (vectors,) = self._session.run(feeds, (self._output,))
        return unit_rows(vectors, 1, self._session)


def unit_rows(vectors: NDArray[np.float32], rows: int, session: Session) -> NDArray[np.float32]:
    """float32 [rows, D] of unit length. ModelError unless the network gave rows finite vectors other than zero."""
    if vectors.ndim != 2 or len(vectors) != rows:
        raise ModelError(f"{session.path.name}: vectors of shape {vectors.shape} for {rows} inputs")
    lengths = np.linalg.norm(vectors.astype(np.float64), axis=1, keepdims=True)
    if not (np.isfinite(lengths) & (lengths > 0)).all():
        raise ModelError(f"{session.path.name}: a vector of no or infinite length")
    return np.asarray(vectors / lengths, np.float32)
