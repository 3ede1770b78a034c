"""OWL-ViT and OWLv2 through our adapter against their Hugging Face processors and models: pixels, tokens, boxes, scores, prompts."""

from __future__ import annotations

import numpy as np
import pytest
from contract_fixtures import DETECTOR_PROMPTS, FIXTURES, TOLERANCE, digest, pictures, probe, reference

from irsd.core.errors import ModelError
from irsd.perception.families.owl import CONTEXT, TEMPLATE, Owl
from irsd.perception.models import Session
from irsd.perception.pixels import CLIP_LEVELS, padded_square, planes, resize
from irsd.perception.tokens import Tokens

FAMILIES = ("owlvit", "owlv2")
EXPECTED = {family: reference(family) for family in FAMILIES}
SIDE_PX = 64


def tokens(family: str) -> Tokens:
    return Tokens.load(FIXTURES / family / "tokenizer.json", CONTEXT)


def adapter(family: str, threshold: float = 0.0) -> Owl:
    session = Session(FIXTURES / family / "model.onnx")
    return Owl(session, tokens(family), side_px=SIDE_PX, padded=family == "owlv2", threshold=threshold)


@pytest.mark.parametrize("name", pictures())
def test_owlvit_pixels_at_the_real_size(name: str) -> None:
    ours = planes(resize(pictures()[name], 768, 768, "bicubic"), CLIP_LEVELS)
    np.testing.assert_allclose(probe(ours), EXPECTED["owlvit"][f"probe_{name}"], rtol=0, atol=TOLERANCE)
    assert digest(ours) == str(EXPECTED["owlvit"][f"digest_{name}"])


@pytest.mark.parametrize("name", pictures())
def test_owlv2_pixels_at_the_real_size(name: str) -> None:
    ours = padded_square(pictures()[name], 960, CLIP_LEVELS)
    np.testing.assert_allclose(probe(ours), EXPECTED["owlv2"][f"probe_{name}"], rtol=0, atol=TOLERANCE)


@pytest.mark.parametrize("family", FAMILIES)
def test_tokens(family: str) -> None:
    ids, mask = tokens(family).padded([TEMPLATE.format(prompt) for prompt in DETECTOR_PROMPTS], 0)
    np.testing.assert_array_equal(ids, EXPECTED[family]["ids"])
    np.testing.assert_array_equal(mask, EXPECTED[family]["mask"])


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("name", pictures())
def test_boxes(family: str, name: str) -> None:
    view = pictures()[name]
    height, width = view.shape[:2]
    expected = {key: EXPECTED[family][f"{name}_{key}"] for key in ("boxes", "scores", "labels")}
    boxes = expected["boxes"].clip(0, [width, height, width, height])  # the reference lets boxes leave the picture
    there = (boxes[:, 2] > boxes[:, 0]) & (boxes[:, 3] > boxes[:, 1])
    assert there.sum() > 1
    found = adapter(family).detect(view, DETECTOR_PROMPTS)
    np.testing.assert_allclose(found.boxes_px, boxes[there], rtol=0, atol=TOLERANCE)
    np.testing.assert_allclose(found.scores, expected["scores"][there], rtol=0, atol=TOLERANCE)
    np.testing.assert_array_equal(found.prompt, expected["labels"][there])
    assert (found.boxes_px.dtype, found.scores.dtype, found.prompt.dtype) == (np.float32, np.float32, np.int32)


@pytest.mark.parametrize("family", FAMILIES)
def test_threshold_and_prompts(family: str) -> None:
    view = pictures()["landscape"]
    scores = adapter(family).detect(view, DETECTOR_PROMPTS).scores
    middle = float(np.median(scores))
    assert len(adapter(family, threshold=middle).detect(view, DETECTOR_PROMPTS).scores) == (scores > middle).sum()
    nothing = adapter(family).detect(view, ())
    assert nothing.boxes_px.shape == (0, 4)
    assert len(nothing.scores) == len(nothing.prompt) == 0
    long = adapter(family).detect(view, ("chair " * 40,))  # more tokens than the network's 16
    assert len(long.scores)


def test_files_that_do_not_fit_are_refused() -> None:
    clip = FIXTURES / "clip" / "model.onnx"
    with pytest.raises(ModelError, match=r"lacks logits, pred_boxes"):
        Owl(Session(clip), tokens("owlvit"))
    with pytest.raises(ModelError, match=r"model\.onnx failed"):
        Owl(Session(FIXTURES / "owlvit" / "model.onnx"), tokens("owlvit"), side_px=768)
