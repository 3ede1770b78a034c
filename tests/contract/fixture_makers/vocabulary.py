"""Cut-down vocabularies for the real tokenizer classes: a few hundred pieces learnt from names of things."""

from __future__ import annotations

import json
from collections import Counter
from itertools import pairwise
from pathlib import Path
from typing import Any

import sentencepiece
from contract_fixtures import ODD_TEXTS
from transformers import BertTokenizer, BertTokenizerFast, CLIPTokenizer, CLIPTokenizerFast, SiglipTokenizer
from transformers.convert_slow_tokenizer import T5Converter
from transformers.models.clip.tokenization_clip import bytes_to_unicode

THINGS = """chair, office chair, table, bedside table, desk, sofa, bed, lamp, potted plant, television, monitor, keyboard,
    fire extinguisher, trash can, refrigerator, kitchen sink, toilet, door, window, cabinet, bookshelf, cardboard box,
    coffee machine, microwave oven, washing machine, whiteboard, backpack, bicycle, stairs, person"""
CORPUS = (*ODD_TEXTS, *(f"a photo of a {thing.strip()}" for thing in THINGS.split(",")))
MERGES = 300
SPECIALS = ("<|startoftext|>", "<|endoftext|>")


def clip_tokenizer(folder: Path, scratch: Path, pad: str = SPECIALS[1]) -> CLIPTokenizer:
    """CLIP's byte-level BPE with few merges and a padding token of choice. Writes tokenizer.json, as repositories hold it; returns
    the slow tokenizer, another implementation (no tokenizer.json in it) of what is to come out."""
    letters = list(bytes_to_unicode().values())
    alphabet = [*letters, *(letter + "</w>" for letter in letters)]
    blank = CLIPTokenizerFast(*_write(scratch, alphabet, [])).backend_tokenizer
    words: Counter[tuple[str, ...]] = Counter()
    for text in CORPUS:
        for word, _ in blank.pre_tokenizer.pre_tokenize_str(blank.normalizer.normalize_str(text)):
            words[(*word[:-1], word[-1] + "</w>")] += 1
    files = _write(scratch, alphabet, learn_merges(words, MERGES))
    CLIPTokenizerFast(*files).backend_tokenizer.save(str(folder / "tokenizer.json"), pretty=False)
    return CLIPTokenizer(*files, pad_token=pad)


def learn_merges(words: Counter[tuple[str, ...]], most: int) -> list[tuple[str, str]]:
    """Byte pair encoding (Sennrich et al. 2016); among equally frequent pairs the first in the alphabet, so that all runs agree."""
    found: list[tuple[str, str]] = []
    while len(found) < most:
        pairs: Counter[tuple[str, str]] = Counter()
        for word, count in words.items():
            for pair in pairwise(word):
                pairs[pair] += count
        if not pairs:
            break
        best = min(pairs, key=lambda pair: (-pairs[pair], pair))
        found.append(best)
        merged: Counter[tuple[str, ...]] = Counter()
        for word, count in words.items():
            merged[_merge(word, best)] += count
        words = merged
    return found


def _merge(word: tuple[str, ...], pair: tuple[str, str]) -> tuple[str, ...]:
    out: list[str] = []
    for piece in word:
        if out and (out[-1], piece) == pair:
            out[-1] += piece
        else:
            out.append(piece)
    return tuple(out)


def _write(folder: Path, alphabet: list[str], merges: list[tuple[str, str]]) -> tuple[str, str]:
    pieces = dict.fromkeys([*alphabet, *map("".join, merges), *SPECIALS])
    vocabulary, rules = folder / "vocab.json", folder / "merges.txt"
    vocabulary.write_text(json.dumps({piece: number for number, piece in enumerate(pieces)}))
    rules.write_text("\n".join(["#version: 0.2", *map(" ".join, merges)]) + "\n")
    return str(vocabulary), str(rules)


class _SiglipConverter(T5Converter):
    def vocab(self, proto: Any) -> list[tuple[str, float]]:
        return [(piece.piece, piece.score) for piece in proto.pieces]


def siglip_tokenizer(folder: Path, scratch: Path) -> SiglipTokenizer:
    """SigLIP's unigram tokenizer of few pieces. Writes tokenizer.json, converted from sentencepiece as repositories have it; returns
    the slow tokenizer, which is sentencepiece itself."""
    model = scratch / "spiece"
    # Four rules of sentencepiece's nmt_nfkc, of some thousand: those would be most of the fixture.
    rules = scratch / "rules.tsv"
    rules.write_text("2116\t4E 6F\n65 301\tE9\n2002\t20\n2581\t20\n")
    sentencepiece.SentencePieceTrainer.train(
        sentence_iterator=iter([text.lower() for text in CORPUS if text] * 4),
        model_prefix=str(model),
        vocab_size=220,
        hard_vocab_limit=False,
        normalization_rule_tsv=str(rules),
        num_threads=1,
        **{"pad_id": 0, "eos_id": 1, "unk_id": 2, "bos_id": -1, "minloglevel": 2},
    )
    slow = SiglipTokenizer(f"{model}.model")
    _SiglipConverter(slow).converted().save(str(folder / "tokenizer.json"), pretty=False)
    return slow


def bert_tokenizer(folder: Path, scratch: Path) -> BertTokenizer:
    """BERT's uncased WordPiece, the first numbers as they are (those of [CLS], [SEP], . and ? are part of what reads them), then the
    pieces that our texts need. Writes tokenizer.json; returns the slow tokenizer."""
    full = BertTokenizer(str(Path(__file__).parents[3] / "irsd" / "models" / "minilm_vocab.txt"))
    first = full.convert_ids_to_tokens(range(1064))  # up to z
    needed = [piece for text in CORPUS for piece in full.tokenize(text)]
    pieces = scratch / "vocab.txt"
    pieces.write_text("\n".join(dict.fromkeys([*first, *needed])), encoding="utf-8")
    BertTokenizerFast(str(pieces)).backend_tokenizer.save(str(folder / "tokenizer.json"), pretty=False)
    return BertTokenizer(str(pieces))
