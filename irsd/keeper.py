"""The store as the publish thread keeps it: steps in order, retried until they are on disk; jobs of other threads between them."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from irsd.core.errors import IrsdError, StoreError, TransportError
from irsd.core.geometry import Pose
from irsd.core.runtime import Cell, Counters, Mailbox, Ring, monotonic_s
from irsd.core.types import Plan
from irsd.graph.edits import known_prototypes
from irsd.graph.store import Store, StoredMap
from irsd.maploop import MapLoop, Publication
from irsd.pipeline import MapPipeline
from irsd.plans import CORRECTION, PLAN, plan_of, plan_to_bytes, pose_to_bytes
from irsd.resume import Resumption

T = TypeVar("T")

_log = logging.getLogger(__name__)

_UNSTORED = 1024  # steps that wait for a disk that is full; beyond that the map is written whole when it is back
_JOBS = 8
_FIRST_S, _PERIOD_S = 5.0, 10.0  # of the geometry
_SHARE = 50.0  # times what the last writing took


class Keeper:
    """Owner of the store. ``keep`` and ``catch_up`` belong to one thread, ``ask`` to all others."""

    def __init__(self, store: Store | None, counts: Counters, whole: Callable[[], StoredMap]) -> None:
        """store: None keeps nothing. whole: the map as it is now, fetched in a way that is safe from the keeper's thread."""
        self._store, self._counts, self._whole = store, counts, whole
        self._unstored: deque[Publication] = deque()
        self._gap = False
        self._jobs: Ring[Callable[[Store], None]] = Ring(_JOBS)
        self._error = Cell("")

    @property
    def error(self) -> str:
        """Why the last step is not on disk; empty when it is."""
        return self._error.get()

    @property
    def waiting(self) -> int:
        """Steps that are not on disk yet."""
        return len(self._unstored)

    def keep(self, publication: Publication) -> None:
        """A step onto disk, after those before it: what could not be written (disk full) is tried again with the next one."""
        if self._store is None:
            _answer(publication, "")
            return
        self._unstored.append(publication)
        if len(self._unstored) > _UNSTORED:
            self._gap = True
            _answer(self._unstored.popleft(), self.error)
        self._write(self._store)
        if self._unstored:
            _answer(publication, self.error)

    def catch_up(self) -> None:
        """When there is time: what is left to write, then what others asked for."""
        if self._store is None:
            return
        if self._unstored:
            self._write(self._store)
        for job in self._jobs.drain():
            job(self._store)

    def ask(self, work: Callable[[Store], T], timeout_s: float) -> T:
        """What ``work`` finds or does in the store, between two steps. StoreError without a store, or when it takes too long."""
        if self._store is None:
            raise StoreError("irsd keeps nothing on disk (store.enabled: false, or --no-store)")
        box: Mailbox[tuple[Any, Exception | None]] = Mailbox()

        def job(store: Store) -> None:
            try:
                box.put((work(store), None))
            except (IrsdError, OSError) as error:  # carried over to the thread that asked, and raised there
                box.put((None, error))

        self._jobs.put(job)
        answer = box.get(timeout_s)
        if answer is None:
            raise StoreError(f"the store did not answer within {timeout_s:g} s")
        if answer[1] is not None:
            raise answer[1]
        return answer[0]  # type: ignore[no-any-return]

    def keep_geometry(self, values: Mapping[str, bytes]) -> None:
        """See ``Store.keep_geometry``; of the keeper's thread. What can't be written now is written the next time."""
        if self._store is None or self._unstored:
            return
        try:
            self._store.keep_geometry(values)
        except StoreError as error:
            self._error.set(str(error))

    def _write(self, store: Store) -> None:
        try:
            if self._gap:
                self._write_whole(store)
            while self._unstored:
                first = self._unstored[0]
                if first.replaces is not None and (first.replaces.path is None or first.replaces.path.is_file()):
                    self._replace(store, first)
                elif (
                    first.replaces is not None
                ):  # its file did not outlive the wait for the disk: the map is in memory, too
                    self._write_whole(store)
                    continue
                else:
                    store.append(first.delta, first.arrays, first.record, building_name=first.snapshot.building.name)
                _answer(self._unstored.popleft(), "")
            self._error.set("")
        except StoreError as error:
            self._counts.add("store_errors")
            if self._error.get() != str(error):
                _log.error("revision %d is not on disk: %s", self._unstored[0].delta.seq, error)
            self._error.set(str(error))

    def _write_whole(self, store: Store) -> None:
        """Too much waited: the map as it is now, and what came after it."""
        now = self._whole()
        store.rewrite(now)
        while self._unstored and self._unstored[0].delta.seq <= now.snapshot.seq:
            _answer(self._unstored.popleft(), "")
        self._gap = False

    def _replace(self, store: Store, publication: Publication) -> None:
        path = publication.replaces.path if publication.replaces is not None else None
        if path is not None:
            store.replace_by(path, publication.delta)
            return
        stored = store.load()
        kept = known_prototypes(stored.edits, stored.taught) if stored is not None else store.prototypes()
        store.clear(frozenset(kept))


def _answer(publication: Publication, problem: str) -> None:
    if publication.stored is not None:
        publication.stored.put(problem)


class GeometryKeeper:
    """Now and then puts the plan of the robot's floor on disk, which the first scans after a restart are compared with."""

    def __init__(self, loop: MapLoop, keeper: Keeper, resumption: Resumption) -> None:
        self._loop, self._keeper, self._resumption = loop, keeper, resumption
        self._due_s = monotonic_s() + _FIRST_S
        self._stamp_ns = 0

    def tend(self, now_s: float) -> None:
        """Called often by the keeper's thread; does something every ten seconds, or less often where it costs much."""
        state = self._loop.state.get()
        if now_s < self._due_s or not self._resumption.trusted or state.stamp_ns == self._stamp_ns:
            return
        self._stamp_ns = state.stamp_ns
        try:
            floor, plan, map_T_odom = self._loop.call(_plan_of)
        except TransportError:  # too busy, or stopping
            return
        self._keeper.keep_geometry({f"{PLAN}{floor}": plan_to_bytes(plan), CORRECTION: pose_to_bytes(map_T_odom)})
        ended_s = monotonic_s()
        self._due_s = ended_s + max(_PERIOD_S, _SHARE * (ended_s - now_s))


def _plan_of(pipeline: MapPipeline) -> tuple[int, Plan, Pose]:
    evidence = pipeline.plan_evidence()
    return evidence.floor, plan_of(evidence), pipeline.map_T_odom
