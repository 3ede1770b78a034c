"""The governor as a controller: properties that hold for any load, on a simulated process whose clock is a number."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import cycle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from irsd.perception.budget import (
    LADDER,
    WINDOW_S,
    BudgetSettings,
    CostModel,
    CpuAccount,
    Governor,
    Ladder,
    Readings,
    Stage,
)

STEP_S = 0.05
COSTS = {Stage.DETECT: (0.6, 0.0), Stage.SEGMENT: (1.2, 0.07), Stage.EMBED: (0.0, 0.04)}
KEYFRAME = ((Stage.DETECT, 1), (Stage.EMBED, 3), (Stage.EMBED, 3), (Stage.EMBED, 3))


@dataclass
class Process:
    """A process in which perception runs one stage after the other, and all else uses ``others`` cores. Single core for runs."""

    governor: Governor
    others: float = 0.2
    slower: float = 1.0  # wall seconds per CPU second of runs
    lag_ms: float = 50.0
    rss_mb: float = 800.0
    work: Iterator[tuple[Stage, int]] = field(default_factory=lambda: cycle(KEYFRAME))
    now_s: float = 0.0
    cpu_s: float = 0.0
    own_s: float = 0.0
    log: list[tuple[float, float]] = field(default_factory=lambda: [(0.0, 0.0)])
    runs: int = 0

    def run(self, seconds: float, rng: np.random.Generator | None = None) -> None:
        end_s = self.now_s + seconds
        stage, items = next(self.work)
        while self.now_s < end_s:
            g = self.governor
            g.observe(Readings(self.now_s, self.cpu_s, self.own_s, self.lag_ms, self.rss_mb))
            if g.rung.see and g.fits(stage) and g.may_start(stage, items):
                cost_s = COSTS[stage][0] + COSTS[stage][1] * items
                left_s = cost_s
                while left_s > 0:  # while it runs nobody asks the governor
                    used_s = min(STEP_S / self.slower, left_s)
                    left_s -= used_s
                    self._pass(used_s * self.slower, used_s, rng)
                g.ran(stage, items, cost_s, cost_s * self.slower, 0.0)
                self.runs += 1
                stage, items = next(self.work)
            else:
                self._pass(STEP_S, 0.0, rng)

    def _pass(self, wall_s: float, own_s: float, rng: np.random.Generator | None) -> None:
        noise = 1.0 if rng is None else float(rng.uniform(0.5, 1.5))
        self.now_s += wall_s
        self.own_s += own_s
        self.cpu_s += own_s + self.others * noise * wall_s
        self.log.append((self.now_s, self.cpu_s))

    def windows(self, since_s: float) -> np.ndarray:
        """Cores used in every window of 10 s that begins after a time."""
        time_s, cpu_s = np.array(self.log).T
        starts = np.arange(since_s, time_s[-1] - WINDOW_S, 0.1)
        return (np.interp(starts + WINDOW_S, time_s, cpu_s) - np.interp(starts, time_s, cpu_s)) / WINDOW_S


def governor(cores: float = 1.0, **changes: float) -> Governor:
    return Governor(BudgetSettings(cpu_cores=cores, **changes), dict(COSTS))


@pytest.mark.parametrize("cores", [0.5, 1.0])
def test_where_there_is_always_work_the_process_uses_what_it_was_given(cores: float) -> None:
    process = Process(governor(cores))
    process.run(120.0, np.random.default_rng(1))
    used = process.windows(20.0) / cores
    assert used.min() >= 0.9
    assert used.max() <= 1.1


@settings(max_examples=30, deadline=None)
@given(
    cores=st.floats(0.3, 1.1),
    others=st.floats(0.05, 0.25),
    slower=st.floats(1.0, 4.0),
    seed=st.integers(0, 1000),
)
def test_no_window_exceeds_the_promise_by_more_than_a_tenth(
    cores: float, others: float, slower: float, seed: int
) -> None:
    process = Process(governor(cores), others=others, slower=slower)
    process.run(60.0, np.random.default_rng(seed))
    assert process.windows(0.0).max() <= 1.1 * cores


@settings(max_examples=30, deadline=None)
@given(before=st.floats(0.1, 1.5), after=st.floats(0.0, 1.5))
def test_a_busier_map_never_leaves_perception_a_higher_rung(before: float, after: float) -> None:
    low, high = sorted((before, after))
    rungs = []
    for others in (low, high):
        process = Process(governor(1.0), others=others)
        process.run(60.0)
        rungs.append(process.governor.ladder.at)
    assert rungs[0] <= rungs[1]


def test_a_steady_load_settles_on_one_rung() -> None:
    for others in (0.2, 0.6, 0.9, 0.97, 1.2):
        process = Process(governor(1.0), others=others)
        process.run(90.0)
        moves = process.governor.ladder.steps_down + process.governor.ladder.steps_up
        process.run(60.0)
        assert process.governor.ladder.steps_down + process.governor.ladder.steps_up - moves <= 2, others


def test_a_slow_machine_takes_it_down_and_a_free_one_up_again() -> None:
    process = Process(governor(1.0))
    process.run(40.0)
    assert process.governor.rung.name == "full"
    process.slower = 6.0
    process.run(60.0)
    lower = process.governor.ladder.at
    assert lower > 0
    assert process.governor.report()["why"].startswith("cpu")
    process.slower = 1.0
    process.run(120.0)
    assert process.governor.rung.name == "full"
    assert process.governor.report()["why"] == ""


def test_a_late_map_stops_perception_and_then_slows_the_rooms() -> None:
    process = Process(governor(1.0))
    process.run(20.0)
    process.lag_ms = 900.0
    process.run(30.0)
    assert process.governor.rung.name == "slow rooms"
    assert not process.governor.rung.see
    assert process.governor.report()["why"] == "latency: p95 of the map's lag is 900 ms"
    process.lag_ms = 50.0
    process.run(60.0)
    assert process.governor.rung.name == "full"


def test_runs_that_would_exceed_the_memory_are_refused() -> None:
    process = Process(governor(1.0, rss_mb=1000.0))
    process.governor.ran(Stage.DETECT, 1, 0.6, 0.6, 150.0)
    process.rss_mb = 900.0
    process.run(10.0)
    assert process.runs == 0
    assert process.governor.rung.name == "no detection"
    assert "memory" in process.governor.report()["why"]


def test_a_chain_without_segmenter_has_no_rung_that_leaves_it_out() -> None:
    names = [r.name for r in Governor(BudgetSettings(), {Stage.EMBED: (0.0, 0.04)}).ladder.rungs]
    assert names == [r.name for r in LADDER if r.segment or not r.see]


def test_embeddings_are_degraded_before_detection_and_rooms_last() -> None:
    looks = [rung.looks for rung in LADDER]
    sees = [rung.see for rung in LADDER]
    rooms = [rung.rooms_every for rung in LADDER]
    assert looks == sorted(looks, reverse=True)
    assert sees == sorted(sees, reverse=True)
    assert rooms == sorted(rooms)
    assert rooms[sees.index(False)] == 1  # rooms go on when detection has stopped


@settings(max_examples=50, deadline=None)
@given(fixed=st.floats(0.0, 2.0), each=st.floats(0.0, 0.2), start=st.floats(0.01, 3.0))
def test_costs_are_learnt_from_runs_whatever_was_believed(fixed: float, each: float, start: float) -> None:
    model = CostModel(start, 0.0)
    for n in (4, 8, 2, 12, 6, 3, 9, 5) * 6:
        model.add(n, fixed + each * n)
    assert model.predict(10) == pytest.approx(fixed + each * 10, abs=0.02 + 0.02 * fixed)


def test_runs_of_one_size_leave_the_shape_of_the_cost_as_believed() -> None:
    model = CostModel(0.0, 0.04)
    for k in range(50):
        model.add(12, 0.72 + 0.02 * (k % 3 - 1))
    assert model.predict(1) == pytest.approx(0.06, rel=0.1)
    assert model.predict(24) == pytest.approx(1.44, rel=0.1)


def test_an_account_saves_up_for_two_seconds_at_most() -> None:
    account = CpuAccount(0.5)
    for k in range(200):
        account.observe(k * 0.5, 0.0, 0.0)
    assert account.level_s == pytest.approx(1.0)
    assert account.may_start(1.0, 1.0)
    account.observe(100.0, 6.0, 6.0)
    assert not account.may_start(0.1, 0.1)


def test_the_ladder_goes_a_rung_at_a_time_quickly_down_and_slowly_up() -> None:
    ladder = Ladder(LADDER)
    times = np.arange(0.0, 20.0, 0.1)
    for now_s in times:
        ladder.follow(float(now_s), 2, 2, "cpu: test")
    assert ladder.at == 2
    for now_s in times + 20.0:
        ladder.follow(float(now_s), 0, 2, "")  # affordable, but not with a margin
    assert ladder.at == 2
    for now_s in times + 40.0:
        ladder.follow(float(now_s), 0, 0, "")
    assert (ladder.at, ladder.steps_down, ladder.steps_up) == (0, 2, 2)
