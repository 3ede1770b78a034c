"""Rigid transforms and rotations as pure functions over arrays.

Poses are 4x4 float64 matrices named ``parent_T_child`` (REP-105): ``points_parent = parent_T_child @ points_child``.
Quaternions are ``[x, y, z, w]`` and named ``quat_xyzw``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.floating]
Pose = NDArray[np.float64]


def quat_xyzw_to_matrix(quat_xyzw: FloatArray) -> NDArray[np.float64]:
    """Rotation matrices [..., 3, 3] of quaternions [..., 4]; they are normalised first.

    Raises ValueError for a quaternion that is not finite or has no length.
    """
    quat = np.asarray(quat_xyzw, np.float64)
    norm = np.linalg.norm(quat, axis=-1, keepdims=True)
    if not np.isfinite(norm).all() or (norm < 1e-9).any():
        raise ValueError(f"quaternion has no direction: {quat.tolist()}")
    x, y, z, w = np.moveaxis(quat / norm, -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    matrix: NDArray[np.float64] = np.stack([np.stack(row, -1) for row in rows], -2)
    return matrix


def matrix_to_quat_xyzw(rotation: FloatArray) -> NDArray[np.float64]:
    """Quaternion [4] with w >= 0 of one rotation matrix [3, 3] (Shepperd's method: the largest component first)."""
    m = np.asarray(rotation, np.float64)
    squares = np.array(
        [
            1 + m[0, 0] - m[1, 1] - m[2, 2],
            1 - m[0, 0] + m[1, 1] - m[2, 2],
            1 - m[0, 0] - m[1, 1] + m[2, 2],
            1 + m[0, 0] + m[1, 1] + m[2, 2],
        ]
    )
    largest = int(squares.argmax())
    sums = np.array(
        [
            [squares[0], m[0, 1] + m[1, 0], m[0, 2] + m[2, 0], m[2, 1] - m[1, 2]],
            [m[0, 1] + m[1, 0], squares[1], m[1, 2] + m[2, 1], m[0, 2] - m[2, 0]],
            [m[0, 2] + m[2, 0], m[1, 2] + m[2, 1], squares[2], m[1, 0] - m[0, 1]],
            [m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1], squares[3]],
        ]
    )
    quat: NDArray[np.float64] = sums[largest] / np.linalg.norm(sums[largest])
    return quat if quat[3] >= 0 else -quat


def slerp(quat_a_xyzw: FloatArray, quat_b_xyzw: FloatArray, fraction: FloatArray) -> NDArray[np.float64]:
    """Spherical interpolation along the shorter arc (Shoemake 1985, eq. in section 3.3).

    quat_*_xyzw [N, 4] (or [4]), fraction [N] in 0..1; returns [N, 4] unit quaternions.
    """
    a = np.atleast_2d(np.asarray(quat_a_xyzw, np.float64))
    b = np.atleast_2d(np.asarray(quat_b_xyzw, np.float64))
    t = np.atleast_1d(np.asarray(fraction, np.float64))[:, None]
    dot = (a * b).sum(-1, keepdims=True)
    b = np.where(dot < 0, -b, b)
    angle = np.arccos(np.clip(np.abs(dot), 0.0, 1.0))
    sine = np.sin(angle)
    near = sine < 1e-6
    safe = np.where(near, 1.0, sine)
    weight_a = np.where(near, 1 - t, np.sin((1 - t) * angle) / safe)
    weight_b = np.where(near, t, np.sin(t * angle) / safe)
    out = weight_a * a + weight_b * b
    unit: NDArray[np.float64] = out / np.linalg.norm(out, axis=-1, keepdims=True)
    return unit


def make_pose(position_m: FloatArray, quat_xyzw: FloatArray) -> Pose:
    """Poses [..., 4, 4] from positions [..., 3] and quaternions [..., 4]."""
    rotation = quat_xyzw_to_matrix(quat_xyzw)
    pose = np.zeros((*rotation.shape[:-2], 4, 4))
    pose[..., :3, :3] = rotation
    pose[..., :3, 3] = position_m
    pose[..., 3, 3] = 1.0
    return pose


def pose_from_xy_yaw(x_m: float, y_m: float, yaw_rad: float, z_m: float = 0.0) -> Pose:
    """Pose of a body that stands upright at (x, y, z), turned by yaw about z."""
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    return np.array([[c, -s, 0, x_m], [s, c, 0, y_m], [0, 0, 1, z_m], [0, 0, 0, 1.0]])


def yaw_of(pose: FloatArray) -> float:
    """Heading of a pose about z, in (-pi, pi]."""
    return float(np.arctan2(pose[1, 0], pose[0, 0]))


def invert(pose: FloatArray) -> Pose:
    """Inverse of rigid transforms [..., 4, 4]."""
    pose = np.asarray(pose, np.float64)
    out: Pose = np.zeros(pose.shape)
    transposed = np.swapaxes(pose[..., :3, :3], -1, -2)
    out[..., :3, :3] = transposed
    out[..., :3, 3] = -(transposed @ pose[..., :3, 3, None])[..., 0]
    out[..., 3, 3] = 1.0
    return out


def transform(parent_T_child: FloatArray, points_child: FloatArray) -> FloatArray:
    """Points [N, 3] moved by one pose [4, 4]; keeps the dtype of the points."""
    points = np.asarray(points_child)
    rotation = np.asarray(parent_T_child)[:3, :3].astype(points.dtype)
    return np.asarray(points @ rotation.T + np.asarray(parent_T_child)[:3, 3].astype(points.dtype))


_TURN_LIMIT_RADPS = 10.0
_JUMP_M, _JUMP_RAD = 0.3, 0.5  # less than that in one step is noise, however short the step


def farthest_step(passed_s: float, max_speed_mps: float) -> tuple[float, float]:
    """How far (metres) and by what turn (rad) odometry may step in a time; more is a jump."""
    return max(_JUMP_M, max_speed_mps * passed_s), max(_JUMP_RAD, _TURN_LIMIT_RADPS * passed_s)
