"""The composition root of irsd: configuration, store, pipeline, zenoh and the threads, put together and taken down.

Threads: zenoh's own (append to rings), ``map`` (see maploop), ``perception`` and its watch where irsd has eyes of its own,
``publish`` (disk, then network), ``main`` (signals, status, watchdog).
Exit codes: 0 asked to stop, 2 bad configuration or arguments, 1 anything else.
"""

from __future__ import annotations

import json
import logging
import signal
import uuid
from collections.abc import Callable, Mapping, Sequence
from importlib import metadata
from typing import Any

from irsd import record
from irsd.arguments import configured, read_arguments
from irsd.bundles import Bundles
from irsd.commands import BundleCommand, EditCommands, MapCommands
from irsd.config import IrsdConfig, with_pictures
from irsd.core.errors import ConfigError, IrsdError, TransportError
from irsd.core.faults import Finding
from irsd.core.logs import set_up_logging
from irsd.core.runtime import Counters, Event, Ring, Stopper, Worker, monotonic_ns, monotonic_s, wall_clock_ns
from irsd.core.systemd import notify, watchdog_period_s
from irsd.core.types import Localisation, Prototype
from irsd.faults import FaultLedger, blocked, own_state, short_disk, silent_sensors
from irsd.graph.store import Store, StoredMap
from irsd.health import (
    Heartbeats,
    ProcessMeter,
    StageTimes,
    WallClock,
    disk_state,
    status_document,
    status_line,
)
from irsd.ingest import Ingest, Topic
from irsd.io.keys import RobotKeys
from irsd.io.localisation import LocalisationPublisher, TfPublisher
from irsd.io.publishers import GraphPublisher
from irsd.io.session import Session, open_session, with_environment
from irsd.keeper import GeometryKeeper, Keeper
from irsd.maploop import MapLoop, MapState, Publication
from irsd.maps import Make, Maps
from irsd.opening import lasting_objects, open_live_eyes, open_names, without_lost_network
from irsd.perception import worker as perception
from irsd.perception.encoder import LabelEncoder
from irsd.perception.worker import LiveEyes
from irsd.pipeline import MapPipeline
from irsd.privacy import PICTURES
from irsd.sensors.sync import Synchronizer
from irsd.sensors.watch import SensorWatch
from irsd.stored import open_store, recorder_of, resumption_of, stored_map

_log = logging.getLogger(__name__)

EXIT_STOPPED, EXIT_FAILED, EXIT_CONFIG = 0, 1, 2

_PUBLISH = "publish"
_OUTBOX = 256
_JOIN_S = 20.0


class Daemon:
    """A running irsd between ``start`` and ``stop``; ``main_loop`` is the main thread's body."""

    def __init__(
        self,
        config: IrsdConfig,
        session: Session,
        pipeline: MapPipeline,
        store: Store | None,
        eyes: LiveEyes | None = None,
        missing: Sequence[str] = (),
        *,
        stored: StoredMap | None = None,
        make: Make | None = None,
    ) -> None:
        """eyes: those of the pipeline, whose threads are run here. missing: models that could not be opened, and why.

        stored: the map that the pipeline has taken up. make: makes pipelines for other maps; without it, there are none.
        """
        self._missing = missing
        self._config, self._session, self._store, self._eyes = config, session, store, eyes
        self.stopper = Stopper()
        self._beats = Heartbeats(config.health.thread_limit_s)
        self._times = StageTimes()
        self._counts = Counters()
        self._meter = ProcessMeter()
        self._map_done = Event()
        self._outbox: Ring[Publication] = Ring(_OUTBOX)
        wake = Event()
        self._watch = SensorWatch(config.watch)
        self._ledger, self._wall_clock = FaultLedger(), WallClock(shown_s=config.watch.shown_s)
        self._recorder = recorder_of(config, store)
        taken = None if self._recorder is None else self._record
        self._ingest = Ingest(session, config.ingest, wake, self._watch, taken)
        self._resumption = resumption_of(config, stored)
        self._loop = self._make_loop(pipeline, wake)
        self._keeper = Keeper(store, self._counts, lambda: self._loop.call(lambda p: p.whole()))
        self._publisher = GraphPublisher(
            session,
            RobotKeys(config.robot),
            pipeline.snapshot(),
            lambda instance_id: self._loop.call(lambda p: p.find_arrays(instance_id)),
            lambda: self._loop.call(lambda p: p.navigation_grid()),
        )
        self._places = LocalisationPublisher(
            session, RobotKeys(config.robot), pipeline.snapshot().frame, tf=_tf_publisher(config, session)
        )
        self._commands = self._make_commands(make)
        self._geometry = GeometryKeeper(self._loop, self._keeper, self._resumption)
        self._workers = self._make_workers(wake)
        self._started_s = monotonic_s()
        self._status_seq = 0

    def _make_loop(self, pipeline: MapPipeline, wake: Event) -> MapLoop:
        config, eyes = self._config, self._eyes
        noted = None if self._recorder is None else self._recorder.event
        return MapLoop(
            self._ingest,
            Synchronizer(config.sync),
            pipeline,
            self._outbox,
            wake=wake,
            stopper=self.stopper,
            beats=self._beats,
            times=self._times,
            max_failures=config.health.max_failures,
            on_lag=None if eyes is None else eyes.note_lag,
            on_place=self._tell_place,
            resumption=self._resumption,
            note=noted,
        )

    def _make_workers(self, wake: Event) -> list[Worker]:
        workers = [
            Worker("map", self._loop.run, self._thread_died),
            Worker(_PUBLISH, self._publish_loop, self._thread_died),
        ]
        eyes = self._eyes
        if eyes is not None:
            workers += [
                Worker(perception.NAME, lambda: eyes.run(self.stopper, self._beats.beat, wake), self._thread_died),
                Worker(perception.WATCH, lambda: eyes.watch(self.stopper), self._thread_died),
            ]
        recorder = self._recorder
        if recorder is not None:
            workers.append(Worker(record.NAME, lambda: recorder.run(self.stopper, self._beats.beat), self._thread_died))
        return workers

    def _make_commands(self, make: Make | None) -> list[EditCommands | MapCommands | BundleCommand]:
        keys = RobotKeys(self._config.robot)
        commands: list[EditCommands | MapCommands | BundleCommand] = [EditCommands(self._session, keys, self._loop)]
        if self._recorder is not None:
            bundles = Bundles(self._config, self._loop, self._recorder, self._publisher.status)
            commands.append(BundleCommand(self._session, keys, bundles))
        if self._store is not None and make is not None:
            maps = Maps(self._store.path.parent, self._loop, self._keeper, make)
            commands.append(MapCommands(self._session, keys, maps, self._loop, self._resumption))
        return commands

    def start(self) -> None:
        """Starts the threads, publishes a first status, and shows the alive token."""
        for worker in self._workers:
            if worker.name != perception.WATCH:  # which makes progress only when there is something to end
                self._beats.beat(worker.name)
            worker.start()
        self._tell_status()
        self._publisher.announce()

    def main_loop(self) -> None:
        """Until asked to stop: status, and the watchdog for as long as every thread makes progress."""
        watchdog_s = watchdog_period_s()
        period_s = self._config.health.status_period_s
        status_due_s = monotonic_s()
        while not self.stopper.wait(min(period_s, watchdog_s or period_s)):
            now_s = monotonic_s()
            if watchdog_s is not None and not self._beats.late(now_s):
                notify("WATCHDOG=1")
            if now_s >= status_due_s:
                status_due_s = now_s + period_s * 0.9
                self._tell_status()

    def stop(self) -> bool:
        """Ends the threads in order, so that the last step reaches disk and network. False when one would not end."""
        self.stopper.request("stopped")
        self._ingest.close()
        for commands in self._commands:
            commands.close()
        map_thread, publish_thread, *seeing = self._workers
        done = all([worker.join(_JOIN_S) for worker in seeing])
        done = map_thread.join(_JOIN_S) and done
        self._map_done.set()
        done = publish_thread.join(_JOIN_S) and done
        if not done:
            _log.error("a thread did not end within %g s", _JOIN_S)
        self._places.close()
        self._publisher.close()
        return done

    @property
    def failed(self) -> bool:
        """Whether irsd stops because something broke."""
        return self._loop.gave_up or any(worker.failure is not None for worker in self._workers)

    # ---------------------------------------------------------------------------------------------- publish thread
    def _publish_loop(self) -> None:
        while True:
            self._beats.beat(_PUBLISH)
            publication = self._outbox.get(0.25)
            if publication is not None:
                self._publish(publication)
            elif self._map_done.is_set():
                break
            else:
                self._keeper.catch_up()
            self._geometry.tend(monotonic_s())
        self._beats.end(_PUBLISH)

    def _publish(self, publication: Publication) -> None:
        """Disk before network: nobody must have seen a revision that a crash can take back."""
        began_s = monotonic_s()
        self._keeper.keep(publication)
        stored_s = monotonic_s()
        try:
            self._publisher.publish(publication.delta, publication.snapshot)
        except TransportError as error:
            self._counts.add("publish_errors")
            _log.error("revision %d could not be published: %s", publication.delta.seq, error)
        self._times.add({"store": (stored_s - began_s) * 1e3, "publish": (monotonic_s() - stored_s) * 1e3})

    def _record(self, topic: Topic, payload: bytes) -> None:
        """On the map thread: a message onto disk, pictures where they may be kept."""
        keep = topic.kind not in PICTURES or (self._config.privacy.store_pictures and self._loop.pictures_allowed)
        if self._recorder is not None and keep:
            self._recorder.take(topic, payload)

    def _tell_place(self, where: Localisation) -> None:
        """On the map thread: a pose that waits behind the disk is worth nothing."""
        try:
            self._places.publish(where)
        except TransportError:
            self._counts.add("publish_errors")

    def _thread_died(self, error: BaseException) -> None:
        self.stopper.request(f"a thread died: {error}")

    # ------------------------------------------------------------------------------------------------- main thread
    def _tell_status(self) -> None:
        now_s, state, snapshot = monotonic_s(), self._loop.state.get(), self._loop.snapshot.get()
        sensors = self._ingest.sensors(now_s)
        seeing = None if self._eyes is None else self._eyes.report()
        findings = self._findings(now_s, state, sensors, seeing)
        faults = self._ledger.update(findings, now_s, wall_clock_ns())
        self._status_seq += 1
        document = status_document(
            seq=self._status_seq,
            robot=self._config.robot,
            version=metadata.version("irsd"),
            uptime_s=now_s - self._started_s,
            frame=snapshot.frame,
            sensors=sensors,
            blocked_by=state.blocked_by
            if state.frames or state.blocked_by
            else "lidar, odometry: nothing received yet",
            stages=self._times.summary(),
            drops={**state.drops, "publish.dropped": self._outbox.dropped},
            graph={"rooms": len(snapshot.rooms), "instances": len(snapshot.instances), "seq": snapshot.seq},
            lag_s=state.lag_s,
            rooms_age_s=None if state.rooms_arrived_ns is None else now_s - state.rooms_arrived_ns * 1e-9,
            perception=seeing,
            faults=[fault.document() for fault in faults],
            faults_ended=self._ledger.ended(),
            queues={**self._ingest.waiting(), _PUBLISH: len(self._outbox), "unstored": self._keeper.waiting},
            process=self._meter.read(),
            counts={
                "frames": state.frames,
                "frames_failed": state.failed,
                "frames_held": self._resumption.held,
                **{f"map.{name}": count for name, count in state.counts.items()},
                **self._counts.snapshot(),
                **{f"zenoh.{name}": count for name, count in self._session.counters().items()},
            },
        )
        try:
            self._publisher.publish_status(json.dumps(document).encode())
        except TransportError as error:
            _log.error("status could not be published: %s", error)
        notify(f"STATUS={status_line(document)}")

    def _findings(
        self, now_s: float, state: MapState, sensors: Mapping[str, Mapping[str, Any]], seeing: Mapping[str, Any] | None
    ) -> list[Finding]:
        """What every detector says now."""
        health = self._config.health
        found = silent_sensors(health, sensors) + self._watch.findings(monotonic_ns()) + blocked(state.obstacles)
        found += state.sensor_findings
        if self._store is not None:
            directory = self._store.path.parent
            found += short_disk(*disk_state(directory), str(directory), health)
        return found + own_state(
            health,
            late_threads=self._beats.late(now_s),
            failures=state.failures,
            last_failure=state.last_failure,
            store_error=self._keeper.error,
            map_mismatch=self._resumption.problem,
            lag_s=state.lag_s,
            perception=seeing,
            missing_models=self._missing,
            clock_step_s=self._wall_clock.step_s(now_s, wall_clock_ns()),
        )


@lasting_objects()
def prepared(config: IrsdConfig, store: Store | None, labels: LabelEncoder) -> Callable[[Session], Daemon]:
    """Everything that takes long, done: models, kernels, the stored map. What is left is to give it a session."""
    stored = stored_map(store, config.store.on_start)
    missing: list[str] = []
    eyes = open_live_eyes(config, missing)
    if eyes is not None:
        config = with_pictures(config)
    config = without_lost_network(config, missing)
    namer = open_names(config, labels, missing)

    def make(stored: StoredMap | None, map_id: str, taught: Mapping[int, Prototype]) -> MapPipeline:
        private = config.privacy.no_pictures_in
        pipeline = MapPipeline(config.pipeline, labels, map_id=map_id, eyes=eyes, namer=namer, no_pictures_in=private)
        if stored is None:
            pipeline.learn(taught)
        else:
            pipeline.restore(stored)
        return pipeline

    map_id = stored.snapshot.map_id if stored is not None else uuid.uuid4().hex[:12]
    pipeline = make(stored, map_id, store.prototypes() if store is not None else {})
    if stored is not None:
        graph = pipeline.snapshot()
        _log.info("map %s taken up: %d rooms, %d things", map_id, len(graph.rooms), len(graph.instances))
    return lambda session: Daemon(config, session, pipeline, store, eyes, missing, stored=stored, make=make)


def run(config: IrsdConfig, endpoint: str | None) -> int:
    """Runs irsd until SIGTERM or SIGINT; the exit code. Raises IrsdError when it can't start."""
    store = open_store(config)
    settings = with_environment(config.zenoh, endpoint)
    try:
        begin = prepared(
            config, store, LabelEncoder.load()
        )  # before subscribing: opening a model holds the interpreter up
        with open_session(settings, "hub") as session:
            daemon = begin(session)
            for number in (signal.SIGTERM, signal.SIGINT):
                signal.signal(number, lambda n, _: daemon.stopper.request(signal.Signals(n).name))
            daemon.start()
            notify("READY=1")
            _log.info("robot %s on %s", config.robot, settings.endpoint)
            daemon.main_loop()
            notify("STOPPING=1")
            (_log.error if daemon.failed else _log.info)("stopping: %s", daemon.stopper.reason)
            ended = daemon.stop()
            return EXIT_FAILED if daemon.failed or not ended else EXIT_STOPPED
    finally:
        if store is not None:
            store.close()


def _tf_publisher(config: IrsdConfig, session: Session) -> TfPublisher | None:
    if not config.pipeline.localise.publish_tf:
        return None
    return TfPublisher(session, namespace=config.ingest.namespace, domain=config.ingest.domain)


def main(arguments: Sequence[str] | None = None) -> int:
    """The command ``irsd``; returns the exit code."""
    parsed = read_arguments(arguments)
    set_up_logging(parsed.log_level)
    try:
        return run(configured(parsed), parsed.endpoint)
    except ConfigError as error:
        _log.error("%s", error)
        return EXIT_CONFIG
    except IrsdError as error:
        _log.error("can't start: %s", error)
        return EXIT_FAILED
