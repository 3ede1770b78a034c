"""Algorithm 1's merging of walls and levels, and outlines snapped onto walls."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from irsd.rooms.walls import WallSettings, find_walls, merge_levels, polygon_area, snapped

Points = NDArray[np.float64]


def wall(
    start: tuple[float, float], end: tuple[float, float], seed: int, noise_m: float = 0.01
) -> tuple[Points, Points]:
    """Points [N, 3] on a wall of 2 m height, 200 per metre, and normals to the left of start -> end."""
    rng = np.random.default_rng(seed)
    a, b = np.array(start), np.array(end)
    length = np.linalg.norm(b - a)
    direction = (b - a) / length
    normal = np.array([-direction[1], direction[0]])
    count = int(200 * length)
    xy = a + direction * rng.uniform(0, length, (count, 1)) + normal * rng.normal(0, noise_m, (count, 1))
    points = np.column_stack([xy, rng.uniform(0, 2, count)])
    return points, np.tile([*normal, 0.0], (count, 1))


def room_walls(angle_rad: float) -> tuple[Points, Points]:
    """Four walls of a room of 5 x 4 m, turned about the origin."""
    corners = [(0, 0), (5, 0), (5, 4), (0, 4)]
    parts = [wall(corners[k], corners[(k + 1) % 4], seed=k) for k in range(4)]
    points, normals = (np.concatenate([p[i] for p in parts]) for i in (0, 1))
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    return points @ turn.T, normals @ turn.T


def test_no_points_no_walls() -> None:
    assert len(find_walls(np.zeros((0, 3)), np.zeros((0, 3)), WallSettings())) == 0


@settings(max_examples=20, deadline=None)
@given(st.floats(0, 6.28))
def test_a_room_has_four_walls_whatever_its_direction(angle_rad: float) -> None:
    walls = find_walls(*room_walls(angle_rad), WallSettings())
    assert len(walls) == 4
    np.testing.assert_allclose(sorted(np.diff(walls.span)[:, 0]), [4, 4, 5, 5], atol=0.1)
    assert (walls.offset < 0.05).all() or angle_rad > 0  # normals look into the room


def test_pieces_with_a_small_gap_merge_and_both_faces_of_a_wall_do_not() -> None:
    one, two, back = wall((0, 0), (2, 0), 1), wall((2.3, 0), (5, 0), 2), wall((5, -0.12), (0, -0.12), 3)
    points, normals = (np.concatenate([p[i] for p in (one, two, back)]) for i in (0, 1))
    walls = find_walls(points, normals, WallSettings())
    assert len(walls) == 2
    assert walls.normal[0] @ walls.normal[1] == pytest.approx(-1, abs=0.01)
    assert np.diff(walls.span)[:, 0].min() > 4.8


def test_tau_2_keeps_walls_of_other_directions_apart() -> None:
    parts = (wall((0, 0), (3, 0), 1), wall((3, 0), (5.6, 1.5), 2))  # 30 degrees
    points, normals = (np.concatenate([p[i] for p in parts]) for i in (0, 1))
    assert len(find_walls(points, normals, WallSettings())) == 2


@pytest.mark.parametrize(
    ("heights", "expected"),
    [([], []), ([0.0, 0.04, 2.6], [0.02, 0.02, 2.6]), ([3.0, 0.0, 2.95], [2.975, 0.0, 2.975])],
)
def test_levels_within_tau_3_are_one(heights: list[float], expected: list[float]) -> None:
    merged = merge_levels(np.array(heights), np.ones(len(heights)), 0.1)
    np.testing.assert_allclose(merged, expected)


@pytest.mark.parametrize("angle_rad", [0.0, 0.4, 1.9])
def test_an_outline_beside_its_walls_is_moved_onto_them(angle_rad: float) -> None:
    walls = find_walls(*room_walls(angle_rad), WallSettings())
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    turn = np.array([[c, -s], [s, c]])
    rough = np.array([[0.1, 0.12], [4.9, 0.05], [4.95, 3.9], [0.07, 3.93]]) @ turn.T
    exact = np.array([[0, 0], [5, 0], [5, 4], [0, 4]]) @ turn.T
    np.testing.assert_allclose(snapped(rough, walls, 0.25), exact, atol=0.03)


def test_an_outline_without_walls_near_stays_as_it_is() -> None:
    walls = find_walls(*room_walls(0.0), WallSettings())
    far = np.array([[10.0, 10.0], [12.0, 10.0], [12.0, 12.0]])
    np.testing.assert_array_equal(snapped(far, walls, 0.25), far)
    assert polygon_area(far) == pytest.approx(2.0)
