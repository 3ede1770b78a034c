"""The composition root of irsd: configuration, store, pipeline, zenoh and the threads, put together and taken down.

Threads: zenoh's own (append to rings), ``map`` (see maploop), ``perception`` and its watch where irsd has eyes of its own,
``publish`` (disk, then network), ``main`` (signals, status, watchdog).
Exit codes: 0 asked to stop, 2 bad configuration or arguments, 1 anything else.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import logging
import signal
import uuid
from collections import deque
from collections.abc import Mapping, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

from irsd.commands import EditCommands
from irsd.config import IrsdConfig, find_config, load_config, state_directory, with_pictures
from irsd.core.errors import ConfigError, IrsdError, StoreError, TransportError
from irsd.core.faults import Finding
from irsd.core.logs import set_up_logging
from irsd.core.runtime import Cell, Counters, Event, Ring, Stopper, Worker, monotonic_ns, monotonic_s, wall_clock_ns
from irsd.core.systemd import notify, watchdog_period_s
from irsd.core.types import Localisation
from irsd.faults import FaultLedger, blocked, own_state, short_disk, silent_sensors
from irsd.graph.store import Store
from irsd.health import (
    Heartbeats,
    ProcessMeter,
    StageTimes,
    WallClock,
    disk_state,
    status_document,
    status_line,
)
from irsd.ingest import Ingest
from irsd.io.keys import RobotKeys, check_robot_name
from irsd.io.localisation import LocalisationPublisher, TfPublisher
from irsd.io.publishers import GraphPublisher
from irsd.io.session import Session, open_session, with_environment
from irsd.maploop import MapLoop, MapState, Publication
from irsd.opening import open_live_eyes, open_names, without_lost_network
from irsd.perception import worker as perception
from irsd.perception.encoder import LabelEncoder
from irsd.perception.worker import LiveEyes
from irsd.pipeline import MapPipeline
from irsd.sensors.sync import Synchronizer
from irsd.sensors.watch import SensorWatch

_log = logging.getLogger(__name__)

EXIT_STOPPED, EXIT_FAILED, EXIT_CONFIG = 0, 1, 2

_PUBLISH = "publish"
_OUTBOX = 256
_UNSTORED = 1024  # beyond that the disk keeps the last state that was whole, until the next start
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
    ) -> None:
        """eyes: those of the pipeline, whose threads are run here. missing: models that could not be opened, and why."""
        self._missing = missing
        self._config, self._session, self._store, self._eyes = config, session, store, eyes
        self.stopper = Stopper()
        self._beats = Heartbeats(config.health.thread_limit_s)
        self._times = StageTimes()
        self._counts = Counters()
        self._meter = ProcessMeter()
        self._store_error = Cell("")
        self._unstored: deque[Publication] = deque(maxlen=_UNSTORED)
        self._map_done = Event()
        self._outbox: Ring[Publication] = Ring(_OUTBOX)
        wake = Event()
        self._watch = SensorWatch(config.watch)
        self._ledger, self._wall_clock = FaultLedger(), WallClock(shown_s=config.watch.shown_s)
        self._ingest = Ingest(session, config.ingest, wake, self._watch)
        self._loop = MapLoop(
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
        )
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
        self._edits = EditCommands(session, RobotKeys(config.robot), self._loop)
        self._workers = [
            Worker("map", self._loop.run, self._thread_died),
            Worker(_PUBLISH, self._publish_loop, self._thread_died),
        ]
        if eyes is not None:
            self._workers += [
                Worker(perception.NAME, lambda: eyes.run(self.stopper, self._beats.beat, wake), self._thread_died),
                Worker(perception.WATCH, lambda: eyes.watch(self.stopper), self._thread_died),
            ]
        self._started_s = monotonic_s()
        self._status_seq = 0

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
        self._edits.close()
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
            elif self._store is not None and self._unstored:
                self._keep_rest(self._store)
        self._beats.end(_PUBLISH)

    def _publish(self, publication: Publication) -> None:
        """Disk before network: nobody must have seen a revision that a crash can take back."""
        began_s = monotonic_s()
        if self._store is not None:
            self._keep(self._store, publication)
        if publication.stored is not None:
            publication.stored.put(self._store_error.get())
        stored_s = monotonic_s()
        try:
            self._publisher.publish(publication.delta, publication.snapshot)
        except TransportError as error:
            self._counts.add("publish_errors")
            _log.error("revision %d could not be published: %s", publication.delta.seq, error)
        self._times.add({"store": (stored_s - began_s) * 1e3, "publish": (monotonic_s() - stored_s) * 1e3})

    def _keep(self, store: Store, publication: Publication) -> None:
        """Onto disk, in order: what could not be written (disk full) is tried again with the next step."""
        self._unstored.append(publication)
        self._keep_rest(store)

    def _keep_rest(self, store: Store) -> None:
        try:
            while self._unstored:
                first = self._unstored[0]
                store.append(first.delta, first.arrays, first.record, building_name=first.snapshot.building.name)
                self._unstored.popleft()
            self._store_error.set("")
        except StoreError as error:
            self._counts.add("store_errors")
            if self._store_error.get() != str(error):
                _log.error("revision %d is not on disk: %s", self._unstored[0].delta.seq, error)
            self._store_error.set(str(error))

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
            queues={**self._ingest.waiting(), _PUBLISH: len(self._outbox), "unstored": len(self._unstored)},
            process=self._meter.read(),
            counts={
                "frames": state.frames,
                "frames_failed": state.failed,
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
            store_error=self._store_error.get(),
            lag_s=state.lag_s,
            perception=seeing,
            missing_models=self._missing,
            clock_step_s=self._wall_clock.step_s(now_s, wall_clock_ns()),
        )


def run(config: IrsdConfig, endpoint: str | None) -> int:
    """Runs irsd until SIGTERM or SIGINT; the exit code. Raises IrsdError when it can't start."""
    labels = LabelEncoder.load()  # before subscribing: opening a model holds the interpreter up
    store = _open_store(config)
    stored = store.load() if store is not None else None
    map_id = stored.snapshot.map_id if stored is not None else uuid.uuid4().hex[:12]
    missing: list[str] = []
    eyes = open_live_eyes(config, missing)
    if eyes is not None:
        config = with_pictures(config)
    config = without_lost_network(config, missing)
    namer = open_names(config, labels, missing)
    pipeline = MapPipeline(config.pipeline, labels, map_id=map_id, eyes=eyes, namer=namer)
    if stored is not None:
        pipeline.restore(stored)
        graph = pipeline.snapshot()
        _log.info("map %s taken up: %d rooms, %d things", map_id, len(graph.rooms), len(graph.instances))
    settings = with_environment(config.zenoh, endpoint)
    try:
        with open_session(settings, "hub") as session:
            daemon = Daemon(config, session, pipeline, store, eyes, missing)
            for number in (signal.SIGTERM, signal.SIGINT):
                signal.signal(number, lambda n, _: daemon.stopper.request(signal.Signals(n).name))
            daemon.start()
            notify("READY=1")
            _log.info("robot %s on %s, map %s", config.robot, settings.endpoint, map_id)
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


def _open_store(config: IrsdConfig) -> Store | None:
    if not config.store.enabled:
        return None
    return Store(state_directory(config.store) / config.robot)


def read_arguments(arguments: Sequence[str] | None) -> argparse.Namespace:
    """The command line; exits with code 2 for a wrong one."""
    parser = argparse.ArgumentParser(
        prog="irsd", description="Builds a live scene graph of a building from a robot's sensors."
    )
    parser.add_argument(
        "--config", type=Path, help="YAML file (default: $IRSD_CONFIG, /etc/irsd/irsd.yaml, built-in values)"
    )
    parser.add_argument("--robot", help="name of the robot")
    parser.add_argument(
        "--endpoint", help="zenoh endpoint to listen on, such as tcp/127.0.0.1:7448 (also $IRSD_ENDPOINT)"
    )
    keep = parser.add_mutually_exclusive_group()
    keep.add_argument("--state", type=Path, help="directory that keeps the map between runs")
    keep.add_argument("--no-store", action="store_true", help="keep nothing on disk")
    parser.add_argument("--log-level", default="info", choices=("debug", "info", "warning", "error"))
    parser.add_argument("--version", action="version", version=f"irsd {metadata.version('irsd')}")
    return parser.parse_args(arguments)


def configured(arguments: argparse.Namespace) -> IrsdConfig:
    """The configuration with the command line's word over it. Raises ConfigError."""
    config = load_config(find_config(arguments.config))
    if arguments.robot:
        config = dataclasses.replace(config, robot=check_robot_name(arguments.robot))
    if arguments.no_store:
        config = dataclasses.replace(config, store=dataclasses.replace(config.store, enabled=False))
    elif arguments.state is not None:
        store = dataclasses.replace(config.store, enabled=True, directory=str(arguments.state))
        config = dataclasses.replace(config, store=store)
    return config


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
