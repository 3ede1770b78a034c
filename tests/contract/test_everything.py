"""Segmenting everything by a grid of points, with the tiny files of all three promptable families."""

from __future__ import annotations

import numpy as np
import pytest
from contract_fixtures import FIXTURES, pictures

from irsd.perception.everything import GridPrompter, GridSettings, distinct, grid_points, stability
from irsd.perception.families.efficient_sam import EfficientSam
from irsd.perception.families.mobile_sam import MobileSam
from irsd.perception.families.prompted import Frame, PromptedSegmenter
from irsd.perception.families.sam import Sam
from irsd.perception.models import Session

MAKERS = {
    "sam": (Sam, "vision_encoder", "prompt_encoder_mask_decoder"),
    "mobile_sam": (MobileSam, "encoder", "decoder_multi"),
    "efficient_sam": (EfficientSam, "encoder", "decoder"),
}


@pytest.fixture(scope="module", params=MAKERS)
def segmenter(request: pytest.FixtureRequest) -> PromptedSegmenter:
    family, encoder, decoder = MAKERS[request.param]
    folder = FIXTURES / request.param
    return family(Session(folder / f"{encoder}.onnx"), Session(folder / f"{decoder}.onnx"))


def test_every_mask_is_one_that_a_point_gives(segmenter: PromptedSegmenter) -> None:
    view = pictures()["odd"]
    settings = GridSettings(points_per_side=3, min_iou=-100.0, min_stability=0.0, overlap=0.7)
    found = GridPrompter(segmenter, settings).segment_all(view)
    assert 0 < len(found.masks) <= 27
    assert found.masks.shape[1:] == view.shape[:2]
    encoded = segmenter.encode(view)
    candidates = [
        (encoded.frame.enlarge(mask[None])[0], iou)
        for points in (grid_points(view.shape[:2], 3)[k : k + 1] for k in range(9))
        for some in segmenter.prompt_points(encoded, points)
        for mask, iou in zip(some.logits[0], some.ious[0], strict=True)
    ]
    for mask, score in zip(found.masks, found.scores, strict=True):
        close = [m for m, iou in candidates if abs(iou - score) < 1e-4]
        assert max((m == mask).mean() for m in close) > 0.999
    for a in range(len(found.masks)):
        for b in range(a):
            one, other = (found.masks[k][::4, ::4] for k in (a, b))
            assert (one & other).sum() / (one | other).sum() <= 0.7


def test_doubtful_and_unstable_masks_go(segmenter: PromptedSegmenter) -> None:
    view = pictures()["odd"]
    loose = GridSettings(points_per_side=2, min_iou=-100.0, min_stability=0.0, overlap=1.0)
    everything = GridPrompter(segmenter, loose).segment_all(view)
    least = float(np.median(everything.scores))
    some = GridPrompter(
        segmenter, GridSettings(points_per_side=2, min_iou=least, min_stability=0.0, overlap=1.0)
    ).segment_all(view)
    assert (some.scores >= least).all()
    assert len(some.scores) == (everything.scores >= least).sum()
    none = GridPrompter(segmenter, GridSettings(points_per_side=2, min_iou=1e3)).segment_all(view)
    assert none.masks.shape == (0, *view.shape[:2])
    two = GridPrompter(
        segmenter, GridSettings(points_per_side=2, min_iou=-100, min_stability=0, overlap=1, max_masks=2)
    )
    assert len(two.segment_all(view).masks) == 2


def test_points_are_the_middles_of_tiles() -> None:
    points = grid_points((480, 640), 4)
    assert points.shape == (16, 2)
    np.testing.assert_allclose(points[:5], [[80, 60], [240, 60], [400, 60], [560, 60], [80, 180]])


def test_stability_leaves_the_padding_out() -> None:
    frame = Frame(50, 100, 64)  # in the square: rows 0..31 of 64
    logits = np.full((2, 16, 16), 5.0, np.float32)
    logits[:, 8:] = 0.5  # the padding: above -1, not above 1
    logits[1, :8, :8] = -0.5
    np.testing.assert_allclose(stability(logits, frame), [1.0, 0.5])
    assert stability(np.full((1, 16, 16), -9, np.float32), frame).tolist() == [0.0]


@pytest.mark.parametrize("overlap", [0.0, 0.3, 0.7, 1.0])
def test_distinct_equals_the_plain_loop(overlap: float) -> None:
    rng = np.random.default_rng(int(10 * overlap))
    masks = rng.random((30, 12, 9)) < rng.random((30, 1, 1))
    masks[7], masks[8] = False, masks[3]
    ranks = rng.random(30).astype(np.float32).round(1)
    kept: list[int] = []
    for k in sorted(range(30), key=lambda k: (-ranks[k], k)):
        ious = [(masks[k] & masks[j]).sum() / (masks[k] | masks[j]).sum() for j in kept]
        if masks[k].any() and all(iou <= overlap for iou in ious):
            kept.append(k)
    assert distinct(masks, ranks, overlap).tolist() == kept
    assert distinct(masks[:0], ranks[:0], overlap).tolist() == []
