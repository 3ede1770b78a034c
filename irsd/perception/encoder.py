"""Text to unit vectors: all-MiniLM-L6-v2, with the alias table in front of it for labels.

The model knows that a fridge is a refrigerator, but not that a bin is a trash can, and hardly any language but English: hence
``LabelEncoder``, which first replaces a name by its canonical form.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from tokenizers import Tokenizer, decoders, normalizers, pre_tokenizers, processors
from tokenizers.models import WordPiece

from irsd.models import MINILM_VOCABULARY, MINILM_WEIGHTS
from irsd.perception.aliases import AliasTable
from irsd.perception.models import Session, packaged_path

__all__ = ["DIMENSION", "AliasTable", "LabelEncoder", "TextEncoder"]

DIMENSION = 384
MAX_TOKENS = 128  # what the model was trained with; longer texts are cut
CACHE_SIZE = 8192  # 12 MB at most: a site has some hundreds of names
_CLS, _SEP = 101, 102


class TextEncoder:
    """Texts to unit vectors float32 [n, 384], cached by text. One owner: not for use by several threads at once.

    The files are checked and opened at the first ``encode``; ``load`` does it at once.
    """

    def __init__(self, threads: int = 1, session: Session | None = None) -> None:
        """session: the network, where someone has opened it already."""
        self._threads = threads
        self._cache: dict[str, NDArray[np.float32]] = {}
        self._tokenizer: Tokenizer | None = None
        self._session = session

    @classmethod
    def load(cls, threads: int = 1) -> TextEncoder:
        """An encoder that is ready to run. ModelError when a file is missing or altered."""
        encoder = cls(threads)
        encoder.encode(["warm up"])
        return encoder

    def encode(self, texts: Sequence[str]) -> NDArray[np.float32]:
        """float32 [n, 384], unit length, for n texts. Equal texts give equal bytes, whatever else is asked for with them."""
        out = np.zeros((len(texts), DIMENSION), np.float32)
        for row, text in enumerate(texts):
            vector = self._cache.get(text)
            if vector is None:
                vector = self._encode_one(text)
                if len(self._cache) >= CACHE_SIZE:
                    self._cache.pop(next(iter(self._cache)))
                self._cache[text] = vector
            out[row] = vector
        return out

    def _encode_one(self, text: str) -> NDArray[np.float32]:
        # One text a run: no padding to pay for, and the last bits of the result don't depend on who shares the batch.
        tokenizer, session = self._opened()
        ids = np.array([tokenizer.encode(text).ids], np.int64)
        feeds = {"input_ids": ids, "attention_mask": np.ones_like(ids), "token_type_ids": np.zeros_like(ids)}
        (hidden,) = session.run(feeds, ("last_hidden_state",))
        pooled = hidden[0].mean(0, dtype=np.float64)
        return np.asarray(pooled / max(float(np.linalg.norm(pooled)), 1e-12), np.float32)

    def _opened(self) -> tuple[Tokenizer, Session]:
        if self._tokenizer is None:
            self._tokenizer = bert_tokenizer()
        if self._session is None:
            self._session = Session(
                packaged_path(MINILM_WEIGHTS),
                threads=self._threads,
                inputs=("input_ids", "attention_mask", "token_type_ids"),
                outputs=("last_hidden_state",),
            )
        return self._tokenizer, self._session


def bert_tokenizer() -> Tokenizer:
    """The uncased BERT WordPiece tokenizer, built from its vocabulary.

    Cuts at 128 tokens and never pads: the published tokenizer.json pads each text to 128, which costs ten times the compute.
    """
    lines = packaged_path(MINILM_VOCABULARY).read_text(encoding="utf-8").rstrip("\n").split("\n")
    vocabulary = {token: number for number, token in enumerate(lines)}
    tokenizer = Tokenizer(WordPiece(vocabulary, unk_token="[UNK]", max_input_chars_per_word=100))
    tokenizer.normalizer = normalizers.BertNormalizer(
        clean_text=True, handle_chinese_chars=True, strip_accents=None, lowercase=True
    )
    tokenizer.pre_tokenizer = pre_tokenizers.BertPreTokenizer()
    tokenizer.post_processor = processors.TemplateProcessing(
        single="[CLS] $A [SEP]", special_tokens=[("[CLS]", _CLS), ("[SEP]", _SEP)]
    )
    tokenizer.decoder = decoders.WordPiece()
    tokenizer.enable_truncation(MAX_TOKENS)
    tokenizer.no_padding()
    return tokenizer


class LabelEncoder:
    """Names of things to unit vectors: canonical name first, then the text encoder. Synonyms share one vector."""

    def __init__(self, encoder: TextEncoder, aliases: AliasTable) -> None:
        self._encoder = encoder
        self.aliases = aliases

    @classmethod
    def load(cls) -> LabelEncoder:
        """Encoder and alias table as shipped, ready to run."""
        return cls(TextEncoder.load(), AliasTable.load())

    def encode(self, labels: Sequence[str]) -> NDArray[np.float32]:
        """float32 [n, 384], unit length, for n names of things."""
        return self._encoder.encode([self.aliases.canonical(label) for label in labels])

    def encode_rooms(self, names: Sequence[str]) -> NDArray[np.float32]:
        """float32 [n, 384], unit length, for n names of kinds of rooms."""
        return self._encoder.encode([self.aliases.canonical_room(name) for name in names])
