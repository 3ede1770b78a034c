"""irsd's own eyes at work, on a thread of their own, governed by what the process really uses (``inline``: in a replay).

The map thread offers jobs and takes results; between the two lies a mailbox in which the latest job wins.
"""

from __future__ import annotations

import gc
import logging
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

import numpy as np

from irsd.core.errors import ModelError, RunCancelledError
from irsd.core.runtime import Cell, Counters, Event, Guarded, Mailbox, Ring, Stopper, monotonic_s
from irsd.perception import meter
from irsd.perception.budget import Governor, Readings, Stage
from irsd.perception.job import PerceptionJob, PerceptionResult
from irsd.perception.seer import Seer

T = TypeVar("T")

_log = logging.getLogger(__name__)

NAME, WATCH = "perception", "perception-watch"
_POLL_S = 0.03
_SOON_S = 1.0  # before a keyframe can be paid for, pictures are compared for the best
_LATE_S = 10.0  # a keyframe that waits longer for its next stage is given up; a run that takes longer is ended
_LAG_WINDOW_S = 10.0
_RESULTS = 8
_SHORT_S = 5.0  # of memory at its limit, after which the models are let go for good


class Eyes(Protocol):
    """What the map thread sees of perception."""

    @property
    def dimension(self) -> int:
        """Of the embeddings."""
        ...

    @property
    def waiting(self) -> bool:
        """Whether a job lies in the mailbox that was not begun."""
        ...

    @property
    def answers_wait(self) -> bool:
        """Whether ``results`` has something to give."""
        ...

    @property
    def rooms_every(self) -> int:
        """Sweeps per look at the rooms: more than 1 only where all else has been given up already."""
        ...

    def wants(self, stamp_ns: int) -> bool:
        """Whether a picture of this time would be looked at soon."""
        ...

    def offer(self, job: PerceptionJob) -> None:
        """Hand over a keyframe; replaces one that was not begun."""
        ...

    def results(self) -> list[PerceptionResult]:
        """What has been seen since the last call, in the order of the jobs."""
        ...


# -------------------------------------------------------------------------------------------------------------- live
@dataclass(frozen=True, slots=True)
class _Run:
    """What the watch thread needs to end an over-long run."""

    began_s: float
    began_cpu_s: float
    limit_s: float
    reason: str


class LiveEyes:
    """``run`` is the body of the perception thread, ``watch`` that of the one that ends over-long runs.

    threads: the kernel's numbers of the threads that the models' sessions made. models: what runs on what, for the status.
    """

    def __init__(
        self,
        chain: Seer,
        governor: Governor,
        *,
        threads: Iterable[int],
        models: Callable[[], list[dict[str, Any]]] = list,
    ) -> None:
        self._chain: Seer | None = chain
        self._governor, self._models = governor, models
        self._cancel, self._clear = chain.cancel, chain.clear
        self._dimension = chain.dimension
        self._short_since_s: float | None = None
        self._pool = frozenset(threads)
        self._stopper = Stopper()
        self._beat: Callable[[str], None] = lambda thread: None
        self._threads = self._pool
        self._memory = meter.MemoryMeter()
        self._jobs: Mailbox[PerceptionJob] = Mailbox()
        self._results: Ring[PerceptionResult] = Ring(_RESULTS)
        self._lags: Guarded[deque[tuple[float, float]]] = Guarded(deque(maxlen=1024))
        self._soon = Cell(False)
        self._rooms_every = Cell(1)
        self._active: Cell[_Run | None] = Cell(None)
        self._report: Cell[dict[str, Any]] = Cell({})
        self._counts = Counters()
        self._done_s: deque[tuple[float, float]] = deque(maxlen=64)  # when a keyframe was done, and how long it took
        self._reported_s = 0.0
        self._peak_mb = 0.0

    # ------------------------------------------------------------------------------------------ for the map thread
    @property
    def dimension(self) -> int:
        return self._dimension

    @property
    def waiting(self) -> bool:
        return len(self._jobs) > 0

    @property
    def answers_wait(self) -> bool:
        return len(self._results) > 0

    @property
    def rooms_every(self) -> int:
        return self._rooms_every.get()

    def wants(self, stamp_ns: int) -> bool:
        return self._soon.get()

    def offer(self, job: PerceptionJob) -> None:
        self._jobs.put(job)

    def results(self) -> list[PerceptionResult]:
        return self._results.drain()

    def note_lag(self, lag_s: float) -> None:
        """How long a sweep took from its arrival into the graph: perception makes way when this grows."""
        with self._lags.locked() as lags:
            lags.append((monotonic_s(), lag_s))

    # ----------------------------------------------------------------------------------------------- for any thread
    def report(self) -> dict[str, Any]:
        """For the status."""
        return {
            **self._report.get(),
            "jobs": self._jobs.received,
            "jobs_replaced": self._jobs.dropped,
            "models": self._models(),
        }

    # -------------------------------------------------------------------------------------------------- the threads
    def warm_up(self) -> None:
        """Every model once on a picture of noise: what it costs is known before it matters. Before the threads start."""
        self._threads = self._pool | {meter.own_thread_id()}
        assert self._chain is not None
        for stage, items, work in self._chain.trials():
            self._measured(stage, items, work)
        gc.collect()
        self._memory.trim()

    def run(self, stopper: Stopper, beat: Callable[[str], None], wake: Event) -> None:
        """Looks at the latest picture whenever the budget allows it. wake: told when there is a result."""
        self._stopper, self._beat = stopper, beat
        self._threads = self._pool | {meter.own_thread_id()}
        first = next(iter(self._governor.costs))
        while not stopper.requested:
            beat(NAME)
            self._observe()
            self._let_go_when_short()
            governor = self._governor
            ready = self._chain is not None and governor.rung.see and governor.may_start(first, 1)
            may_see = self._chain is not None and governor.rung.see
            self._soon.set(may_see and (ready or governor.soon(first, _SOON_S)))
            job = self._jobs.get(_POLL_S) if ready else None
            if job is None:
                if not ready:
                    self._stopper.wait(_POLL_S)
                continue
            self._soon.set(False)
            self._look(job)
            wake.set()
        self._soon.set(False)

    def watch(self, stopper: Stopper) -> None:
        """Ends runs that use far more CPU than was predicted, keep a picture until it is of no use, or keep irsd from stopping."""
        while not stopper.wait(0.1):
            run = self._active.get()
            if run is None:
                continue
            used_s = meter.threads_cpu_s(self._threads) - run.began_cpu_s
            late = monotonic_s() - run.began_s > _LATE_S
            if used_s > run.limit_s or late:
                self._cancel()
        self._cancel()

    def _let_go_when_short(self) -> None:
        """Without a run the memory is what the map and the models need: when that is too much, the map goes on and the models go."""
        if self._chain is None or not self._governor.memory_is_short:
            self._short_since_s = None
            return
        self._memory.trim()
        self._observe()
        if self._short_since_s is None:
            self._short_since_s = monotonic_s()
        elif self._governor.memory_is_short and monotonic_s() - self._short_since_s > _SHORT_S:
            _log.error(
                "perception ends: the map and the models need more than budget.rss_mb = %g",
                self._governor.settings.rss_mb,
            )
            self._counts.add("ended_for_memory")
            self._chain = None
            gc.collect()
            self._memory.trim()

    def _look(self, job: PerceptionJob) -> None:
        assert self._chain is not None
        began_s = monotonic_s()
        detections = self._chain.see(job, self._governor.rung, self)
        self._counts.add("keyframes" if detections is not None else "keyframes_given_up")
        if detections is None:
            return
        self._done_s.append((monotonic_s(), monotonic_s() - began_s))
        self._results.put(PerceptionResult(job, detections))

    # ------------------------------------------------------------------------------------------------ the runner
    def run_stage(self, stage: Stage, items: int, work: Callable[[], T]) -> T | None:
        """See ``seer.Runner.run_stage``: waits until the budget allows the run."""
        governor, began_s = self._governor, monotonic_s()
        while True:
            self._beat(NAME)
            self._observe()
            reason = self._refusal(stage, began_s)
            if reason:
                governor.drop(f"{stage.value}: {reason}")
                return None
            if governor.may_start(stage, items):
                return self._measured(stage, items, work)
            self._stopper.wait(_POLL_S)

    def batch(self, stage: Stage, most: int) -> int:
        return self._governor.batch(stage, most)

    def drop(self, what: str, amount: int) -> None:
        self._governor.drop(what, amount)

    def pictured(self, masks: int, crops: int) -> None:
        self._governor.pictured(masks, crops)

    def _refusal(self, stage: Stage, began_s: float) -> str:
        if self._stopper.requested:
            return "stopping"
        if not self._governor.rung.see:
            return self._governor.ladder.why.partition(":")[0] or "ladder"
        if monotonic_s() - began_s > _LATE_S:
            return "waited too long"
        if not self._governor.fits(stage):
            self._memory.trim()
            self._observe()
            if not self._governor.fits(stage):
                return "memory"
        return ""

    def _measured(self, stage: Stage, items: int, work: Callable[[], T]) -> T | None:
        """The run itself, between two looks at the clocks."""
        governor, memory = self._governor, self._memory
        memory.mark()
        before_mb, wall_s, cpu_s = memory.rss_mb(), monotonic_s(), meter.threads_cpu_s(self._threads)
        self._active.set(_Run(wall_s, cpu_s, governor.limit_s(stage, items), stage.value))
        result: T | None = None
        self._clear()  # a run that was told to stop may have ended by itself just before
        if self._stopper.requested:
            self._cancel()
        try:
            result = work()
        except RunCancelledError:
            governor.drop(f"{stage.value}: over-long, ended")
        except ModelError as error:
            self._counts.add(f"{stage.value}_failed")
            governor.drop(f"{stage.value}: failed")
            _log.error("%s failed: %s", stage.value, error)
        finally:
            self._active.set(None)
        used_s = meter.threads_cpu_s(self._threads) - cpu_s
        peak_mb = memory.peak_mb()
        self._peak_mb = max(self._peak_mb, peak_mb)
        governor.ran(stage, items, used_s, monotonic_s() - wall_s, max(peak_mb - before_mb, 0.0))
        return result

    def _observe(self) -> None:
        now_s = monotonic_s()
        rss_mb = self._memory.rss_mb()
        own_s = meter.threads_cpu_s(self._threads)
        self._governor.observe(Readings(now_s, meter.process_cpu_s(), own_s, self._lag_p95_ms(now_s), rss_mb))
        self._rooms_every.set(self._governor.rung.rooms_every)
        if now_s - self._reported_s >= 0.5:
            self._reported_s = now_s
            self._report.set(self._told(now_s, rss_mb))

    def _lag_p95_ms(self, now_s: float) -> float | None:
        with self._lags.locked() as lags:
            while lags and lags[0][0] < now_s - _LAG_WINDOW_S:
                lags.popleft()
            recent = [lag for _, lag in lags]
        return float(np.percentile(recent, 95)) * 1e3 if len(recent) >= 5 else None

    def _told(self, now_s: float, rss_mb: float) -> dict[str, Any]:
        recent = [(at, took) for at, took in self._done_s if at > now_s - 60.0]
        took = [t for _, t in recent]
        return {
            **self._governor.report(),
            **self._counts.snapshot(),
            "keyframes_per_min": len(recent),
            "keyframe_p95_ms": round(float(np.percentile(took, 95)) * 1e3) if took else None,
            "rss_mb": round(rss_mb),
            "rss_peak_mb": round(max(self._peak_mb, rss_mb)),
        }
