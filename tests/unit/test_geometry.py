"""Rotations, interpolation and poses against their definitions."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation, Slerp

from irsd.core.geometry import (
    invert,
    make_pose,
    matrix_to_quat_xyzw,
    pose_from_xy_yaw,
    quat_xyzw_to_matrix,
    slerp,
    transform,
    yaw_of,
)

quats = arrays(np.float64, 4, elements=st.floats(-1, 1)).filter(lambda q: np.linalg.norm(q) > 1e-3)
vectors = arrays(np.float64, 3, elements=st.floats(-100, 100))


@given(quats)
def test_rotation_equals_scipy_and_comes_back(quat: np.ndarray) -> None:
    matrix = quat_xyzw_to_matrix(quat)
    np.testing.assert_allclose(matrix, Rotation.from_quat(quat).as_matrix(), atol=1e-12)
    back = matrix_to_quat_xyzw(matrix)
    assert back[3] >= 0
    np.testing.assert_allclose(quat_xyzw_to_matrix(back), matrix, atol=1e-12)


@given(quats, quats, st.floats(0, 1))
def test_slerp_equals_scipy(a: np.ndarray, b: np.ndarray, fraction: float) -> None:
    ours = slerp(a / np.linalg.norm(a), b / np.linalg.norm(b), np.array([fraction]))[0]
    theirs = Slerp([0, 1], Rotation.from_quat([a, b]))(fraction).as_matrix()
    apart = Rotation.from_quat([a, b])
    half_turn = (apart[0].inv() * apart[1]).magnitude() > np.pi - 1e-3  # either way round is right there
    assert half_turn or np.allclose(quat_xyzw_to_matrix(ours), theirs, atol=1e-6)


@given(quats, vectors)
def test_inverse_undoes(quat: np.ndarray, position: np.ndarray) -> None:
    pose = make_pose(position, quat)
    np.testing.assert_allclose(invert(pose) @ pose, np.eye(4), atol=1e-9)


def test_transform_of_no_points_and_of_one() -> None:
    map_T_base = pose_from_xy_yaw(1.0, 2.0, np.pi / 2)
    assert transform(map_T_base, np.zeros((0, 3), np.float32)).shape == (0, 3)
    moved = transform(map_T_base, np.array([[1.0, 0.0, 0.5]], np.float32))
    assert moved.dtype == np.float32
    np.testing.assert_allclose(moved, [[1.0, 3.0, 0.5]], atol=1e-6)
    assert yaw_of(map_T_base) == pytest.approx(np.pi / 2)


def test_a_quaternion_without_direction_is_refused() -> None:
    with pytest.raises(ValueError, match="no direction"):
        quat_xyzw_to_matrix(np.zeros(4))
