"""EfficientSAM through our adapter equals its pipeline in torch.

The networks inside are SAM's (see fixture_makers/efficient_sam.py): what is proven is the contract of the files (pixels, prompts,
choice and size of masks), not EfficientSAM's own layers.
"""

from __future__ import annotations

import numpy as np
import pytest
from contract_fixtures import BOXES, FIXTURES, POINTS, TOLERANCE, mask_agreement, pictures, reference, unpacked

from irsd.core.errors import ModelError
from irsd.perception.families.efficient_sam import EfficientSam
from irsd.perception.models import Session

FOLDER = FIXTURES / "efficient_sam"


@pytest.fixture(scope="module", params=["decoder", "decoder_one"])
def segmenter(request: pytest.FixtureRequest) -> EfficientSam:
    return EfficientSam(Session(FOLDER / "encoder.onnx"), Session(FOLDER / f"{request.param}.onnx"))


@pytest.mark.parametrize("name", BOXES)
def test_masks_are_those_of_the_reference(segmenter: EfficientSam, name: str) -> None:
    wanted, view = reference("efficient_sam"), pictures()[name]
    found = segmenter.segment(view, np.array(BOXES[name], np.float32))
    masks = unpacked(wanted[f"box_{name}_masks"], view)
    assert 0.05 < masks.mean() < 0.95
    np.testing.assert_allclose(found.scores, wanted[f"box_{name}_ious"].max(1), atol=TOLERANCE)
    assert mask_agreement(found.masks, masks) > 0.9999

    encoded = segmenter.encode(view)
    (points,) = segmenter.prompt_points(encoded, np.array(POINTS[name], np.float32))
    assert np.abs(points.ious - wanted[f"point_{name}_ious"]).max() <= TOLERANCE
    best = points.logits[np.arange(len(points.ious)), points.ious.argmax(1)]
    assert mask_agreement(encoded.frame.enlarge(best), unpacked(wanted[f"point_{name}_masks"], view)) > 0.9999


def test_files_that_do_not_fit_are_refused() -> None:
    encoder, decoder = (Session(FOLDER / f"{name}.onnx") for name in ("encoder", "decoder"))
    with pytest.raises(ModelError, match="lacks batched_images"):
        EfficientSam(decoder, decoder)
    with pytest.raises(ModelError, match="batched_point_coords"):
        EfficientSam(encoder, encoder)
