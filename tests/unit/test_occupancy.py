"""Occupancy by height slice: what one sees is what stands, and looking over a thing does not erase it."""

from __future__ import annotations

import numpy as np
import pytest

from irsd.mapping.occupancy import OccupancySettings, PlanArea, SliceGrid
from irsd.mapping.structure_kernels import locate

SENSOR = np.array([0.0, 0.0, 0.6])


def spot(x: float, y: float, z: float, count: int = 40) -> np.ndarray:
    """Returns around one place, float32 [count, 3]."""
    return (np.random.default_rng(0).normal(0, 0.004, (count, 3)) + np.array([x, y, z])).astype(np.float32)


def seen(grid: SliceGrid, points: np.ndarray, times: int = 1, floor: float = 0.0):
    origin = SENSOR + np.array([0, 0, floor])
    level = np.zeros(len(points), np.bool_)
    return [grid.integrate(points, origin, level, floor, floor + 2.6, turn) for turn in range(times)][-1]


def cell(grid: SliceGrid, x: float, y: float) -> int:
    frame, cells = grid.navigation()
    row, col = frame.cells_of(np.array([[x, y]]))[0]
    return int(cells[row, col])


def test_nothing_seen_is_an_empty_grid():
    frame, cells = SliceGrid(OccupancySettings()).navigation()
    assert cells.shape == (0, 0) == (frame.height, frame.width)
    _, layers = SliceGrid(OccupancySettings()).layers()
    assert all(layer.shape == (0, 0) for layer in layers.values())


@pytest.mark.parametrize("floor", [0.0, -3.2, 12.5])
def test_a_low_obstacle_stands_and_the_way_to_it_is_free(floor):
    grid = SliceGrid(OccupancySettings())
    seen(grid, spot(3.02, 0.02, floor + 0.2), 3, floor)
    assert cell(grid, 3.02, 0.02) == 100
    assert cell(grid, 2.0, 0.02) == 0  # passed at about 0.3 m
    assert cell(grid, 3.5, 0.02) == -1
    assert cell(grid, 0.0, 0.0) == 0


def test_the_floor_is_free_and_so_is_nothing_seen_only_from_above():
    grid = SliceGrid(OccupancySettings())
    seen(grid, np.concatenate([spot(2.02, 0.02, 0.0), spot(4.0, 2.0, 1.1)]), 5)
    assert cell(grid, 2.02, 0.02) == 0
    assert cell(grid, 3.0, 1.5) == -1  # rays pass at about 1 m: a counter may stand there


def test_rays_over_and_under_a_thing_do_not_erase_it():
    grid = SliceGrid(OccupancySettings())
    chair = spot(2.02, 0.02, 0.25)
    seen(grid, chair, 5)
    over, under = spot(4.02, 0.04, 0.75), spot(2.5, 0.025, 0.0)
    seen(grid, np.concatenate([over, under]), 60)
    assert cell(grid, 2.02, 0.02) == 100


def test_what_moved_away_fades_and_what_came_is_seen_at_once():
    grid = SliceGrid(OccupancySettings())
    seen(grid, spot(2.02, 0.02, 0.5), 50)
    assert cell(grid, 2.02, 0.02) == 100
    behind = spot(4.02, 0.04, 0.4)
    seen(grid, behind, 40)
    assert cell(grid, 2.02, 0.02) != 100
    seen(grid, spot(2.02, 0.02, 0.5), 6)
    assert cell(grid, 2.02, 0.02) == 100


def test_a_return_wins_over_rays_that_pass_in_the_same_scan():
    grid = SliceGrid(OccupancySettings())
    seen(grid, np.concatenate([spot(2.02, 0.02, 0.6, 2), spot(4.02, 0.04, 0.6, 200)]), 20)
    assert cell(grid, 2.02, 0.02) == 100


def test_a_skimmed_table_top_stays():
    grid = SliceGrid(OccupancySettings())
    x, y = np.meshgrid(np.arange(2.0, 3.0, 0.02), np.arange(-0.3, 0.3, 0.02))
    top = np.stack([x.ravel(), y.ravel(), np.full(x.size, 0.5)], -1).astype(np.float32)
    for turn in range(10):
        grid.integrate(top, SENSOR, np.ones(len(top), np.bool_), 0.0, 2.6, turn)
    frame, cells = grid.navigation()
    at = frame.cells_of(np.stack([x.ravel(), y.ravel()], -1))
    assert (cells[at[:, 0], at[:, 1]] == 100).mean() > 0.95


def test_plan_layers_tell_walls_from_furniture_and_lintels():
    grid = SliceGrid(OccupancySettings())
    points = [spot(3.02, 0.02, 1.9), spot(3.02, 1.02, 2.3), spot(3.02, -1.02, 0.8), spot(2.02, 2.02, 2.6)]
    seen(grid, np.concatenate(points), 3)
    frame, layers = grid.layers()

    def at(name: str, x: float, y: float) -> bool:
        row, col = frame.cells_of(np.array([[x, y]]))[0]
        return bool(layers[name][row, col])

    assert at("wall", 3.02, 0.02)
    assert not at("free", 3.02, 0.02)
    assert at("lintel", 3.02, 1.02)
    assert not at("wall", 3.02, 1.02)
    assert at("low", 3.02, -1.02)
    assert not at("wall", 3.02, -1.02)
    assert at("free", 2.02, 2.02)  # the ceiling was seen, nothing stands there
    assert not at("known", -4.0, 3.0)


def test_the_box_of_changes_holds_the_cells_that_changed():
    grid = SliceGrid(OccupancySettings())
    points = spot(3.02, -1.52, 0.3)
    before = seen(grid, points)
    assert before is not None
    x0, y0, x1, y1 = before
    assert x0 <= points[:, 0].min()
    assert x1 >= points[:, 0].max()
    assert y0 <= points[:, 1].min()
    assert y1 >= points[:, 1].max()
    assert [seen(grid, points, 20), seen(grid, points)][1] is None


def test_far_apart_places_grow_the_grid_and_keep_what_it_held():
    grid = SliceGrid(OccupancySettings())
    seen(grid, spot(3.02, 0.02, 0.3), 3)
    for x, y in [(-20.0, 0.0), (0.0, 31.0), (9.0, -14.0)]:
        origin = SENSOR + np.array([x, y, 0])
        grid.integrate(spot(x + 2.02, y, 0.3), origin, np.zeros(40, np.bool_), 0.0, None, 0)
    assert cell(grid, 3.02, 0.02) == 100
    frame, cells = grid.navigation()
    assert cells.shape == (frame.height, frame.width) == grid.area.shape


def test_the_area_is_bounded_and_refusals_are_counted():
    grid = SliceGrid(OccupancySettings(max_area_m2=400.0))
    seen(grid, spot(3.02, 0.02, 0.3), 3)
    origin = SENSOR + np.array([200, 0, 0])
    assert grid.integrate(spot(202.0, 0, 0.3), origin, np.zeros(40, np.bool_), 0.0, None, 0) is None
    assert grid.area.refused == 1
    height, width = grid.area.shape
    assert height * width * 0.05**2 <= 400
    assert cell(grid, 3.02, 0.02) == 100


def test_plan_area_places_cells_where_its_frame_says():
    area = PlanArea(0.05, 10_000)
    area.cover(np.array([-3.0, 1.0]), np.array([2.0, 9.0]))
    area.cover(np.array([-30.0, -11.0]), np.array([2.0, 9.0]))
    points = np.random.default_rng(1).uniform(-9, 9, (500, 2))
    cells = locate(area.plan, points)
    expected = area.frame.cells_of(points)
    inside = area.frame.inside(expected)
    np.testing.assert_array_equal(cells[inside], expected[inside])
    assert (cells[~inside] == -1).all()
    assert area.cover(np.array([0.0, 0.0]), np.array([1.0, 1.0])) is None
