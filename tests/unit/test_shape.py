"""What the shape encoder is given of a cloud, and the shipped network on shapes that nobody can mistake."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import irsd.models
from irsd.core.errors import ModelError
from irsd.perception.shape import MEASURES, MIN_POINTS, POINTS, Calibration, ShapeEncoder, features, grounded

SHIPPED = Path(irsd.models.__file__).parent / "nano" / "shape_encoder.onnx"


def box(size_m: tuple[float, float, float], bottom_m: float, count: int = 600) -> NDArray[np.float32]:
    """Points on the sides of an upright box."""
    rng = np.random.default_rng(3)
    points = rng.uniform(-0.5, 0.5, (count, 3))
    side = rng.integers(0, 3, count)
    points[np.arange(count), side] = np.sign(points[np.arange(count), side]) * 0.5
    return (points * size_m + [0, 0, bottom_m + size_m[2] / 2]).astype(np.float32)


@settings(max_examples=30, deadline=None)
@given(yaw=st.floats(-3, 3), x=st.floats(-40, 40), y=st.floats(-40, 40), floor=st.floats(-8, 8))
def test_where_and_how_a_thing_stands_does_not_matter(yaw: float, x: float, y: float, floor: float) -> None:
    cloud = box((0.5, 1.4, 0.7), 0.1)
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    moved = (cloud @ turn.T + [x, y, floor]).astype(np.float32)
    points, measures = features(cloud, 0.0)
    again, same = features(moved, floor)
    np.testing.assert_allclose(measures, same, atol=2e-3)
    # Which way a side points is free: both halves of the box are alike.
    np.testing.assert_allclose(np.sort(np.abs(points), 0), np.sort(np.abs(again), 0), atol=5e-3)


def test_measures_are_those_of_the_box_but_for_stray_points() -> None:
    cloud = np.concatenate([box((0.5, 1.4, 0.7), 0.1), np.float32([[3.0, 0.0, 2.0]])])
    points, measures = features(cloud, 0.0)
    assert points.shape == (POINTS, 4)
    assert measures.shape == (MEASURES,)
    np.testing.assert_allclose(np.exp(measures[:3]), [0.5, 1.4, 0.7], atol=0.05)
    np.testing.assert_allclose(measures[3:5], [0.1, 0.8], atol=0.03)


@settings(max_examples=30, deadline=None)
@given(bottom=st.floats(-0.05, 1.5), floor=st.floats(-8, 8))
def test_what_ends_just_above_the_floor_stands_on_it_and_keeps_its_top(bottom: float, floor: float) -> None:
    cloud = box((0.5, 1.4, 0.7), bottom + floor)
    out = grounded(cloud, floor)
    np.testing.assert_array_equal(out[:, :2], cloud[:, :2])
    assert abs(float(out[:, 2].max()) - (bottom + floor + 0.7)) < 1e-3
    low = float(out[:, 2].min()) - floor
    if 0.04 < bottom < 0.19:
        assert abs(low - 0.02) < 0.01
        upper = cloud[:, 2] > bottom + floor + 0.07
        np.testing.assert_array_equal(out[upper], cloud[upper])
    elif not 0.02 < bottom < 0.21:
        np.testing.assert_array_equal(out, cloud)


def test_the_shipped_network_gives_unit_rows_and_nothing_for_almost_no_points() -> None:
    encoder = ShapeEncoder(SHIPPED)
    clouds = [box((0.5, 1.4, 0.7), 0.1), np.zeros((MIN_POINTS - 1, 3), np.float32), box((0.1, 0.1, 0.1), 1.0, 30)]
    vectors = encoder.encode(clouds, 0.0)
    assert vectors.dtype == np.float32
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=1), [1, 0, 1], atol=1e-4)
    np.testing.assert_allclose(encoder.encode(clouds[2:], 0.0)[0], vectors[2], atol=1e-5)
    assert encoder.encode([], 0.0).shape == (0, encoder.dimension)


def test_probabilities_sum_to_one_and_follow_the_cosine() -> None:
    share = Calibration(20.0, 0.3).probabilities(np.float32([[0.9, 0.5, 0.5], [0.1, 0.1, 0.1]]))
    np.testing.assert_allclose(share.sum(1), 1, atol=1e-6)
    np.testing.assert_allclose(share[1], 1 / 3, atol=1e-6)
    np.testing.assert_allclose(share[0, 0] / share[0, 1], np.exp(8.0), rtol=1e-4)


def test_a_model_without_its_calibration_is_refused(tmp_path: Path) -> None:
    copy = tmp_path / "shape.onnx"
    copy.write_bytes(SHIPPED.read_bytes())
    with pytest.raises(ModelError, match="calibration"):
        ShapeEncoder(copy)
    copy.with_suffix(".json").write_text(json.dumps({"scale": "much"}))
    with pytest.raises(ModelError, match="calibration"):
        ShapeEncoder(copy)
