"""Texts as the numbers a network reads: the model's own tokenizer.json, cut to its context, padded only where the model asks."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from tokenizers import Tokenizer

from irsd.core.errors import ModelError


class Tokens:
    """A tokenizer with the context length of its model. Texts that are too long are cut; their closing token stays."""

    def __init__(self, tokenizer: Tokenizer, max_tokens: int) -> None:
        """tokenizer is taken over: the padding that its file may ask for is switched off."""
        tokenizer.no_padding()
        tokenizer.enable_truncation(max_tokens)
        self._tokenizer = tokenizer
        self.max_tokens = max_tokens

    @classmethod
    def load(cls, path: Path, max_tokens: int) -> Tokens:
        """The tokenizer.json of a model. ModelError when it is missing or is none."""
        if not path.is_file():
            raise ModelError(f"tokenizer {path} is missing: fetch it from where the model comes from")
        try:
            tokenizer = Tokenizer.from_file(str(path))
        except Exception as error:  # the library raises bare Exception
            raise ModelError(f"{path} is no tokenizer.json: {error}") from error
        return cls(tokenizer, max_tokens)

    def ids(self, text: str) -> NDArray[np.int64]:
        """int64 [n], n <= max_tokens, opening and closing tokens included."""
        return np.asarray(self._tokenizer.encode(text).ids, np.int64)

    def padded(self, texts: Sequence[str], pad_id: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """ids and mask, int64 [n, max_tokens] each: pad_id after each text, mask 1 on the text and 0 on the padding."""
        ids = np.full((len(texts), self.max_tokens), pad_id, np.int64)
        mask = np.zeros_like(ids)
        for row, text in enumerate(texts):
            own = self.ids(text)
            ids[row, : len(own)] = own
            mask[row, : len(own)] = 1
        return ids, mask
