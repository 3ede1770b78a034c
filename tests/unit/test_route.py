"""Routes: optimal against Dijkstra, free of obstacles, from where the robot is to exactly where it shall stand."""

from __future__ import annotations

import heapq
import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from irsd.core.grid import GridFrame
from irsd.graph.model import DoorEdge
from nav_bridge import route
from nav_bridge.route import (
    CostMap,
    RouteSettings,
    connected_to,
    find_path,
    line_cells,
    make_cost_map,
    path_cost,
    plan_route,
    resample,
    snap_to_passable,
)
from nav_bridge.search import least_clearance

SETTINGS = RouteSettings(robot_radius_m=0.1, clearance_m=0.0, comfort_m=0.2, spacing_m=0.5)
grids = st.integers(0, 2**32 - 1).map(lambda seed: random_grid(np.random.default_rng(seed)))


def random_grid(rng: np.random.Generator) -> NDArray[np.int8]:
    cells = np.zeros((int(rng.integers(6, 24)), int(rng.integers(6, 24))), np.int8)
    cells[rng.random(cells.shape) < rng.choice([0.02, 0.08, 0.2])] = 100
    cells[rng.random(cells.shape) < 0.03] = -1
    return cells


def costs_of(cells: NDArray[np.int8], options: RouteSettings = SETTINGS) -> CostMap:
    return make_cost_map(GridFrame((-1.0, 2.0), 0.1, *cells.shape), cells, options)


def dijkstra(costs: CostMap, start: tuple[int, int]) -> dict[tuple[int, int], float]:
    """The plain algorithm over all cells, as an oracle."""
    ok, price = costs.passable, costs.cost.astype(float)
    best, queue = {start: 0.0}, [(0.0, start)]
    while queue:
        so_far, (r, c) = heapq.heappop(queue)
        if so_far > best[(r, c)]:
            continue
        for dr in (-1, 0, 1):
            for dc in (-1, 0, 1):
                there = (r + dr, c + dc)
                if (dr, dc) == (0, 0) or not (0 <= there[0] < ok.shape[0] and 0 <= there[1] < ok.shape[1]):
                    continue
                if not (ok[there] and ok[r + dr, c] and ok[r, c + dc]):
                    continue
                total = so_far + math.hypot(dr, dc) * 0.5 * (price[r, c] + price[there])
                if total < best.get(there, math.inf) - 1e-12:
                    best[there] = total
                    heapq.heappush(queue, (total, there))
    return best


@settings(max_examples=60, deadline=None)
@given(grids, st.integers(0, 10**6), st.integers(0, 10**6))
def test_path_is_as_cheap_as_dijkstras(cells: NDArray[np.int8], a: int, b: int) -> None:
    costs = costs_of(cells)
    free = np.argwhere(costs.passable)
    if not len(free):
        return
    start, goal = (tuple(int(v) for v in free[k % len(free)]) for k in (a, b))
    path, oracle = find_path(costs, start, goal), dijkstra(costs, start)  # type: ignore[arg-type]
    assert (path is None) == (goal not in oracle)
    assert bool(connected_to(costs, start)[goal]) == (goal in oracle)  # type: ignore[arg-type, index]
    if path is None:
        return
    assert tuple(path[0]) == start
    assert tuple(path[-1]) == goal
    assert costs.passable[path[:, 0], path[:, 1]].all()
    assert (np.abs(np.diff(path, axis=0)).max(initial=0)) <= 1
    assert path_cost(costs, path) == pytest.approx(oracle[goal], rel=1e-5)  # type: ignore[index]


@settings(max_examples=60, deadline=None)
@given(grids, st.integers(0, 10**6), st.integers(0, 10**6))
def test_waypoints_are_free_and_end_where_they_shall(cells: NDArray[np.int8], a: int, b: int) -> None:
    costs = costs_of(cells)
    free = np.argwhere(costs.passable)
    if not len(free):
        return
    start_xy, goal_xy = (costs.frame.centres_of(free[k % len(free)][None])[0] for k in (a, b))
    route = plan_route(costs, (*start_xy, 0.3), (*goal_xy, 1.2), SETTINGS)
    if route is None:
        return
    points = np.array(route.waypoints)
    assert points[0, :2] == pytest.approx(start_xy, abs=1e-4)
    assert points[-1] == pytest.approx([*goal_xy, 1.2], abs=1e-4)
    steps = np.hypot(*np.diff(points[:, :2], axis=0).T)
    assert (steps <= SETTINGS.spacing_m + 1e-6).all()
    assert route.length_m == pytest.approx(steps.sum(), abs=1e-2)
    for p, q in itertools.pairwise(points):
        on = line_cells(costs.frame, p[:2], q[:2])
        assert not costs.blocked[on[:, 0], on[:, 1]].any()


@settings(max_examples=60, deadline=None)
@given(grids, *[st.floats(-2.0, 3.0)] * 4)
def test_clearance_along_a_line_is_that_of_the_cells_along_it(
    cells: NDArray[np.int8], x0: float, y0: float, x1: float, y1: float
) -> None:
    costs, a, b = costs_of(cells), (x0, y0 + 3.0), (x1, y1 + 3.0)
    on = line_cells(costs.frame, np.array(a), np.array(b))
    least = least_clearance(costs.clear_m, costs.frame.origin_xy_m, 0.1, a, b, 0.0)
    assert least == costs.clear_m[on[:, 0], on[:, 1]].min(initial=np.inf)
    assert least_clearance(costs.clear_m, costs.frame.origin_xy_m, 0.1, a, b, 0.2) <= least, "wider sees no less"


def test_clearance_is_preferred_where_there_is_room() -> None:
    cells = np.zeros((41, 81), np.int8)
    cells[[0, -1]] = cells[:, 0] = cells[:, -1] = 100
    cells[20, 30:50] = 100  # a bar in the middle: pass it, but not along it
    options = RouteSettings(robot_radius_m=0.2, clearance_m=0.0, comfort_m=0.4)
    costs = costs_of(cells, options)
    a, b = costs.frame.centres_of(np.array([[18, 10], [18, 70]]))
    route = plan_route(costs, (*a, 0.0), (*b, 0.0), options)
    assert route is not None
    assert route.clearance_m >= 0.4
    assert route.length_m <= 1.15 * math.dist(a, b)


def test_walls_part_and_unknown_is_a_policy() -> None:
    cells = np.zeros((20, 30), np.int8)
    cells[:, 15] = -1
    for unknown, found in (("avoid", False), ("allow", True)):
        options = RouteSettings(robot_radius_m=0.1, clearance_m=0.0, unknown=unknown)
        costs = costs_of(cells, options)
        a, b = costs.frame.centres_of(np.array([[10, 5], [10, 25]]))
        assert (plan_route(costs, (*a, 0.0), (*b, 0.0), options) is not None) is found


def test_a_robot_too_close_to_something_first_gets_clear() -> None:
    cells = np.zeros((20, 30), np.int8)
    cells[[0, -1]] = cells[:, 0] = cells[:, -1] = 100
    costs = costs_of(cells)
    here, there = costs.frame.centres_of(np.array([[1, 1], [10, 20]]))
    route = plan_route(costs, (*here, 0.0), (*there, 0.0), SETTINGS)
    assert route is not None
    assert route.waypoints[0][:2] == pytest.approx(tuple(here))
    assert snap_to_passable(costs, (50.0, 50.0), 1.0) is None


def test_where_a_robot_did_not_get_on_things_stand_out_farther() -> None:
    cells = np.zeros((60, 60), np.int8)
    cells[30, 30] = cells[5, 5] = 100
    cells[:, 55:] = -1
    costs = costs_of(cells)
    place = tuple(costs.frame.centres_of(np.array([[30, 27]]))[0])
    assert route.narrowed(costs, (), SETTINGS) is costs
    once, twice = (route.narrowed(costs, [place] * times, SETTINGS) for times in (1, 2))
    for narrow, cells_more in ((once, 1), (twice, 2)):
        assert np.array_equal(narrow.known, costs.known)
        more = np.argwhere(narrow.blocked & ~costs.blocked)
        assert len(more) == (2 * cells_more + 1) ** 2 - 1, "only round the place"
        assert np.abs(more - 30).max() == cells_more
    assert np.array_equal(costs.blocked, costs_of(cells).blocked), "the map itself is not touched"
    route.narrowed(costs, [(1e3, 1e3), (-1e3, 0.0)], SETTINGS)


def test_empty_ends() -> None:
    assert not make_cost_map(GridFrame((0.0, 0.0), 0.1, 0, 0), np.zeros((0, 0), np.int8), SETTINGS).passable.any()
    with pytest.raises(ValueError, match="frame says"):
        make_cost_map(GridFrame((0.0, 0.0), 0.1, 2, 2), np.zeros((3, 2), np.int8), SETTINGS)
    assert resample(np.zeros((1, 2)), 0.5).shape == (1, 2)
    assert resample(np.array([[0.0, 0.0], [1.0, 0.0]]), 0.3)[:, 0].tolist() == pytest.approx([0, 0.25, 0.5, 0.75, 1.0])


def test_a_slanting_corridor_is_one_line() -> None:
    rows, cols = np.mgrid[:60, :60]
    cells = np.where(np.abs(rows - cols) <= 4, 0, 100).astype(np.int8)
    options = RouteSettings(robot_radius_m=0.1, clearance_m=0.0, comfort_m=0.3, spacing_m=1.0)
    costs = costs_of(cells, options)
    a, b = costs.frame.centres_of(np.array([[8, 8], [50, 50]]))
    route = plan_route(costs, (*a, 0.0), (*b, 0.0), options)
    assert route is not None
    assert len(route.waypoints) == 1 + math.ceil(math.dist(a, b) / 1.0)


def test_a_large_map_is_searched_near_a_coarse_way_and_no_worse(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(3)
    cells = np.zeros((403, 351), np.int8)
    cells[::60] = cells[:, ::75] = 100
    for row, col in rng.integers(0, 340, (60, 2)):  # doors
        cells[row : row + 22, col : col + 22] = 0
    cells[120:180, 75] = 100
    costs = make_cost_map(GridFrame((0.0, 0.0), 0.05, *cells.shape), cells, RouteSettings())
    start = snap_to_passable(costs, (5.0, 5.0), 1.0)
    assert start is not None
    places = np.argwhere(connected_to(costs, start))
    for row, col in rng.choice(places, 12):
        goal = (int(row), int(col))
        best = find_path(costs, start, goal)
        with monkeypatch.context() as large:
            large.setattr(route, "_LARGE_CELLS", 0)
            path = find_path(costs, start, goal)
        assert best is not None
        assert path is not None
        assert (tuple(path[0]), tuple(path[-1])) == (start, goal)
        assert path_cost(costs, path) <= 1.02 * path_cost(costs, best)


@settings(max_examples=60, deadline=None)
@given(
    grids,
    st.integers(0, 10**6),
    st.integers(0, 10**6),
    st.lists(st.tuples(st.floats(-1, 1.4), st.floats(2, 4.4)), max_size=4),
)
def test_doors_on_the_way_are_waypoints_and_change_nothing_else(
    cells: NDArray[np.int8], a: int, b: int, places: list[tuple[float, float]]
) -> None:
    costs = costs_of(cells)
    free = costs.frame.centres_of(np.argwhere(costs.passable))
    if len(free) < 2:
        return
    start, goal = ((*map(float, free[k % len(free)]), 0.0) for k in (a, b))
    plain = plan_route(costs, start, goal, SETTINGS)
    if plain is None or len(plain.waypoints) < 2:
        return
    way = np.array(plain.waypoints)[:, :2]
    middle = (way[:-1] + way[1:]) / 2
    doors = [DoorEdge(f"D{k}", ("R1", "R2"), xy, 0.8) for k, xy in enumerate([*places, tuple(map(float, middle[0]))])]
    found = plan_route(costs, start, goal, SETTINGS, doors)
    assert found is not None
    assert found.length_m == pytest.approx(plain.length_m, abs=1e-6)
    points = np.array(found.waypoints)[:, :2]
    assert points[0] == pytest.approx(way[0])
    assert points[-1] == pytest.approx(way[-1])
    if np.hypot(*(way[1] - way[0])) > 0.25:  # the door in the middle of the first piece has its waypoint
        assert np.hypot(*(points - middle[0]).T).min() < 1e-3
