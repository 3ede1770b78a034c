"""RAM through our adapter: pixels to the bit, probabilities and choice of tags as in torch. The head is a restatement, see
fixture_makers/ram.py: what is proven is the contract of the file."""

from __future__ import annotations

import numpy as np
import pytest
from contract_fixtures import FIXTURES, PICTURES, TOLERANCE, digest, picture, pictures, reference

from irsd.core.errors import ModelError
from irsd.perception.families.ram import Ram, read_tags, read_thresholds
from irsd.perception.models import Session
from irsd.perception.pixels import IMAGENET_LEVELS, planes, resize

FOLDER = FIXTURES / "ram"
TAGS = read_tags((FOLDER / "tags.txt").read_text())
THRESHOLDS = read_thresholds((FOLDER / "thresholds.txt").read_text())


@pytest.mark.parametrize("name", PICTURES)
def test_pixels_are_those_of_the_reference(name: str) -> None:
    pixels = planes(resize(pictures()[name], 384, 384, "bilinear"), IMAGENET_LEVELS)
    assert digest(pixels) == reference("ram")[f"digest_{name}"]


@pytest.mark.parametrize("name", PICTURES)
def test_tags_are_those_above_their_thresholds(name: str) -> None:
    probability = reference("ram")[f"probability_{name}"]
    wanted = sorted(np.flatnonzero(probability > np.float32(THRESHOLDS)), key=lambda k: -probability[k])
    found = Ram(Session(FOLDER / "model.onnx"), TAGS, THRESHOLDS).tag(pictures()[name])
    assert 0 < len(wanted) < len(TAGS)
    assert sorted(found.labels) == sorted(TAGS[k] for k in wanted)
    assert np.abs(found.scores - probability[wanted]).max() <= TOLERANCE
    assert (np.diff(found.scores) <= 0).all()
    decided = Ram(Session(FOLDER / "model_tag.onnx"), TAGS, THRESHOLDS).tag(pictures()[name])
    assert decided.labels == tuple(TAGS[k] for k in sorted(wanted))
    assert (decided.scores == 1).all()


def test_all_probabilities_are_those_of_torch() -> None:
    everything = Ram(Session(FOLDER / "model.onnx"), TAGS, [-1.0] * len(TAGS))
    for name, view in pictures().items():
        found = everything.tag(view)
        scores = dict(zip(found.labels, found.scores, strict=True))
        got = np.array([scores[tag] for tag in TAGS])
        assert np.abs(got - reference("ram")[f"probability_{name}"]).max() <= TOLERANCE


def test_lists_that_do_not_fit_are_refused() -> None:
    session = Session(FOLDER / "model.onnx")
    with pytest.raises(ModelError, match="45 tags but 3 thresholds"):
        Ram(session, TAGS, [0.5] * 3)
    with pytest.raises(ModelError, match="scores 45 tags, the list has 2"):
        Ram(session, ["a", "b"], [0.5, 0.5]).tag(picture(30, 20))
    with pytest.raises(ModelError, match="thresholds of tags"):
        read_thresholds("0.5\nhalf\n")
    with pytest.raises(ModelError, match="lacks image"):
        Ram(Session(FIXTURES / "sam" / "vision_encoder.onnx"), TAGS, THRESHOLDS)
