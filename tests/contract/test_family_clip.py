"""CLIP through our adapter against CLIPProcessor + CLIPModel: pixels, tokens, embeddings, similarities."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from contract_fixtures import FIXTURES, ODD_TEXTS, TOLERANCE, digest, pictures, probe, reference

from irsd.core.errors import ModelError
from irsd.perception.families.clip import ClipImageEncoder, ClipTextEncoder
from irsd.perception.models import Session
from irsd.perception.pixels import CLIP_LEVELS, crop_square, planes
from irsd.perception.tokens import Tokens

FOLDER = FIXTURES / "clip"
SIDE_PX = 32
EXPECTED = reference("clip")


def tokens() -> Tokens:
    return Tokens.load(FOLDER / "tokenizer.json", 77)


def images(file: str) -> ClipImageEncoder:
    return ClipImageEncoder(Session(FOLDER / file), "tiny", side_px=SIDE_PX)


def texts(file: str) -> ClipTextEncoder:
    return ClipTextEncoder(Session(FOLDER / file), "tiny", tokens(), side_px=SIDE_PX)


@pytest.mark.parametrize("name", pictures())
def test_pixels_at_the_real_size(name: str) -> None:
    ours = planes(crop_square(pictures()[name], 224, "bicubic"), CLIP_LEVELS)
    np.testing.assert_allclose(probe(ours), EXPECTED[f"probe_{name}"], rtol=0, atol=TOLERANCE)
    assert digest(ours) == str(EXPECTED[f"digest_{name}"])


def test_tokens() -> None:
    ours, mask = tokens().padded(ODD_TEXTS, pad_id=int(EXPECTED["ids"].max()))
    np.testing.assert_array_equal(ours, EXPECTED["ids"])
    np.testing.assert_array_equal(mask.sum(1), EXPECTED["lengths"])


@pytest.mark.parametrize("file", ["vision_model.onnx", "model.onnx"])
def test_image_embeddings(file: str) -> None:
    encoder = images(file)
    assert encoder.dimension == EXPECTED["image_embeds"].shape[1]
    ours = encoder.encode_images(list(pictures().values()))
    np.testing.assert_allclose(ours, EXPECTED["image_embeds"], rtol=0, atol=TOLERANCE)
    assert encoder.encode_images([]).shape == (0, encoder.dimension)


@pytest.mark.parametrize("file", ["text_model.onnx", "model.onnx"])
def test_text_embeddings(file: str) -> None:
    encoder = texts(file)
    assert encoder.dimension == EXPECTED["text_embeds"].shape[1]
    np.testing.assert_allclose(encoder.encode_texts(ODD_TEXTS), EXPECTED["text_embeds"], rtol=0, atol=TOLERANCE)


def test_vectors_do_not_depend_on_company() -> None:
    encoder = texts("text_model.onnx")
    together = encoder.encode_texts(ODD_TEXTS)
    alone = np.concatenate([encoder.encode_texts([text]) for text in ODD_TEXTS])
    np.testing.assert_array_equal(together, alone)
    crops = list(pictures().values()) * 3
    many = images("vision_model.onnx").encode_images(crops)  # more than one batch
    np.testing.assert_allclose(many, np.tile(EXPECTED["image_embeds"], (3, 1)), rtol=0, atol=TOLERANCE)


def test_similarities() -> None:
    ours = images("vision_model.onnx").encode_images(list(pictures().values()))
    similarity = float(EXPECTED["logit_scale"]) * ours @ texts("text_model.onnx").encode_texts(ODD_TEXTS).T
    np.testing.assert_allclose(similarity, EXPECTED["logits_per_image"], rtol=0, atol=TOLERANCE)


def test_files_that_do_not_fit_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=r"text_model.onnx lacks pixel_values, image_embeds"):
        images("text_model.onnx")
    with pytest.raises(ModelError, match=r"vision_model.onnx failed"):
        ClipImageEncoder(Session(FOLDER / "vision_model.onnx"), "tiny", side_px=224)
    with pytest.raises(ModelError, match="is missing"):
        Tokens.load(tmp_path / "tokenizer.json", 77)
    (tmp_path / "tokenizer.json").write_text("{}")
    with pytest.raises(ModelError, match=r"no tokenizer.json"):
        Tokens.load(tmp_path / "tokenizer.json", 77)
