"""Zero-shot tags by real (tiny) CLIP and SigLIP files, and the arithmetic of scores."""

from __future__ import annotations

import numpy as np
import pytest
from contract_fixtures import FIXTURES, ODD_TEXTS, TOLERANCE, pictures, reference

from irsd.core.errors import ModelError
from irsd.perception.families.clip import ClipImageEncoder, ClipTextEncoder
from irsd.perception.models import Session
from irsd.perception.tagging import CLIP_LIKENESS, SIGLIP_LIKENESS, Likeness, ZeroShotTagger
from irsd.perception.tokens import Tokens

FOLDER = FIXTURES / "clip"
SIDE_PX = 32


@pytest.fixture(scope="module")
def images() -> ClipImageEncoder:
    return ClipImageEncoder(Session(FOLDER / "vision_model.onnx"), "clip", side_px=SIDE_PX)


@pytest.fixture(scope="module")
def texts() -> ClipTextEncoder:
    return ClipTextEncoder(Session(FOLDER / "text_model.onnx"), "clip", Tokens.load(FOLDER / "tokenizer.json", 77))


def test_scores_are_those_of_clip(images: ClipImageEncoder, texts: ClipTextEncoder) -> None:
    wanted = reference("clip")
    likeness = Likeness(float(wanted["logit_scale"]), None)
    tagger = ZeroShotTagger(images, texts, ODD_TEXTS, likeness=likeness, top=len(ODD_TEXTS), threshold=0.0, prompt="{}")
    for row, view in enumerate(pictures().values()):
        logits = wanted["logits_per_image"][row].astype(np.float64)
        probabilities = np.exp(logits) / np.exp(logits).sum()
        found = tagger.tag(view)
        assert sorted(found.labels) == sorted(ODD_TEXTS)
        assert (np.diff(found.scores) <= 0).all()
        got = dict(zip(found.labels, found.scores, strict=True))
        assert max(abs(got[text] - p) for text, p in zip(ODD_TEXTS, probabilities, strict=True)) <= TOLERANCE


def test_top_and_threshold_cut_the_list(images: ClipImageEncoder, texts: ClipTextEncoder) -> None:
    view = pictures()["landscape"]
    names = ("chair", "table", "lamp", "sofa", "chair", "bed")
    everything = ZeroShotTagger(images, texts, names, threshold=0.0).tag(view)
    assert len(everything.labels) == 5
    assert everything.scores.sum() == pytest.approx(1, abs=1e-5)
    two = ZeroShotTagger(images, texts, names, threshold=0.0, top=2).tag(view)
    assert two.labels == everything.labels[:2]
    least = float(everything.scores[2])
    some = ZeroShotTagger(images, texts, names, threshold=least).tag(view)
    assert some.labels == everything.labels[:3]
    assert ZeroShotTagger(images, texts, (), threshold=0.0).tag(view).labels == ()


def test_names_are_embedded_once(images: ClipImageEncoder, texts: ClipTextEncoder) -> None:
    tagger = ZeroShotTagger(images, texts, ("chair", "table"))
    embedding = images.encode_images([pictures()["odd"]])[0]
    np.testing.assert_array_equal(tagger.tag(pictures()["odd"]).scores, tagger.tags_of(embedding).scores)


def test_spaces_are_not_mixed(images: ClipImageEncoder) -> None:
    other = ClipTextEncoder(Session(FOLDER / "text_model.onnx"), "another", Tokens.load(FOLDER / "tokenizer.json", 77))
    with pytest.raises(ModelError, match="can't be compared"):
        ZeroShotTagger(images, other, ("chair",))


def test_likeness_by_hand() -> None:
    cosines = np.array([[0.3, 0.1, -0.2], [0.9, 0.9, -1.0]], np.float32)
    soft = CLIP_LIKENESS.scores(cosines)
    np.testing.assert_allclose(soft.sum(1), 1, atol=1e-6)
    np.testing.assert_allclose(soft[0, 0] / soft[0, 1], np.exp(20), rtol=1e-4)
    each = SIGLIP_LIKENESS.scores(cosines)
    np.testing.assert_allclose(each, 1 / (1 + np.exp(12.9 - 117.8 * cosines.astype(np.float64))), atol=1e-6)
    assert Likeness(1e6, None).scores(np.array([1, -1], np.float32)).tolist() == [1, 0]
