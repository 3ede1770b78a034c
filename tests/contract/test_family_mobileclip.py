"""MobileCLIP-S0 through the CLIP adapter against its own package: pixels, tokens, embeddings, similarities."""

from __future__ import annotations

import numpy as np
import pytest
from contract_fixtures import FIXTURES, OPEN_CLIP_TEXTS, TOLERANCE, digest, pictures, probe, reference

from irsd.core.errors import ModelError
from irsd.perception.families.clip import ClipImageEncoder, ClipTextEncoder
from irsd.perception.models import Session
from irsd.perception.pixels import UNIT_LEVELS, crop_square, planes
from irsd.perception.tokens import Tokens

FOLDER = FIXTURES / "mobileclip"
EXPECTED = reference("mobileclip")


def tokens() -> Tokens:
    return Tokens.load(FOLDER / "tokenizer.json", 77)


def images() -> ClipImageEncoder:
    session = Session(FOLDER / "vision_model.onnx")
    return ClipImageEncoder(session, "tiny", side_px=256, kind="bilinear", levels=UNIT_LEVELS)


def texts() -> ClipTextEncoder:
    return ClipTextEncoder(Session(FOLDER / "text_model.onnx"), "tiny", tokens(), pad_id=0)


@pytest.mark.parametrize("name", pictures())
def test_pixels(name: str) -> None:
    ours = planes(crop_square(pictures()[name], 256, "bilinear"), UNIT_LEVELS)
    np.testing.assert_allclose(probe(ours), EXPECTED[f"probe_{name}"], rtol=0, atol=TOLERANCE)
    assert digest(ours) == str(EXPECTED[f"digest_{name}"])


def test_tokens() -> None:
    np.testing.assert_array_equal(tokens().padded(OPEN_CLIP_TEXTS, 0)[0], EXPECTED["ids"])


def test_embeddings_and_similarities() -> None:
    pictured, worded = images().encode_images(list(pictures().values())), texts().encode_texts(OPEN_CLIP_TEXTS)
    np.testing.assert_allclose(pictured, EXPECTED["image_embeds"], rtol=0, atol=TOLERANCE)
    np.testing.assert_allclose(worded, EXPECTED["text_embeds"], rtol=0, atol=TOLERANCE)
    similarities = EXPECTED["logit_scale"] * pictured @ worded.T
    np.testing.assert_allclose(similarities, EXPECTED["logits_per_image"], rtol=0, atol=TOLERANCE)


def test_unpadded_text_is_refused() -> None:
    """The file has 77 written into it; as CLIP one would feed it what the text has."""
    with pytest.raises(ModelError, match=r"text_model\.onnx failed"):
        ClipTextEncoder(Session(FOLDER / "text_model.onnx"), "tiny", tokens())
