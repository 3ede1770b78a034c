"""SigLIP through our adapter against SiglipImageProcessor, SiglipTokenizer and SiglipModel."""

from __future__ import annotations

import numpy as np
import pytest
from contract_fixtures import FIXTURES, ODD_TEXTS, TOLERANCE, digest, pictures, probe, reference

from irsd.core.errors import ModelError
from irsd.perception.families.siglip import CONTEXT, SiglipImageEncoder, SiglipTextEncoder, canonical
from irsd.perception.models import Session
from irsd.perception.pixels import HALF_LEVELS, planes, resize
from irsd.perception.tokens import Tokens

FOLDER = FIXTURES / "siglip"
SIDE_PX = 32
EXPECTED = reference("siglip")


def tokens() -> Tokens:
    return Tokens.load(FOLDER / "tokenizer.json", CONTEXT)


def images(file: str) -> SiglipImageEncoder:
    return SiglipImageEncoder(Session(FOLDER / file), "tiny", side_px=SIDE_PX)


def texts(file: str) -> SiglipTextEncoder:
    return SiglipTextEncoder(Session(FOLDER / file), "tiny", tokens(), side_px=SIDE_PX)


@pytest.mark.parametrize("name", pictures())
def test_pixels_at_the_real_size(name: str) -> None:
    ours = planes(resize(pictures()[name], 224, 224, "bicubic"), HALF_LEVELS)
    np.testing.assert_allclose(probe(ours), EXPECTED[f"probe_{name}"], rtol=0, atol=TOLERANCE)
    assert digest(ours) == str(EXPECTED[f"digest_{name}"])


def test_tokens() -> None:
    ours, _ = tokens().padded([canonical(text) for text in ODD_TEXTS], pad_id=1)
    np.testing.assert_array_equal(ours, EXPECTED["ids"])


@pytest.mark.parametrize("file", ["vision_model.onnx", "model.onnx"])
def test_image_embeddings(file: str) -> None:
    ours = images(file).encode_images(list(pictures().values()))
    np.testing.assert_allclose(ours, EXPECTED["image_embeds"], rtol=0, atol=TOLERANCE)


@pytest.mark.parametrize("file", ["text_model.onnx", "model.onnx"])
def test_text_embeddings(file: str) -> None:
    ours = texts(file).encode_texts(ODD_TEXTS)
    np.testing.assert_allclose(ours, EXPECTED["text_embeds"], rtol=0, atol=TOLERANCE)


def test_similarities() -> None:
    cosines = (
        images("vision_model.onnx").encode_images(list(pictures().values()))
        @ texts("text_model.onnx").encode_texts(ODD_TEXTS).T
    )
    ours = EXPECTED["logit_scale"] * cosines + EXPECTED["logit_bias"]
    np.testing.assert_allclose(ours, EXPECTED["logits_per_image"], rtol=0, atol=TOLERANCE)


def test_files_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ModelError, match="lacks pixel_values"):
        images("text_model.onnx")
    with pytest.raises(ModelError, match=r"text_model\.onnx failed"):  # a context of another length
        SiglipTextEncoder(Session(FOLDER / "text_model.onnx"), "tiny", Tokens.load(FOLDER / "tokenizer.json", 77))
