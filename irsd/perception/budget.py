"""The governor: what perception may run, when, and how much of it. A pure controller: it reads no clock and runs no model.

It is told the time, the CPU seconds of the whole process and of perception, the map's lag and the memory, and what each run cost; it
answers which rung of the ladder holds and whether a run may start now. Ingest and odometry are not on the ladder at all: what they
use is taken from perception's share first. Degraded first is embedding refinement, then detection, and rooms last.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from irsd.core.settings import setting

WINDOW_S = 10.0  # the time over which the promise on CPU holds
_CEILING = 1.05  # share of the promise that a run may be predicted to use up
_DEPTH_S = 2.0  # seconds of budget that can be saved up
_TOLERANCE = 0.1  # of the promise
_MEMORY = 0.97  # share of the memory that a run may be predicted to reach
_LEAST_S = 0.5 * WINDOW_S  # of the log: a start's bursts are not the habit of the process
_OVERRUN, _OVERRUN_S = 3.0, 0.3  # a run is over-long beyond this times its prediction, and this on top
_BATCH_S = 0.5  # CPU seconds of a run of many items: what has to be given up is little then
_SPARE = 0.85  # of the limits that the next rung up may use, so that the ladder does not swing
_FORGET_S = 30.0  # in which a slow machine is believed to be fast again unless it proves to be slow
_RIDGE = 0.005  # squared spread of n, relative to n, at which runs and belief count the same
_FORGET = 0.9  # weight that an older run keeps when one more is counted


class Stage(StrEnum):
    """The parts of the chain that cost."""

    TAG = "tag"
    DETECT = "detect"
    SEGMENT = "segment"
    EMBED = "embed"


@dataclass(frozen=True)
class BudgetSettings:
    """What irsd as a whole may use while it sees with its own eyes: perception makes way for all else."""

    cpu_cores: float = setting(1.0, "CPU seconds per second of the process, in the mean over 10 s", lo=0.1, hi=256.0)
    latency_p95_ms: float = setting(
        500.0, "from a sweep's arrival until it is in the graph; perception steps down when p95 is longer", lo=50.0
    )
    rss_mb: float = setting(1500.0, "resident memory; runs that would exceed it are not started", lo=300.0)
    keyframe_period_s: float = setting(
        5.0, "perception steps down when one keyframe would take longer than this to pay for", lo=0.1, hi=600.0
    )


# ------------------------------------------------------------------------------------------------------------ costs
class CostModel:
    """CPU seconds of a run on n items, fixed + each * n: least squares over past runs, of which old ones fade.

    As long as all runs had about the same n, what belongs to the run and what to the item is as in the belief (ridge regression).
    """

    def __init__(self, fixed_s: float, each_s: float) -> None:
        """What is believed before the first run."""
        self._belief = (max(fixed_s, 1e-6), max(each_s, 0.0))
        self._sums = np.zeros(5)  # of weight, n, n^2, cost, n * cost
        self.runs = 0
        self.growth_mb = 0.0

    def add(self, items: int, cpu_s: float) -> None:
        """One run."""
        self.runs += 1
        n = float(items)
        self._sums = _FORGET * self._sums + np.array([1.0, n, n * n, cpu_s, n * cpu_s])

    def predict(self, items: int) -> float:
        """CPU seconds of the next run."""
        fixed, each = self._belief
        weight, n, nn, cost, n_cost = self._sums.tolist()
        if weight > 0.0:
            n, nn, cost, n_cost = n / weight, nn / weight, cost / weight, n_cost / weight
            scale = cost / (fixed + each * n)
            ridge = _RIDGE * n * n
            each = (n_cost - n * cost + ridge * scale * each) / max(nn - n * n + ridge, 1e-12)
            each = min(max(each, 0.0), cost / max(n, 1e-9))
            fixed = cost - each * n
        return float(fixed + each * items)


# ---------------------------------------------------------------------------------------------------------- account
class CpuAccount:
    """A token bucket that earns ``cores`` CPU seconds per second, which the whole process spends; and a log of the last window.

    A run starts when half of its cost has been saved up and the window that ends with it stays within the promise: the bucket spreads
    the runs, the window keeps the promise even after a rest.
    """

    def __init__(self, cores: float) -> None:
        self.cores = cores
        self.level_s = 0.0
        self.others = 0.0  # CPU seconds per second of everything but perception
        self._log: deque[tuple[float, float, float]] = deque()  # time, CPU of the process, CPU of perception

    def observe(self, now_s: float, cpu_s: float, own_s: float) -> None:
        """now_s: any clock that never goes back. cpu_s, own_s: CPU seconds of the process and of perception since some start."""
        if not self._log:
            self._log.append((now_s, cpu_s, own_s))
            self._last = (now_s, cpu_s)
            return
        earned = self.cores * (now_s - self._last[0])
        self.level_s = min(self.level_s + earned - (cpu_s - self._last[1]), _DEPTH_S * self.cores)
        self._last = (now_s, cpu_s)
        if now_s - self._log[-1][0] >= 0.1:
            self._log.append((now_s, cpu_s, own_s))
        while len(self._log) > 2 and self._log[1][0] <= now_s - WINDOW_S:
            self._log.popleft()
        past_s = now_s - self._log[0][0]
        if past_s >= _LEAST_S:
            rest = (cpu_s - self._log[0][1]) - (own_s - self._log[0][2])
            self.others = max(rest / past_s, 0.0)

    def used_s(self, since_s: float) -> float:
        """CPU seconds of the process from a time on until now."""
        times, cpu = [t for t, _, _ in self._log], [c for _, c, _ in self._log]
        return float(self._last[1] - np.interp(since_s, times, cpu))

    def may_start(self, cost_s: float, wall_s: float) -> bool:
        """Whether a run of so many CPU seconds, which takes wall_s, may start at the time last observed."""
        if not self._log:
            return False
        if self.level_s < 0.5 * min(cost_s, _DEPTH_S * self.cores):
            return False
        # A run longer than the window can't be helped by waiting for more than an empty window.
        wall_s = min(wall_s, 0.9 * WINDOW_S)
        before = self.used_s(self._last[0] + wall_s - WINDOW_S)
        promise = _CEILING * self.cores * WINDOW_S
        return before + min(cost_s, promise / 2) + self.others * wall_s <= promise


# ------------------------------------------------------------------------------------------------------------ ladder
@dataclass(frozen=True, slots=True)
class Rung:
    """What is done at one step of the ladder.

    looks: embeddings that a known object gets before it is left alone (0: perception rests); masks: objects per picture; side_px: the
    picture's longer side; rooms_every: sweeps per look at the rooms.
    """

    name: str
    looks: int
    masks: int
    side_px: int
    segment: bool = True
    see: bool = True
    rooms_every: int = 1


FULL = Rung("full", 12, 32, 1280)
LADDER = (
    FULL,
    Rung("no refinement", 3, 32, 1280),
    Rung("few masks", 2, 12, 960),
    Rung("boxes", 2, 12, 640, segment=False),
    Rung("few boxes", 1, 6, 640, segment=False),
    Rung("no detection", 0, 0, 640, see=False),
    Rung("slow rooms", 0, 0, 640, see=False, rooms_every=4),
)


class Ladder:
    """Where on the ladder we are: down after a short while, up after a long one, a rung at a time."""

    DOWN_S, UP_S = 1.0, 5.0

    def __init__(self, rungs: tuple[Rung, ...]) -> None:
        self.rungs = rungs
        self.at = 0
        self.steps_down = self.steps_up = 0
        self.why = ""
        self._since_s: float | None = None  # when the wish to go the way ``_way`` began
        self._way = 0

    @property
    def rung(self) -> Rung:
        return self.rungs[self.at]

    def follow(self, now_s: float, needed: int, possible: int, why: str) -> None:
        """needed: highest rung (index) that can be afforded; possible: the same with a margin; why: what forbids the rung above."""
        way = 1 if needed > self.at else -1 if possible < self.at else 0
        if way != self._way or way == 0:
            self._way, self._since_s = way, now_s
        if way == 1:
            self.why = why
        if way == 0 or self._since_s is None:
            return
        if now_s - self._since_s >= (self.DOWN_S if way > 0 else self.UP_S):
            self.at += way
            self._since_s = now_s
            self.steps_down += way > 0
            self.steps_up += way < 0
            if self.at == 0:
                self.why = ""


# ---------------------------------------------------------------------------------------------------------- governor
@dataclass(frozen=True, slots=True)
class Readings:
    """What the adapter measured. lag_p95_ms: of the map lately, None when nothing came."""

    now_s: float
    cpu_s: float
    own_cpu_s: float
    lag_p95_ms: float | None
    rss_mb: float


class Governor:
    """The controller. One caller. costs: for each stage that the chain has, (fixed, each) CPU seconds believed at the start."""

    def __init__(
        self, settings: BudgetSettings, costs: dict[Stage, tuple[float, float]], *, learn: bool = True
    ) -> None:
        """learn: whether measured runs change the beliefs; a replay counts by fixed costs instead."""
        self.settings = settings
        self.account = CpuAccount(settings.cpu_cores)
        self.costs = {stage: CostModel(*cost) for stage, cost in costs.items()}
        # Boxes without masks are a rung only where something makes boxes.
        self.ladder = Ladder(tuple(r for r in LADDER if r.segment or not r.see or Stage.DETECT in costs))
        self.stretch = 1.0  # wall seconds per CPU second of runs
        self.dropped: dict[str, int] = {}
        self._learn = learn
        self._items = {Stage.SEGMENT: 8.0, Stage.EMBED: 12.0}  # per keyframe, lately
        self._rss_mb = 0.0
        self._seen_s: float | None = None

    @property
    def rung(self) -> Rung:
        """What may be done now."""
        return self.ladder.rung

    def observe(self, readings: Readings) -> None:
        """Bring account and ladder up to date; call it often."""
        # What made runs slow is forgotten in time, or a rung that runs nothing would never be left again.
        idle_s = max(readings.now_s - self._seen_s, 0.0) if self._seen_s is not None else 0.0
        self.stretch += min(idle_s / _FORGET_S, 1.0) * (1.0 - self.stretch)
        self._seen_s, self._rss_mb = readings.now_s, readings.rss_mb
        self.account.observe(readings.now_s, readings.cpu_s, readings.own_cpu_s)
        needed, why = self._affordable(1.0)
        possible, _ = self._affordable(_SPARE)
        late_ms = readings.lag_p95_ms or 0.0
        if late_ms > self.settings.latency_p95_ms:
            needed = max(needed, min(self.ladder.at + 1, len(self.ladder.rungs) - 1))
            why = f"latency: p95 of the map's lag is {late_ms:.0f} ms"
        if late_ms > 0.6 * self.settings.latency_p95_ms:
            possible = max(possible, self.ladder.at)
        self.ladder.follow(readings.now_s, needed, possible, why)

    def may_start(self, stage: Stage, items: int) -> bool:
        """Whether the run may start now; if not, ask again after the next ``observe``."""
        cost_s = self.predict(stage, items)
        return self.account.may_start(cost_s, cost_s * self.stretch)

    def soon(self, stage: Stage, within_s: float) -> bool:
        """Whether the run could be paid for within so many seconds."""
        saved_s = self.account.level_s + within_s * (self.account.cores - self.account.others)
        return saved_s >= 0.5 * self.predict(stage, 1)

    def fits(self, stage: Stage) -> bool:
        """Whether the run stays within the memory."""
        return self._rss_mb + self.costs[stage].growth_mb <= _MEMORY * self.settings.rss_mb

    @property
    def memory_is_short(self) -> bool:
        """Whether the process is at its limit with no run at all."""
        return self._rss_mb > _MEMORY * self.settings.rss_mb

    def predict(self, stage: Stage, items: int) -> float:
        """CPU seconds of a run."""
        return self.costs[stage].predict(items)

    def limit_s(self, stage: Stage, items: int) -> float:
        """CPU seconds after which a run is over-long and to be cancelled."""
        return _OVERRUN * self.predict(stage, items) + _OVERRUN_S

    def batch(self, stage: Stage, most: int) -> int:
        """Items for one run such that it stays a small burst; at least one."""
        burst_s = min(0.5 * self.burst_s, _BATCH_S)
        n = most
        while n > 1 and self.predict(stage, n) > burst_s:
            n = -(-n // 2)
        return n

    @property
    def burst_s(self) -> float:
        """The longest run that leaves every window of 10 s within a tenth of the promise (two cores: ours, and all else beside)."""
        overlap = max(1.0 + self.account.others - self.settings.cpu_cores, 0.05)
        return _TOLERANCE * self.settings.cpu_cores * WINDOW_S / overlap

    def ran(self, stage: Stage, items: int, cpu_s: float, wall_s: float, growth_mb: float) -> None:
        """What a run cost. growth_mb: by how much the memory rose at its peak."""
        model = self.costs[stage]
        model.growth_mb = max(0.8 * model.growth_mb, growth_mb)
        if not self._learn:
            model.runs += 1
            return
        model.add(items, cpu_s)
        if cpu_s > 0.01:
            self.stretch += 0.2 * (min(wall_s / cpu_s, 20.0) - self.stretch)

    def pictured(self, masks: int, crops: int) -> None:
        """One keyframe is done: how many objects it had, and how many crops of them could have been embedded."""
        self._items[Stage.SEGMENT] += 0.2 * (masks - self._items[Stage.SEGMENT])
        self._items[Stage.EMBED] += 0.2 * (crops - self._items[Stage.EMBED])

    def drop(self, what: str, amount: int = 1) -> None:
        """Note what was not done, as ``what: why``."""
        if amount:
            self.dropped[what] = self.dropped.get(what, 0) + amount

    def keyframe_s(self, rung: Rung) -> tuple[float, float]:
        """CPU seconds of a keyframe at a rung: (all its runs, the longest one)."""
        if not rung.see:
            return 0.0, 0.0
        runs = [self.predict(stage, 1) for stage in (Stage.TAG, Stage.DETECT) if stage in self.costs]
        masks = round(min(self._items[Stage.SEGMENT], rung.masks))
        if Stage.SEGMENT in self.costs and rung.segment:
            runs.append(self.predict(Stage.SEGMENT, masks))
        longest = max(runs, default=0.0)
        share = min(1.0, rung.looks / FULL.looks + 0.25)  # of the crops that are worth it at this rung
        crops = min(self._items[Stage.EMBED] * share, 3.0 * rung.masks)
        runs.append(crops * self.predict(Stage.EMBED, 8) / 8)
        return sum(runs), longest

    @property
    def share(self) -> float:
        """CPU seconds per second that perception can have: what the setting and what the machine leaves."""
        return max(min(self.settings.cpu_cores - self.account.others, 1.0 / max(self.stretch, 0.1)), 0.0)

    def _affordable(self, margin: float) -> tuple[int, str]:
        """(index of the highest rung within ``margin`` of the limits, what forbids the one above it)."""
        why = ""
        last = len(self.ladder.rungs) - 1
        for index, rung in enumerate(self.ladder.rungs):
            obstacle = self._obstacle(rung, margin)
            if obstacle is None or index == last:
                return index, why
            why = obstacle
        return last, why

    def _obstacle(self, rung: Rung, margin: float) -> str | None:
        s = self.settings
        if not rung.see:
            cpu = self.account.others
            return None if rung.rooms_every > 1 or cpu <= margin * s.cpu_cores else f"cpu: the map alone uses {cpu:.2f}"
        cost_s, longest_s = self.keyframe_s(rung)
        period_s = cost_s / max(self.share, 1e-3)
        if period_s > margin * s.keyframe_period_s and not self._last_to_see(rung, period_s):
            return f"cpu: {rung.name} needs {cost_s:.2f} CPU s a keyframe, {period_s:.1f} s at {self.share:.2f} cores"
        if longest_s > margin * self.burst_s and not self._least_bursty(rung):
            return f"cpu: {rung.name} has a run of {longest_s:.2f} CPU s, a burst may take {self.burst_s:.2f}"
        lacking = [stage for stage in self._stages_of(rung) if not self.fits(stage)]
        if lacking:
            return f"memory: {lacking[0]} would go beyond {s.rss_mb:.0f} MB"
        return None

    def _stages_of(self, rung: Rung) -> list[Stage]:
        return [stage for stage in self.costs if rung.segment or stage is not Stage.SEGMENT]

    def _last_to_see(self, rung: Rung, period_s: float) -> bool:
        """The lowest rung that still sees goes on, ever more slowly, as long as there is a share at all."""
        seeing = [r for r in self.ladder.rungs if r.see]
        return rung is seeing[-1] and period_s <= 12 * self.settings.keyframe_period_s

    def _least_bursty(self, rung: Rung) -> bool:
        """No rung has shorter runs: the detector alone is a burst too long, which then costs evenness, not the promise."""
        least = min(self.keyframe_s(r)[1] for r in self.ladder.rungs if r.see)
        return self.keyframe_s(rung)[1] <= least + 1e-9

    def report(self) -> dict[str, Any]:
        """For the status: the rung, the whole ladder, why, what was dropped, and what runs cost."""
        return {
            "rung": self.rung.name,
            "why": self.ladder.why,
            "ladder": [rung.name for rung in self.ladder.rungs],
            "steps_down": self.ladder.steps_down,
            "steps_up": self.ladder.steps_up,
            "dropped": dict(sorted(self.dropped.items())),
            "others_cores": round(self.account.others, 3),
            "share_cores": round(self.share, 3),
            "stretch": round(self.stretch, 2),
            "costs": {
                stage.value: {
                    "runs": m.runs,
                    "cpu_s_of_1": round(m.predict(1), 4),
                    "cpu_s_of_8": round(m.predict(8), 4),
                }
                for stage, m in self.costs.items()
            },
        }
