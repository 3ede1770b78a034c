"""Grounding DINO through our adapter against its Hugging Face processor, model and post-processing."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from contract_fixtures import DETECTOR_PROMPTS, FIXTURES, TOLERANCE, digest, pictures, probe, reference

from irsd.core.errors import ModelError
from irsd.perception.families.grounding_dino import CONTEXT, GroundingDino
from irsd.perception.models import Session
from irsd.perception.pixels import IMAGENET_LEVELS, planes, resize, within
from irsd.perception.tokens import Tokens

FOLDER = FIXTURES / "grounding_dino"
EXPECTED = reference("grounding_dino")
SIZE_PX = (96, 128)


def tokens() -> Tokens:
    return Tokens.load(FOLDER / "tokenizer.json", CONTEXT)


@cache
def adapter(threshold: float = 0.0) -> GroundingDino:
    return GroundingDino(Session(FOLDER / "model.onnx"), tokens(), fixed_px=SIZE_PX, threshold=threshold)


@pytest.mark.parametrize("name", pictures())
def test_pixels_at_the_real_size(name: str) -> None:
    view = pictures()[name]
    height, width = within(*view.shape[:2], 800, 1333)
    ours = planes(resize(view, width, height, "bilinear"), IMAGENET_LEVELS)
    np.testing.assert_allclose(probe(ours), EXPECTED[f"probe_{name}"], rtol=0, atol=TOLERANCE)
    assert digest(ours) == str(EXPECTED[f"digest_{name}"])


def test_sizes() -> None:
    for height, width, *expected in EXPECTED["sizes"].tolist():
        assert list(within(height, width, 800, 1333)) == expected, (height, width)


def test_tokens_of_the_caption() -> None:
    np.testing.assert_array_equal(tokens().ids(". ".join(DETECTOR_PROMPTS) + "."), EXPECTED["ids"])


def test_the_fixture_tells_phrases_apart() -> None:
    assert len({prompt for name in pictures() for prompt in EXPECTED[f"{name}_phrases"].argmax(1)}) > 2


@pytest.mark.parametrize("name", pictures())
def test_boxes_and_phrases(name: str) -> None:
    view = pictures()[name]
    height, width = view.shape[:2]
    boxes = EXPECTED[f"{name}_boxes"].clip(
        0, [width, height, width, height]
    )  # the reference lets boxes leave the picture
    phrases = EXPECTED[f"{name}_phrases"]
    there = (boxes[:, 2] > boxes[:, 0]) & (boxes[:, 3] > boxes[:, 1])
    assert there.sum() > 10
    found = adapter().detect(view, DETECTOR_PROMPTS)
    np.testing.assert_allclose(found.boxes_px, boxes[there], rtol=0, atol=TOLERANCE)
    np.testing.assert_allclose(found.scores, phrases[there].max(1), rtol=0, atol=TOLERANCE)
    np.testing.assert_array_equal(found.prompt, phrases[there].argmax(1))
    # The processor's score counts stops and brackets of the caption, too: never less than ours.
    assert (EXPECTED[f"{name}_scores"][there] >= found.scores - TOLERANCE).all()


def test_threshold_and_prompts() -> None:
    view = pictures()["landscape"]
    scores = adapter().detect(view, DETECTOR_PROMPTS).scores
    middle = float(np.median(scores))
    assert len(adapter(middle).detect(view, DETECTOR_PROMPTS).scores) == (scores > middle).sum()
    for nothing in ((), ("",), (" . ", "?")):
        assert adapter().detect(view, nothing).boxes_px.shape == (0, 4)


def test_a_prompt_is_one_phrase_whatever_is_in_it() -> None:
    view = pictures()["landscape"]
    plain = adapter().detect(view, ("", "chair", "bedside table"))
    odd = adapter().detect(view, ("...", " Chair. ", "bedside.table?"))
    np.testing.assert_array_equal(plain.boxes_px, odd.boxes_px)
    np.testing.assert_array_equal(plain.prompt, odd.prompt)
    assert set(plain.prompt) <= {1, 2}


def test_many_prompts_go_into_several_captions() -> None:
    view = pictures()["landscape"]
    prompts = tuple(f"{thing} {number}" for number in range(30) for thing in DETECTOR_PROMPTS)
    found = adapter().detect(view, prompts)
    first = adapter().detect(view, prompts[:5])
    queries = len(EXPECTED["landscape_boxes"])
    assert len(found.scores) > queries
    assert found.prompt.max() > len(prompts) // 2
    assert len(first.scores) <= queries
    assert len(adapter().detect(view, ("chair " * 400,)).scores) <= queries  # longer than a whole caption


def test_files_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ModelError, match=r"frozen\.onnx: scores depend on the order of phrases"):
        GroundingDino(Session(FOLDER / "frozen.onnx"), tokens(), fixed_px=SIZE_PX)
    with pytest.raises(ModelError, match=r"one size of pictures only"):
        GroundingDino(Session(FOLDER / "model.onnx"), tokens())
    with pytest.raises(ModelError, match=r"lacks pixel_mask"):
        GroundingDino(Session(FIXTURES / "owlvit" / "model.onnx"), tokens(), fixed_px=SIZE_PX)
    other = Tokens.load(FIXTURES / "clip" / "tokenizer.json", CONTEXT)
    with pytest.raises(ModelError, match=r"this tokenizer is another"):
        GroundingDino(Session(FOLDER / "model.onnx"), other, fixed_px=SIZE_PX)
