"""The voxel map against brute force, and its bounds."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from irsd.mapping import kernels
from irsd.mapping.structure_kernels import line_fit
from irsd.mapping.voxels import VoxelMap, VoxelSettings

ORIGIN = np.array([0.0, 0.0, 0.6])
VOXEL = 0.04


def safe_points(seed: int, count: int, spread: int = 60) -> np.ndarray:
    """Points [count, 3] near voxel centres, so that rounding never moves one to the next voxel."""
    rng = np.random.default_rng(seed)
    keys = rng.integers(-spread, spread, (count, 3))
    return ((keys + 0.5 + rng.uniform(-0.4, 0.4, (count, 3))) * VOXEL).astype(np.float32)


def brute_means(points: np.ndarray) -> dict[tuple[int, ...], np.ndarray]:
    cells: dict[tuple[int, ...], list[np.ndarray]] = {}
    for point in points.astype(np.float64):
        cells.setdefault(tuple(int(v) for v in np.floor(point / VOXEL)), []).append(point)
    return {key: np.mean(values, 0) for key, values in cells.items()}


def state_of(voxels: VoxelMap) -> dict[tuple[int, ...], np.ndarray]:
    rows = voxels.live_rows()
    keys = np.floor(voxels.mean[rows].astype(np.float64) / VOXEL).astype(np.int64)
    return {tuple(int(v) for v in key): voxels.mean[row] for key, row in zip(keys, rows, strict=True)}


def test_empty_scan_changes_nothing():
    voxels = VoxelMap(VoxelSettings())
    touched = voxels.insert(np.zeros((0, 3), np.float32), ORIGIN, 1)
    assert len(touched.rows) == len(touched.row_of_point) == len(voxels) == 0
    assert (voxels.rows_at(safe_points(0, 5)) == -1).all()


@pytest.mark.parametrize("spread", [3, 60, 2000])
def test_means_are_those_of_brute_force(spread):
    points = safe_points(1, 3000, spread)
    voxels = VoxelMap(VoxelSettings(memory_hits=10_000))
    for stamp, part in enumerate(np.array_split(points, 3)):
        touched = voxels.insert(part, ORIGIN, stamp)
        assert (touched.row_of_point == voxels.rows_at(part)).all()
        assert sorted(set(touched.row_of_point.tolist())) == sorted(touched.rows.tolist())
    expected, got = brute_means(points), state_of(voxels)
    assert expected.keys() == got.keys()
    assert len(voxels) == len(expected)
    for key, mean in expected.items():
        np.testing.assert_allclose(got[key], mean, atol=1e-5)


def test_order_within_a_scan_does_not_matter():
    points = safe_points(2, 2000, 20)
    one, other = VoxelMap(VoxelSettings()), VoxelMap(VoxelSettings())
    rows = one.insert(points, ORIGIN, 0).rows
    again = other.insert(points[np.random.default_rng(3).permutation(len(points))], ORIGIN, 0).rows
    np.testing.assert_array_equal(rows, again)
    np.testing.assert_allclose(one.mean[rows], other.mean[rows], atol=1e-6)
    np.testing.assert_allclose(one.normal, other.normal, atol=1e-3)


@pytest.mark.parametrize("shift", [(2, 0, 0), (-40, 16, 6), (1001, -777, 3)])
def test_moving_everything_by_whole_voxels_moves_the_map(shift):
    points = safe_points(4, 800, 20)
    offset = np.array(shift) * VOXEL
    here, there = VoxelMap(VoxelSettings()), VoxelMap(VoxelSettings())
    here.insert(points, ORIGIN, 0)
    there.insert((points + offset).astype(np.float32), ORIGIN + offset, 0)
    moved = {tuple(np.add(key, shift).tolist()): mean + offset for key, mean in state_of(here).items()}
    got = state_of(there)
    assert moved.keys() == got.keys()
    for key, mean in moved.items():
        np.testing.assert_allclose(got[key], mean, atol=1e-4)


def test_points_that_are_not_finite_or_absurdly_far_are_left_out():
    bad = np.array([[np.nan, 0, 0], [np.inf, 0, 0], [1e9, 0, 0], [0.1, 0.1, 0.1]], np.float32)
    voxels = VoxelMap(VoxelSettings())
    touched = voxels.insert(bad, ORIGIN, 0)
    assert touched.row_of_point.tolist() == [-1, -1, -1, 0]
    assert np.isfinite(voxels.mean).all()
    assert np.isfinite(voxels.normal).all()


def test_a_mean_follows_drift_once_its_memory_is_full():
    voxels = VoxelMap(VoxelSettings(memory_hits=4))
    for x in [0.001] * 20 + [0.039] * 20:
        row = voxels.insert(np.array([[x, 0.02, 0.02]], np.float32), ORIGIN, 0).rows[0]
    assert voxels.mean[row, 0] == pytest.approx(0.039, abs=0.001)


def test_memory_is_bounded_and_the_farthest_is_forgotten():
    voxels = VoxelMap(VoxelSettings(max_voxels=1000))
    for step in range(30):
        offset = np.array([step * 2.0, 0, 0])
        points = (safe_points(step, 300, 20) + offset).astype(np.float32)
        voxels.insert(points, ORIGIN + offset, step)
        assert len(voxels) <= 1000
        rows = voxels.live_rows()
        assert len(rows) == len(voxels)
        np.testing.assert_array_equal(voxels.rows_at(voxels.mean[rows]), rows)
        assert (voxels.rows_at(points) >= 0).all()
    assert voxels.evicted > 0
    assert voxels.refused == 0
    assert voxels.row_count <= 1000
    assert voxels.mean[voxels.live_rows(), 0].min() > 50


def test_a_scan_larger_than_the_map_is_cut_and_counted():
    voxels = VoxelMap(VoxelSettings(max_voxels=1000))
    touched = voxels.insert(safe_points(5, 5000, 400), ORIGIN, 0)
    assert len(voxels) == len(touched.rows) <= 1000
    assert voxels.refused > 0
    assert (touched.row_of_point < 0).any()


@pytest.mark.parametrize("normal", [(0, 0, 1), (1, 0, 0), (0.6, 0.8, 0), (0.48, 0.6, 0.64)])
def test_normals_of_a_noisy_plane_face_the_sensor(normal):
    rng = np.random.default_rng(6)
    n = np.array(normal, float)
    side = np.cross(n, [0.3, -0.5, 0.81])
    side /= np.linalg.norm(side)
    plane = rng.uniform(-1, 1, (20_000, 2)) @ np.stack([side, np.cross(n, side)])
    points = (plane + rng.normal(0, 0.008, (20_000, 1)) * n - 2 * n).astype(np.float32)
    voxels = VoxelMap(VoxelSettings())
    for part in np.array_split(points, 4):
        rows = voxels.insert(part, np.zeros(3), 0).rows
    got = voxels.normal[voxels.coarse[rows]]
    known = got.any(-1)
    assert known.mean() > 0.9
    np.testing.assert_allclose(np.linalg.norm(got[known], axis=-1), 1, atol=1e-4)
    assert np.percentile(got[known] @ n, 5) > 0.98


def test_plane_and_line_fits_are_those_of_an_eigensolver():
    rng = np.random.default_rng(7)
    groups = rng.integers(0, 50, 4000)
    points = rng.normal(size=(4000, 3)) * rng.uniform(0.01, 1, (50, 3))[groups] + rng.normal(size=(50, 3))[groups]
    normals, variances = kernels.plane_fits(kernels.group_moments(points, groups.astype(np.int32), 50))
    for k in range(50):
        values, vectors = np.linalg.eigh(np.cov(points[groups == k].T, bias=True))
        np.testing.assert_allclose(variances[k], values, rtol=1e-5, atol=1e-9)
        assert abs(normals[k] @ vectors[:, 0]) > 1 - 1e-6
    flat = np.stack(
        [np.ones(4000), *points[:, :2].T, points[:, 0] ** 2, points[:, 0] * points[:, 1], points[:, 1] ** 2], -1
    )
    moments = np.stack([flat[groups == k].sum(0) for k in range(50)])
    for k in range(50):
        nx, ny, x, y, across, along = line_fit(moments[k])
        values, vectors = np.linalg.eigh(np.cov(points[groups == k, :2].T, bias=True))
        np.testing.assert_allclose((across, along), values, rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose((x, y), points[groups == k, :2].mean(0), atol=1e-9)
        assert abs(np.array([nx, ny]) @ vectors[:, 0]) > 1 - 1e-6


def test_degenerate_moments_give_finite_fits():
    point = kernels.group_moments(np.zeros((3, 3)), np.zeros(3, np.int32), 1)
    for moments in (point, np.zeros((1, 10))):
        normal, variance = kernels.plane_fits(moments)
        assert np.isfinite(normal).all()
        assert np.isfinite(variance).all()


def test_moments_of_a_cells_surroundings_are_those_of_the_points_in_it():
    points = safe_points(8, 4000, 12)
    voxels = VoxelMap(VoxelSettings())
    rows = voxels.insert(points, ORIGIN, 0).rows
    cells = np.unique(voxels.coarse[rows]).astype(np.int64)
    size = 2 * VOXEL
    windows = kernels.window_moments(cells, voxels.neighbours, voxels.moments, size)
    cell_of_point = np.floor(points / size).astype(int)
    for cell, window in zip(cells[::20], windows[::20], strict=True):
        row = rows[voxels.coarse[rows] == cell][0]
        key = np.floor(voxels.mean[row] / size).astype(int)
        near = points[(np.abs(cell_of_point - key) <= 1).all(-1)] - (key + 0.5) * size
        expected = kernels.group_moments(near, np.zeros(len(near), np.int32), 1)[0]
        np.testing.assert_allclose(window, expected, rtol=1e-4, atol=1e-3)


def test_groups_are_those_of_unique():
    packed = np.random.default_rng(9).integers(-1, 40, 300)
    keys, of_point = kernels.group(packed, np.argsort(packed, kind="stable"))
    np.testing.assert_array_equal(keys, np.unique(packed[packed >= 0]))
    np.testing.assert_array_equal(np.where(of_point < 0, -1, keys[of_point]), packed)


@given(st.lists(st.tuples(*[st.integers(-(2**16), 2**16)] * 3), min_size=1, max_size=50))
def test_packing_keeps_keys_apart(keys):
    array = np.array(keys, np.int64)
    packed = kernels.pack_points(((array + 0.5) * VOXEL).astype(np.float32), VOXEL)
    assert len(set(packed.tolist())) == len(set(keys))
    np.testing.assert_array_equal(kernels.unpack_blocks(packed >> 9), array >> kernels.BLOCK_BITS)
    for key, block in zip(kernels.unpack_blocks(packed >> 9).tolist(), (packed >> 9).tolist(), strict=True):
        assert list(kernels.block_place(block)) == key


def test_what_was_carried_away_is_forgotten_and_found_anew() -> None:
    voxels = VoxelMap(VoxelSettings())
    x, y, z = np.meshgrid(np.arange(0.02, 0.4, 0.04), np.arange(0.02, 0.4, 0.04), np.arange(0.02, 0.4, 0.04))
    cube = np.stack([x, y, z], -1).reshape(-1, 3).astype(np.float32)
    both = np.concatenate([cube, cube + np.float32(2.0)])
    voxels.insert(both, np.zeros(3), 5)
    low, high = np.full(3, -0.1, np.float32), np.full(3, 0.5, np.float32)
    rows = voxels.rows_within(low, high)
    assert sorted(map(tuple, voxels.mean[rows].tolist())) == sorted(map(tuple, cube.tolist()))
    assert (voxels.made_ns[rows] == 5).all()
    voxels.remove(cube)
    assert len(voxels) == len(cube)
    assert not len(voxels.rows_within(low, high))
    assert (voxels.rows_at(cube) == -1).all()
    assert (voxels.rows_at(cube + np.float32(2.0)) >= 0).all()
    voxels.remove(cube)  # nothing there: nothing happens
    voxels.insert(both, np.zeros(3), 9)
    assert len(voxels) == 2 * len(cube)
    assert (voxels.made_ns[voxels.rows_at(cube)] == 9).all()
    assert (voxels.made_ns[voxels.rows_at(cube + np.float32(2.0))] == 5).all()
