"""irsd's own eyes in a replay: the same chain and governor, with the sensors' time and counted cost in place of clocks."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from irsd.perception.budget import BudgetSettings, Governor, Readings, Stage
from irsd.perception.job import PerceptionJob, PerceptionResult
from irsd.perception.seer import Seer

T = TypeVar("T")

_MAP_CORES = 0.2  # what mapping, rooms and fusion use at 5 sweeps/s, as measured: a replay counts with it


class InlineEyes:
    """The chain on the caller's thread, at once: same input, same bytes. See ``worker.Eyes``."""

    def __init__(self, chain: Seer, budget: BudgetSettings, costs: dict[Stage, tuple[float, float]]) -> None:
        self._chain = chain
        self._governor = Governor(budget, costs, learn=False)
        self._first = next(iter(costs))
        self._spent_s = 0.0
        self._began_ns: int | None = None
        self._seen: list[PerceptionResult] = []
        self.keyframes = 0

    @property
    def dimension(self) -> int:
        return self._chain.dimension

    waiting = False

    @property
    def answers_wait(self) -> bool:
        return bool(self._seen)

    @property
    def rooms_every(self) -> int:
        return self._governor.rung.rooms_every

    def wants(self, stamp_ns: int) -> bool:
        if self._began_ns is None:
            self._began_ns = stamp_ns
        now_s = (stamp_ns - self._began_ns) * 1e-9
        cpu_s = _MAP_CORES * now_s + self._spent_s
        self._governor.observe(Readings(now_s, cpu_s, self._spent_s, None, 0.0))
        return self._governor.rung.see and self._governor.may_start(self._first, 1)

    def offer(self, job: PerceptionJob) -> None:
        detections = self._chain.see(job, self._governor.rung, self)
        if detections is not None:
            self.keyframes += 1
            self._seen.append(PerceptionResult(job, detections))

    def results(self) -> list[PerceptionResult]:
        out, self._seen = self._seen, []
        return out

    def report(self) -> dict[str, Any]:
        """For metrics.json."""
        return {**self._governor.report(), "keyframes": self.keyframes}

    # ------------------------------------------------------------------------------------------------ the runner
    def run_stage(self, stage: Stage, items: int, work: Callable[[], T]) -> T | None:
        cost_s = self._governor.predict(stage, items)
        self._spent_s += cost_s
        self._governor.ran(stage, items, cost_s, cost_s, 0.0)
        return work()

    def batch(self, stage: Stage, most: int) -> int:
        return self._governor.batch(stage, most)

    def drop(self, what: str, amount: int) -> None:
        self._governor.drop(what, amount)

    def pictured(self, masks: int, crops: int) -> None:
        self._governor.pictured(masks, crops)
