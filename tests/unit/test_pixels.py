"""Preprocessing for pictures of any size; equality with the reference processors is in tests/contract."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from irsd.core.errors import ModelError
from irsd.perception.pixels import CLIP_LEVELS, UNIT_LEVELS, crop_square, padded_square, planes, resize, within

SIDES = st.integers(1, 300)


def picture(height: int, width: int) -> np.ndarray:
    y, x = np.mgrid[:height, :width]
    return np.stack([x * 5 % 256, y * 3 % 256, (x * y + x) % 256], 2).astype(np.uint8)


@settings(max_examples=60, deadline=None)
@given(SIDES, SIDES, st.sampled_from([16, 33]))
def test_the_crop_is_the_middle_of_the_resized_picture(height: int, width: int, side_px: int) -> None:
    view = picture(height, width)
    found = crop_square(view, side_px, "bicubic")
    assert found.shape == (side_px, side_px, 3)
    short = min(height, width)
    full = (int(side_px * height / short), int(side_px * width / short))
    whole = np.asarray(Image.fromarray(view).resize(full[::-1], Image.Resampling.BICUBIC))
    top, left = (full[0] - side_px) // 2, (full[1] - side_px) // 2
    expected = whole[top : top + side_px, left : left + side_px]
    if max(height, width) <= 8 * short:
        np.testing.assert_array_equal(found, expected)
    else:  # of a sliver only the middle was resized: its grid lies up to half a source pixel aside
        assert abs(float(found.mean()) - float(expected.mean())) < 40


def test_a_sliver_costs_no_more_than_its_middle() -> None:
    assert crop_square(np.full((2, 4000, 3), 77, np.uint8), 224, "bilinear").mean() == 77


@settings(max_examples=200, deadline=None)
@given(st.integers(1, 5000), st.integers(1, 5000))
def test_sizes_keep_to_the_limits(height: int, width: int) -> None:
    found = within(height, width, 800, 1333)
    assert min(found) >= 1
    assert min(found) <= 800
    if max(height, width) < 20 * min(height, width):
        assert max(found) <= 1334  # rounding of the shorter side
        assert max(found) / min(found) == pytest.approx(max(height, width) / min(height, width), rel=0.03)
    assert (found[0] >= found[1]) == (height >= width) or found[0] == found[1]


@settings(max_examples=30, deadline=None)
@given(SIDES, SIDES)
def test_a_padded_square_holds_the_picture_at_its_top_left(height: int, width: int) -> None:
    found = padded_square(np.full((height, width, 3), 255, np.uint8), 40, UNIT_LEVELS)
    assert found.shape == (3, 40, 40)
    assert found.dtype == np.float32
    assert found.min() >= 0.5 - 1e-6
    if min(height, width) > max(height, width) / 3:  # else the smoothing may reach across it
        assert found[:, 0, 0] == pytest.approx(1, abs=0.01)
    if width < height / 2:
        assert found[:, :, -1] == pytest.approx(0.5, abs=0.01)


def test_levels() -> None:
    view = picture(5, 7)
    expected = ((view / 255 - CLIP_LEVELS.mean) / CLIP_LEVELS.std).transpose(2, 0, 1)
    np.testing.assert_allclose(planes(view, CLIP_LEVELS), expected, atol=1e-6)


@pytest.mark.parametrize("shape", [(0, 5, 3), (5, 0, 3), (5, 5), (5, 5, 4)])
def test_what_is_no_picture_is_refused(shape: tuple[int, ...]) -> None:
    for make in (lambda v: resize(v, 8, 8, "bilinear"), lambda v: crop_square(v, 8, "bilinear")):
        with pytest.raises(ModelError, match="a picture of shape"):
            make(np.zeros(shape, np.uint8))
