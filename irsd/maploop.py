"""The map thread: the only writer of map, rooms, instances and graph. Sensors in, publications out; others ask it by ``call``."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Generic, TypeVar

from irsd.core.errors import EditError, StoreError, TransportError
from irsd.core.faults import Finding
from irsd.core.runtime import Cell, Event, Mailbox, Ring, Stopper, monotonic_ns
from irsd.core.types import Localisation, SyncedFrame
from irsd.graph.edits import Record
from irsd.graph.model import GraphDelta, GraphSnapshot, InstanceArrays
from irsd.health import Heartbeats, StageTimes
from irsd.ingest import Ingest
from irsd.pipeline import MapPipeline
from irsd.resume import Resumption
from irsd.sensors.alignment import AlignmentWatch
from irsd.sensors.sync import Synchronizer

T = TypeVar("T")

_log = logging.getLogger(__name__)

NAME = "map"
_IDLE_S = 0.25
_CALLS = 32
_CALL_TIMEOUT_S = 5.0
_QUIET_NS = 2_000_000_000  # sensors that pause for longer than any stage's period


@dataclass(frozen=True, slots=True)
class Replacement:
    """Another map takes the place of the one before. path: the file that holds it; None: it is empty."""

    path: Path | None


@dataclass(frozen=True, slots=True)
class Publication:
    """One step of the graph on its way to disk and network. arrays: of the instances in the delta, by id.

    record: what the step leaves on disk beside the delta. stored: told "" when it is on disk, else why it is not.
    replaces: the delta is no step, but tells of another map.
    """

    delta: GraphDelta
    snapshot: GraphSnapshot
    arrays: Mapping[str, InstanceArrays]
    record: Record = field(default_factory=Record)
    stored: Mailbox[str] | None = None
    replaces: Replacement | None = None


@dataclass(frozen=True, slots=True)
class MapState:
    """What others may know of the loop. failures: steps that failed in a row up to now; lag_s: sweep received -> in the graph.

    rooms_arrived_ns: when (monotonic) the newest sweep that the rooms have taken in was received.
    """

    frames: int = 0
    failed: int = 0
    failures: int = 0
    last_failure: str = ""
    blocked_by: str | None = None
    lag_s: float | None = None
    stamp_ns: int = 0
    rooms_arrived_ns: int | None = None
    obstacles: tuple[str, ...] = ()
    sensor_findings: tuple[Finding, ...] = ()
    drops: Mapping[str, int] = field(default_factory=dict)
    counts: Mapping[str, int] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class _Answer(Generic[T]):
    value: T | None
    error: Exception | None


class MapLoop:
    """Runs until the stopper asks; ``run`` is the body of the map thread, everything else is for other threads."""

    def __init__(
        self,
        ingest: Ingest,
        sync: Synchronizer,
        pipeline: MapPipeline,
        outbox: Ring[Publication],
        *,
        wake: Event,
        stopper: Stopper,
        beats: Heartbeats,
        times: StageTimes,
        max_failures: int,
        on_lag: Callable[[float], None] | None = None,
        on_place: Callable[[Localisation], None] | None = None,
        resumption: Resumption | None = None,
        note: Callable[..., None] | None = None,
    ) -> None:
        """on_lag: told of every step's lag in seconds. on_place: told where every sweep has put the robot, before all else.

        resumption: keeps frames from a stored map that they may not be of. note: is told, with what to do and how, whatever else
        than messages decides what the graph becomes; see ``irsd.record``.
        """
        self._ingest, self._sync, self._pipeline, self._outbox = ingest, sync, pipeline, outbox
        self._wake, self._stopper, self._beats, self._times = wake, stopper, beats, times
        self._max_failures, self._on_lag, self._on_place = max_failures, on_lag, on_place
        self._resumption = resumption
        self._note = note or _noted
        self._calls: Ring[Callable[[], None]] = Ring(_CALLS, wake)
        self._ended = Event()
        self._stepped_ns = 0
        self._settled = True
        self.state: Cell[MapState] = Cell(MapState())
        self.snapshot: Cell[GraphSnapshot] = Cell(pipeline.snapshot())
        self._alignment = AlignmentWatch()
        self.gave_up = False

    def call(self, question: Callable[[MapPipeline], T], timeout_s: float = _CALL_TIMEOUT_S) -> T:
        """What ``question`` finds in the pipeline, between two steps. Raises TransportError when the thread is too busy."""
        box: Mailbox[_Answer[T]] = Mailbox()

        def work() -> None:
            try:
                box.put(_Answer(question(self._pipeline), None))
            except Exception as error:  # carried over to the thread that asked, and raised there
                box.put(_Answer(None, error))

        if self._ended.is_set():
            raise TransportError("irsd is stopping")
        self._calls.put(work)
        answer = box.get(timeout_s)
        if answer is None:
            raise TransportError(f"the map thread did not answer within {timeout_s:g} s")
        if answer.error is not None:
            raise answer.error
        return answer.value  # type: ignore[return-value]

    def change(
        self,
        work: Callable[[MapPipeline], tuple[T, GraphDelta]],
        what: Mapping[str, Any],
        timeout_s: float = _CALL_TIMEOUT_S,
    ) -> T:
        """What ``work`` does to the graph between two steps, once it is on disk. what: the same for a recording.

        Raises StoreError when it is in effect but not on disk (yet); what ``work`` raises; TransportError as ``call``.
        """
        stored: Mailbox[str] = Mailbox()

        def apply(pipeline: MapPipeline) -> T:
            result, delta = work(pipeline)
            self._note(**what)
            self._hand_out(delta, pipeline.snapshot(), stored)
            return result

        result = self.call(apply, timeout_s)
        return _once_stored(stored, result, timeout_s)

    def replace(
        self,
        pipeline: MapPipeline,
        why: str,
        source: Replacement,
        geometry: Mapping[str, bytes],
        timeout_s: float = _CALL_TIMEOUT_S,
    ) -> int:
        """Another map from now on; its revision, once it is on disk. Errors as ``change``.

        why: goes into the lineage. geometry: of the other map, which the next scans must fit.
        """
        stored: Mailbox[str] = Mailbox()

        def apply(before: MapPipeline) -> int:
            # A gap in the revisions: whoever follows the graph takes the snapshot again.
            pipeline.go_on_from(max(before.snapshot().seq, pipeline.snapshot().seq) + 2)
            self._pipeline = pipeline
            self._note("replace")
            if self._resumption is not None:
                self._resumption.begin(geometry)
            now = pipeline.snapshot()
            delta = GraphDelta(now.seq, now.stamp_ns, now.map_id, now.frame, (), (), (), (), (why,))
            self.snapshot.set(now)
            self._outbox.put(Publication(delta, now, {}, pipeline.take_record(), stored, source))
            return now.seq

        result = self.call(apply, timeout_s)
        return _once_stored(stored, result, timeout_s)

    def accept_map(self) -> None:
        """The stored map goes on, whatever the scans say."""

        def accept(_: MapPipeline) -> None:
            self._note("accept")
            if self._resumption is not None:
                self._resumption.accept()

        self.call(accept)

    @property
    def pictures_allowed(self) -> bool:
        """Whether pictures may be kept where the robot is; of the map thread."""
        return self._pipeline.pictures_allowed

    def relocalise(self, at: tuple[float, float, float] | None) -> None:
        """Where the robot is in the map is looked for from the next sweeps on. at: about where, (x, y, yaw) in the map, or None."""
        resumption = self._resumption

        def seek(pipeline: MapPipeline) -> None:
            if resumption is None or (resumption.trusted and not pipeline.snapshot().rooms):
                raise EditError("there is no map yet in which the robot could be looked for")
            self._note("relocalise", at=at)
            resumption.seek(pipeline, at)

        self.call(seek)

    def run(self) -> None:
        """The map thread."""
        while not self._stopper.requested:
            self._beats.beat(NAME)
            self._answer_calls()
            self._settle_when_quiet()
            if not self._take_in():
                self._wake.wait(_IDLE_S)
                self._wake.clear()
        if not self._settled and not self.gave_up:
            self._finish()
        self._ended.set()
        self._answer_calls()
        self._beats.end(NAME)

    def _take_in(self) -> bool:
        """Decodes what waits and steps through the frames that became complete; False when there was nothing to do."""
        sensed = self._ingest.poll()
        for one in sensed:
            self._sync.push(one)
        if sensed:
            self._note("pop")
        frames = self._sync.pop() if sensed else []
        for frame in frames:
            self._beats.beat(NAME)
            self._answer_calls()
            self._note("step")  # after the calls: what they did is noted before the frame
            for ready in self._admitted(frame):
                self._step(ready)
                if self.gave_up:
                    return False
        self.state.set(
            replace(
                self.state.get(),
                blocked_by=self._sync.blocked_by(),
                obstacles=tuple(self._sync.obstacles()),
                sensor_findings=self._alignment.findings,
                drops={**self._ingest.counters(), **_losses(self._sync.counters())},
                counts=self._pipeline.counters(),
            )
        )
        return bool(sensed) or self._ingest.more_waits

    def _admitted(self, frame: SyncedFrame) -> list[SyncedFrame]:
        """The frames that may go into the map, which may be a stored one."""
        if self._resumption is None:
            return [frame]
        ready = self._resumption.admit(frame, self._pipeline)
        start = self._resumption.take_start()
        if start is not None:
            self._pipeline.begin_at(start)
        return ready

    def _answer_calls(self) -> None:
        for work in self._calls.drain():
            work()

    def _settle_when_quiet(self) -> None:
        """Once the sensors pause, the slower stages look at what is left: the robot is parked, or the recording over.

        Perception may answer later still.
        """
        self._settled = self._settled and not self._pipeline.answers_wait
        if not self._settled and monotonic_ns() - self._stepped_ns > _QUIET_NS:
            self._settled = True
            self._finish()

    def _step(self, frame: SyncedFrame) -> None:
        self._stepped_ns, self._settled = monotonic_ns(), False
        self._alignment.look(frame)
        state = self.state.get()
        failed, failures, last_failure, lag_s = state.failed, 0, "", state.lag_s
        rooms_arrived_ns = state.rooms_arrived_ns
        try:
            result = self._pipeline.step(frame)
        except Exception as error:  # a stage's failure costs its frame, not the map: the last good state is kept
            failed, failures = failed + 1, state.failures + 1
            last_failure = f"frame {frame.seq}: {type(error).__name__}: {error}"
            _log.error("step of frame %d failed (%d in a row)", frame.seq, failures, exc_info=True)
        else:
            if self._on_place is not None and result.where is not None:
                self._on_place(result.where)
            arrived_ns = self._ingest.arrived_ns(frame.stamp_ns)
            if arrived_ns is not None:
                lag_s = (monotonic_ns() - arrived_ns) / 1e9
                self._times.add({"lag": lag_s * 1000})
                if self._on_lag is not None:
                    self._on_lag(lag_s)
                rooms_arrived_ns = arrived_ns if result.rooms_followed else rooms_arrived_ns
            self._times.add(result.stage_ms)
            self._hand_out(result.delta, result.snapshot)
        self.state.set(
            replace(
                state,
                frames=state.frames + 1,
                failed=failed,
                failures=failures,
                last_failure=last_failure,
                lag_s=lag_s,
                stamp_ns=frame.stamp_ns,
                rooms_arrived_ns=rooms_arrived_ns,
            )
        )
        if failures >= self._max_failures:
            self.gave_up = True
            self._stopper.request(f"{failures} steps failed in a row; the last: {last_failure}")

    def _hand_out(self, delta: GraphDelta | None, snapshot: GraphSnapshot, stored: Mailbox[str] | None = None) -> None:
        self.snapshot.set(snapshot)
        if delta is None:
            return
        found = {node.id: self._pipeline.find_arrays(node.id) for node in delta.instances}
        changed = {node_id: arrays for node_id, arrays in found.items() if arrays is not None}
        self._outbox.put(Publication(delta, snapshot, changed, self._pipeline.take_record(), stored))

    def _finish(self) -> None:
        """What the slower stages have not looked at yet: at a pause and at a clean stop."""
        self._note("finish")
        try:
            result = self._pipeline.finish(self.state.get().stamp_ns)
            self._hand_out(result.delta, result.snapshot)
        except Exception:  # all steps before are safe, and the next frame or the stop goes on
            _log.error("settling the map failed", exc_info=True)


def _noted(do: str, **more: Any) -> None:
    """Nobody records."""


def _once_stored(stored: Mailbox[str], result: T, timeout_s: float) -> T:
    problem = stored.get(timeout_s)
    if problem is None:
        problem = f"writing takes longer than {timeout_s:g} s"
    if problem:
        raise StoreError(f"done, but not on disk yet ({problem}): irsd goes on trying; irsctl status tells")
    return result


def _losses(counters: Mapping[str, int]) -> dict[str, int]:
    """The synchroniser's counters without what it let through."""
    return {
        f"sync.{name}": count for name, count in counters.items() if name not in ("frames", "views", "image_unused")
    }
