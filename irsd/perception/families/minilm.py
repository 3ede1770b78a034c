"""all-MiniLM-L6-v2 as a TextEncoder: words among words; it shares its space with no picture encoder."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from irsd.perception.encoder import DIMENSION
from irsd.perception.encoder import TextEncoder as MiniLm


class MiniLmTextEncoder:
    """A TextEncoder over the encoder that labels and queries use."""

    dimension = DIMENSION

    def __init__(self, encoder: MiniLm, name: str) -> None:
        self._encoder = encoder
        self.name = name

    def encode_texts(self, texts: Sequence[str]) -> NDArray[np.float32]:
        """float32 [n, 384], unit rows, of n texts; cut at 128 tokens."""
        return self._encoder.encode(texts)
