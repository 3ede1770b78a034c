"""MobileSAM through our adapter equals the package's SamPredictor, by both encoders and both decoders that are about."""

from __future__ import annotations

import numpy as np
import pytest
from contract_fixtures import BOXES, FIXTURES, POINTS, TOLERANCE, mask_agreement, picture, pictures, reference, unpacked

from irsd.core.errors import ModelError
from irsd.perception.families.mobile_sam import MobileSam, square_bytes
from irsd.perception.families.prompted import Frame, square_pixels
from irsd.perception.models import Session
from irsd.perception.pixels import IMAGENET_LEVELS

FOLDER = FIXTURES / "mobile_sam"


@pytest.fixture(scope="module", params=["encoder", "encoder_bytes"])
def encoder(request: pytest.FixtureRequest) -> Session:
    return Session(FOLDER / f"{request.param}.onnx")


@pytest.fixture(scope="module", params=["single", "multi"])
def decoder(request: pytest.FixtureRequest) -> Session:
    return Session(FOLDER / f"decoder_{request.param}.onnx")


@pytest.mark.parametrize("name", BOXES)
def test_features_are_those_of_the_package(encoder: Session, name: str) -> None:
    decoder = Session(FOLDER / "decoder_multi.onnx")
    features = MobileSam(encoder, decoder).encode(pictures()[name]).features["image_embeddings"]
    assert np.abs(features[..., ::4, ::4] - reference("mobile_sam")[f"features_{name}"]).max() <= TOLERANCE


@pytest.mark.parametrize("name", BOXES)
def test_masks_are_those_of_the_package(encoder: Session, decoder: Session, name: str) -> None:
    wanted, view = reference("mobile_sam"), pictures()[name]
    segmenter = MobileSam(encoder, decoder)
    found = segmenter.segment(view, np.array(BOXES[name], np.float32))
    masks = unpacked(wanted[f"box_{name}_masks"], view)
    assert 0.05 < masks.mean() < 0.95
    np.testing.assert_allclose(found.scores, wanted[f"box_{name}_ious"].max(1), atol=TOLERANCE)
    assert mask_agreement(found.masks, masks) > 0.9999

    encoded = segmenter.encode(view)
    (points,) = segmenter.prompt_points(encoded, np.array(POINTS[name], np.float32))
    best = points.logits[np.arange(len(points.ious)), points.ious.argmax(1)]
    theirs = wanted[f"point_{name}_ious"]
    np.testing.assert_allclose(points.ious.max(1), theirs.max(1), atol=TOLERANCE)
    if "multi" in decoder.path.name:  # of four masks the first is not for prompts as ours
        np.testing.assert_allclose(points.ious, theirs, atol=TOLERANCE)
    assert mask_agreement(encoded.frame.enlarge(best), unpacked(wanted[f"point_{name}_masks"], view)) > 0.9999


def test_the_mean_colour_is_zero_after_normalising() -> None:
    view, frame = picture(30, 20), Frame(20, 30, 64)
    mean, std = (255 * np.array(values, np.float32) for values in (IMAGENET_LEVELS.mean, IMAGENET_LEVELS.std))
    normalised = ((square_bytes(view, frame) - mean) / std).transpose(2, 0, 1)
    np.testing.assert_allclose(normalised, square_pixels(view, frame), atol=1e-5)


def test_files_that_do_not_fit_are_refused() -> None:
    encoder, decoder = (Session(FOLDER / f"{name}.onnx") for name in ("encoder", "decoder_single"))
    with pytest.raises(ModelError, match="lacks images"):
        MobileSam(decoder, decoder)
    with pytest.raises(ModelError, match="point_coords"):
        MobileSam(encoder, encoder)
