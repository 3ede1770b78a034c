"""SAM through our adapter equals SamProcessor + SamModel: pixels to the bit, scores and logits to 1e-3, masks pixel by pixel."""

from __future__ import annotations

import numpy as np
import pytest
from contract_fixtures import (
    BOXES,
    FIXTURES,
    PICTURES,
    POINTS,
    TOLERANCE,
    digest,
    mask_agreement,
    picture,
    pictures,
    reference,
    unpacked,
)

from irsd.core.errors import ModelError
from irsd.perception.families.prompted import BATCH, Frame, square_pixels
from irsd.perception.families.sam import Sam
from irsd.perception.models import Session

FOLDER = FIXTURES / "sam"
DECODERS = {"box": "box_decoder", "both": "both_decoder", "stopgap": "prompt_encoder_mask_decoder"}


@pytest.fixture(scope="module")
def encoder() -> Session:
    return Session(FOLDER / "vision_encoder.onnx")


def sam(encoder: Session, kind: str) -> Sam:
    return Sam(encoder, Session(FOLDER / f"{DECODERS[kind]}.onnx"))


@pytest.mark.parametrize("name", PICTURES)
def test_pixels_are_those_of_the_processor(name: str) -> None:
    wanted, view = reference("sam"), pictures()[name]
    pixels = square_pixels(view, Frame(*view.shape[:2], 1024))
    assert digest(pixels) == wanted[f"digest_{name}"]


def test_sizes_are_rounded_as_by_the_processor() -> None:
    assert Frame(90, 4, 1024).resized == (1024, 46)  # 45.51
    assert Frame(4, 90, 1024).resized == (46, 1024)
    assert Frame(1, 5000, 1024).resized == (1, 1024)  # never nothing


@pytest.mark.parametrize("name", BOXES)
@pytest.mark.parametrize("kind", DECODERS)
def test_boxes_give_the_masks_of_transformers(encoder: Session, kind: str, name: str) -> None:
    wanted, view, boxes = reference("sam"), pictures()[name], np.array(BOXES[name], np.float32)
    key = f"{'stopgap' if kind == 'stopgap' else 'box'}_{name}"
    segmenter = sam(encoder, kind)
    encoded = segmenter.encode(view)
    raw = segmenter.decode_boxes(encoded, boxes)
    assert np.abs(raw.ious - wanted[f"{key}_ious"]).max() <= TOLERANCE
    assert np.abs(raw.logits[..., ::2, ::2] - wanted[f"{key}_logits"]).max() <= TOLERANCE
    found = segmenter.segment(view, boxes)
    np.testing.assert_allclose(found.scores, wanted[f"{key}_ious"].max(1), atol=TOLERANCE)
    masks = unpacked(wanted[f"{key}_masks"], view)
    if kind == "stopgap":  # what transformers finds for the points, within the box
        for mask, (x0, y0, x1, y1) in zip(masks, boxes, strict=True):
            mask[: round(y0)] = mask[round(y1) :] = mask[:, : round(x0 - 0.01)] = mask[:, round(x1) :] = False
    assert found.masks.dtype == np.bool_
    assert found.masks.shape == masks.shape
    assert 0.05 < masks.mean() < 0.95
    assert mask_agreement(found.masks, masks) > 0.99999


@pytest.mark.parametrize("name", POINTS)
def test_points_give_the_masks_of_transformers(encoder: Session, name: str) -> None:
    wanted, view = reference("sam"), pictures()[name]
    segmenter = sam(encoder, "stopgap")
    encoded = segmenter.encode(view)
    (found,) = segmenter.prompt_points(encoded, np.array(POINTS[name], np.float32))
    assert np.abs(found.ious - wanted[f"point_{name}_ious"]).max() <= TOLERANCE
    assert np.abs(found.logits[..., ::2, ::2] - wanted[f"point_{name}_logits"]).max() <= TOLERANCE
    best = found.logits[np.arange(len(found.ious)), found.ious.argmax(1)]
    masks = unpacked(wanted[f"point_{name}_masks"], view)
    assert mask_agreement(encoded.frame.enlarge(best), masks) > 0.99999


def test_many_boxes_are_decoded_as_each_alone(encoder: Session) -> None:
    segmenter = sam(encoder, "box")
    view = picture(50, 40)
    rng = np.random.default_rng(3)
    low = rng.uniform(0, 20, (2 * BATCH + 3, 2))
    boxes = np.concatenate([low, low + rng.uniform(3, 20, low.shape)], 1).astype(np.float32)
    together = segmenter.segment(view, boxes)
    for k in (0, BATCH - 1, BATCH, 2 * BATCH + 2):
        alone = segmenter.segment(view, boxes[k : k + 1])
        assert together.scores[k] == pytest.approx(alone.scores[0], abs=1e-5)
        assert (together.masks[k] == alone.masks[0]).mean() > 0.999


def test_no_boxes_cost_nothing_and_give_no_masks(encoder: Session) -> None:
    found = sam(encoder, "box").segment(picture(30, 20), np.zeros((0, 4), np.float32))
    assert found.masks.shape == (0, 20, 30)
    assert found.scores.shape == (0,)


def test_files_that_do_not_fit_are_refused(encoder: Session) -> None:
    boxes = Session(FOLDER / "box_decoder.onnx")
    with pytest.raises(ModelError, match="lacks pixel_values"):
        Sam(boxes, boxes)
    with pytest.raises(ModelError, match="lacks input_points"):
        Sam(encoder, encoder)
    segmenter = Sam(encoder, boxes)
    with pytest.raises(ModelError, match="takes no points"):
        list(segmenter.prompt_points(segmenter.encode(picture(30, 20)), np.ones((1, 2), np.float32)))
