from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from irsd.graph.shapes import box_of


def test_no_points_no_box() -> None:
    with pytest.raises(ValueError, match="no points"):
        box_of(np.zeros((0, 3), np.float32))


def test_one_point_is_a_centimetre() -> None:
    box = box_of(np.array([[1.0, 2.0, 3.0]]))
    assert box.centroid_m == box.aabb_min_m == box.aabb_max_m == box.obb_center_m == (1.0, 2.0, 3.0)
    assert box.obb_size_m == (0.0, 0.0, 0.0)
    assert box.volume_m3 == pytest.approx(1e-6)


@settings(max_examples=60, deadline=None)
@given(
    st.floats(-1.5, 1.5),
    st.floats(0.6, 3.0),
    st.floats(0.1, 0.5),
    st.floats(0.1, 2.0),
    st.floats(-500, 500),
    st.floats(-500, 500),
)
def test_a_turned_cuboid_is_found_again(yaw: float, a: float, b: float, c: float, x: float, y: float) -> None:
    rng = np.random.default_rng(1)
    inside = rng.uniform(-0.5, 0.5, (40, 3))
    corners = np.array(np.meshgrid([-0.5, 0.5], [-0.5, 0.5], [-0.5, 0.5])).reshape(3, -1).T
    turn = np.array([[math.cos(yaw), -math.sin(yaw), 0], [math.sin(yaw), math.cos(yaw), 0], [0, 0, 1]])
    points = (np.concatenate([corners, inside]) * [a, b, c]) @ turn.T + [x, y, 1.0]
    box = box_of(points)
    np.testing.assert_allclose(box.obb_size_m, (a, b, c), atol=2e-3)
    np.testing.assert_allclose(box.obb_center_m, (x, y, 1.0), atol=2e-3)
    assert -math.pi / 2 < box.obb_yaw_rad <= math.pi / 2
    assert abs(math.sin(box.obb_yaw_rad - yaw)) < 0.02  # a box turned by pi is the same box
    np.testing.assert_allclose(box.centroid_m, points.mean(0), atol=1e-9)
    assert box.volume_m3 == pytest.approx(a * b * c, rel=0.03)
