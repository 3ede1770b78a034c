"""The bridge: goals in words come in over zenoh, waypoints go out, the drive is watched to its end. Composition root of nav_bridge.

One loop on the main thread owns planner, goal and monitor. Queries are answered by it: their handlers, on zenoh's pool, put a
request into a ring and wait. One goal at a time; a new one that can be driven preempts one of the same or lower priority. While
it drives, the plan is repeated as a heartbeat: a vehicle that hears none holds, however this process has ended.
"""

from __future__ import annotations

import json
import logging
import signal
from dataclasses import replace
from datetime import datetime
from functools import partial
from typing import Any

from irsd.core.errors import DecodeError, IrsdError, TransportError
from irsd.core.runtime import Event, Ring, Stopper, monotonic_ns, monotonic_s, wall_clock_ns
from irsd.core.systemd import Watchdog, notify
from irsd.graph.model import GraphSnapshot
from irsd.io.cdr import decode_odometry
from irsd.io.endpoints import with_environment
from irsd.io.keys import RobotKeys, subscriptions
from irsd.io.localisation import MapFrame
from irsd.io.session import Query, Sample, Session, open_session
from irsd.perception.encoder import LabelEncoder
from nav_bridge.answer import Answer, answer_document, answer_text
from nav_bridge.config import BridgeSettings, state_file
from nav_bridge.drive import Doubt, Drive
from nav_bridge.faults import FaultBoard
from nav_bridge.journal import Entry, Journal
from nav_bridge.mirror import GraphMirror
from nav_bridge.monitor import Driving, Failed, Outcome, Reached
from nav_bridge.planner import Planner, World, XyYaw
from nav_bridge.reader import Reader
from nav_bridge.requests import Goto, Request, checked_goto, request_of
from nav_bridge.route import narrowed
from nav_bridge.scout import Scout
from nav_bridge.search import warm_up
from nav_bridge.sinks.base import Plan
from nav_bridge.sinks.choice import open_sinks
from nav_bridge.source import Source

_log = logging.getLogger(__name__)

_ODOMETRY = "nav_msgs/msg/Odometry"
_PERIOD_S = 0.05
_STATE_PERIOD_NS = 500_000_000  # a drive is reported at least this often
_REQUEST_TIMEOUT_S = 20.0


class Bridge:
    """Everything between a request and its end. ``run`` owns the calling thread; ``close`` stops the robot if it drives."""

    def __init__(self, session: Session, settings: BridgeSettings, encoder: LabelEncoder) -> None:
        self._session = session
        self._settings = settings
        self._keys = RobotKeys(settings.robot)
        self._planner = Planner(encoder, settings)
        self._reader = Reader(settings.reader, encoder.aliases)
        self._board = FaultBoard(session, self._keys)
        self._last = ""
        self._sinks = open_sinks(session, self._keys, settings)
        self._source = Source(session, self._keys, settings.reply_timeout_s, settings.route)
        self._scout = Scout(self._source, settings.drive.review_s)
        self._map_frame = MapFrame(session, self._keys, settings.reply_timeout_s)
        self._mirror = GraphMirror(session, self._keys, settings.reply_timeout_s)
        self._wake = Event()
        self._odometry: Ring[Sample] = Ring(200, self._wake)
        self._requests: Ring[Request] = Ring(16, self._wake)
        self._pose: XyYaw | None = None
        self._pose_ns = 0
        self._drive: Drive | None = None
        self._beat_ns = 0
        self._goals = 0
        self._state_seq = 0
        self._reported_ns = 0
        self._bad_odometry = 0
        self._irsd_gone, self._irsd_gone_ns = False, 0
        self._journal = Journal(state_file(settings))
        self._owed, self._owed_since_ns = self._journal.read(), monotonic_ns()
        self._tokens: Ring[Sample] = Ring(16, self._wake)
        topics = subscriptions(settings.odom_topic, _ODOMETRY, namespace=settings.odom_namespace)
        self._handles = [session.subscribe(key, self._odometry) for key in topics]
        self._handles += [
            session.queryable(self._keys.nav(name), partial(self._ask, name)) for name in ("goto", "why", "cancel")
        ]
        self._handles.append(session.watch_alive(self._keys.alive, self._tokens))
        self._handles.append(session.announce(self._keys.nav("alive")))

    # --------------------------------------------------------------------------------------------------- the loop
    def run(self, stopper: Stopper) -> None:
        """Until the stop is requested. Raises TransportError when the mirror's thread has died."""
        watchdog = Watchdog()
        while not stopper.requested:
            self._wake.wait(_PERIOD_S)
            self._wake.clear()
            self.step(monotonic_ns())
            if not (self._mirror.alive and self._scout.alive):
                raise TransportError("a thread has died; see the log")
            watchdog.feed(monotonic_s())

    def step(self, now_ns: int) -> None:
        """One turn: odometry, then requests, then the clock."""
        if (graph := self._mirror.graph) is not None:
            self._board.show("geofence", self._planner.follow(graph))
        for sample in self._odometry.drain():
            self._hear(sample)
        for token in self._tokens.drain():
            self._irsd_gone = token.deleted
            if token.deleted:
                self._irsd_gone_ns = token.received_ns
        if self._owed is not None:
            self._take_up(*self._owed, now_ns)
        for request in self._requests.drain():
            self._serve(request, now_ns)
        if self._drive is not None:
            self._reconsider(self._drive, now_ns)
        if self._drive is not None:
            self._judge(self._drive.monitor.tick(max(now_ns, self._pose_ns)), now_ns)
        if self._drive is not None and now_ns - self._beat_ns >= self._settings.drive.heartbeat_s * 1e9:
            self._beat_ns = now_ns
            if self._drive.holding_ns is None:
                plan = self._drive.rest(self._settings.drive)
                for sink in self._sinks:
                    sink.beat(plan)

    def close(self) -> None:
        """Stops a robot that is under way, and takes everything back."""
        if self._drive is not None:
            self._end("cancelled", "nav_bridge stops", None, stop=True)
        for handle in self._handles:
            handle.close()
        self._board.close()
        self._mirror.close()
        self._map_frame.close()
        self._scout.close()
        for sink in self._sinks:
            sink.close()

    def _hear(self, sample: Sample) -> None:
        try:
            odometry = decode_odometry(sample.payload)
        except DecodeError as error:
            self._bad_odometry += 1
            if self._bad_odometry & (self._bad_odometry - 1) == 0:  # 1st, 2nd, 4th, ...: the log must not be flooded
                _log.warning("%d odometry messages were dropped, last: %s", self._bad_odometry, error)
            return
        self._pose, self._pose_ns = self._map_frame.robot(odometry), sample.received_ns
        if self._drive is not None:
            self._judge(self._drive.monitor.update(sample.received_ns, self._pose), sample.received_ns)

    def _judge(self, outcome: Outcome, now_ns: int) -> None:
        """What the monitor says, told to the world."""
        drive = self._drive
        if drive is None or drive.holding_ns is not None:
            return
        if isinstance(outcome, Reached):
            away = "" if drive.target.is_room else f"{outcome.distance_m:.2f} m from "
            self._end("reached", "", outcome.distance_m, text=f"Reached: {away}{drive.name}")
        elif isinstance(outcome, Failed) and outcome.cause == "stuck" and self._pose and drive.felt(self._pose[:2]):
            self._wait(drive, Doubt("blocked", outcome.reason), outcome.reason, now_ns)
        elif isinstance(outcome, Failed):
            self._end("failed", f"{outcome.cause}: {outcome.reason}", outcome.distance_m, stop=True)
        elif now_ns - self._reported_ns >= _STATE_PERIOD_NS:
            self._report(drive, "driving", outcome, _progress(drive, outcome))
            self._reported_ns = now_ns
            self._journal.touch()

    # --------------------------------------------------------------------------------------------------- requests
    def _ask(self, name: str, query: Query) -> None:
        """On zenoh's pool: hands the request to the loop and waits for its answer."""
        request = request_of(name, query)
        if isinstance(text := request.document.get("query"), str):
            request.read = self._reader.read(text)  # a language model may take long: the loop must not wait for it
        self._requests.put(request)
        if not request.done.wait(_REQUEST_TIMEOUT_S):
            raise TransportError(f"nav/{name}: nav_bridge is busy")
        if request.error:
            raise TransportError(request.error)
        query.reply(self._keys.nav(name), json.dumps(request.answer, ensure_ascii=False).encode())

    def _serve(self, request: Request, now_ns: int) -> None:
        try:
            request.answer = self._cancel() if request.name == "cancel" else self._goto(request, now_ns)
        except IrsdError as error:
            request.error = str(error)
        finally:
            request.done.set()

    def _cancel(self) -> dict[str, Any]:
        drive = self._drive
        if self._owed is not None:
            owed = self._owed[0]
            self._drop_owed("cancelled", "cancelled on request")
            return {"goal_id": owed.goal_id, "text": f"cancelled the drive to {owed.target}"}
        if drive is None:
            return {"goal_id": None, "text": "nothing to cancel"}
        self._end("cancelled", "cancelled on request", None, stop=True)
        return {"goal_id": drive.goal_id, "text": f"cancelled the drive to {drive.name}"}

    def _goto(self, request: Request, now_ns: int) -> dict[str, Any]:
        """Answers a goal and, when it is resolved and not only explained (why), starts the drive."""
        goto, drives = checked_goto(request.document, request.name), request.name == "goto"
        fresh = self._pose is not None and (now_ns - self._pose_ns) * 1e-9 <= self._settings.monitor.odometry_timeout_s
        running = self._drive
        if drives and running is not None and goto.priority < running.priority:
            raise TransportError(
                f"busy: {running.goal_id} to {running.name} has priority {running.priority}; "
                f"ask with at least that, or cancel it"
            )
        robot = goto.start or (self._pose if fresh else None)
        if robot is None:
            raise TransportError(f"no odometry on {self._settings.odom_topic}: it is not known where the robot is")
        graph = self._mirror.graph
        if graph is None:
            raise TransportError(f"no graph on {self._keys.snapshot}: is irsd running?")
        world = World(graph, self._source.cost_map, self._source.points, robot, _minute(), self._last)
        answer = self._planner.answer(goto.query, world, goto.within_m, request.read)
        self._last = answer.target.instance if answer.target is not None else self._last
        if not drives:
            return answer_document(answer, graph)
        self._goals += 1
        goal_id = f"g{self._goals}-{self._session.zid[:8]}"
        _log.info("%s %r: %s", goal_id, goto.query, answer_text(answer, graph))
        if answer.status == "resolved":
            if not fresh:
                raise TransportError(f"no odometry on {self._settings.odom_topic}: the drive can't be watched")
            # What was thought about is no silence of the odometry: the watch begins now.
            self._start(goal_id, goto, answer, graph, max(now_ns, monotonic_ns()))
        return {**answer_document(answer, graph, goal_id), "goal_id": goal_id}

    def _start(self, goal_id: str, goto: Goto, answer: Answer, graph: GraphSnapshot, now_ns: int) -> None:
        settings = self._settings
        within_m = settings.approach.within_m if goto.within_m is None else goto.within_m
        drive = Drive(goal_id, goto.query, within_m, goto.priority)
        if not drive.adopt(answer, graph, settings.monitor, settings.approach, now_ns):
            return
        self._drop_owed("preempted", f"preempted by {goal_id}")
        if self._drive is not None:
            self._end("preempted", f"preempted by {goal_id}", None)
        self._drive = drive
        whole = Driving(drive.length_m, None)
        self._report(drive, "accepted", whole, f"accepted: {drive.name}, {drive.length_m:.1f} m to go")
        self._set_off(drive, now_ns)

    def _set_off(self, drive: Drive, now_ns: int) -> None:
        """Tells the vehicle the drive's plan."""
        self._send(drive.plan(self._settings.drive))
        self._beat_ns = self._reported_ns = now_ns
        self._journal.write(drive.entry())
        self._scout.aim(drive.seq, None if drive.target.is_room else drive.target.instance)
        whole = Driving(drive.length_m, None)
        self._report(drive, "driving", whole, f"driving to {drive.name}, {drive.length_m:.1f} m to go")

    # ---------------------------------------------------------------------------------------------- while it drives
    def _reconsider(self, drive: Drive, now_ns: int) -> None:
        """Plans anew when map, target or robot say that the plan is no longer good, or the vehicle that it can't be driven."""
        trouble = next((words for sink in self._sinks if (words := sink.trouble())), "")
        if trouble:
            self._end("failed", f"vehicle: {trouble}", None, stop=True)
            return
        settings, graph = self._settings, self._mirror.graph
        if self._irsd_gone or self._mirror.synced_ns < self._irsd_gone_ns:
            gone = Doubt("irsd is gone", "irsd is gone: nobody watches map and target")
            self._wait(drive, gone, "it has not come back with its graph", now_ns)
            return
        if graph is None or self._pose is None or now_ns - drive.planned_ns < settings.drive.replan_pause_s * 1e9:
            return
        view = seen = self._scout.view()
        if seen is not None and seen.costs is not None:
            view = replace(seen, costs=self._planner.fenced(seen.costs, graph, _minute()))
        doubt = drive.doubt(graph, view, self._pose[:2], settings.drive.off_way_m, settings.route.robot_radius_m)
        if doubt is None:
            return
        if doubt.cause == "new map" or drive.plans > settings.drive.max_replans:
            self._end("failed", f"{doubt.cause}: {doubt.text}", None, stop=True)
            return
        costs = seen.costs if seen is not None and seen.costs is not None else self._source.cost_map()
        costs = costs and narrowed(costs, drive.tight, settings.route)
        self._replan(drive, doubt, World(graph, lambda: costs, self._source.points, self._pose, _minute()), now_ns)

    def _replan(self, drive: Drive, doubt: Doubt, world: World, now_ns: int) -> None:
        """A new plan for the goal, of a target that vanished for what it may be now; none: hold and try again until patience ends."""
        self._report_doubt(drive, doubt)
        if doubt.cause in ("vanished", "lost"):
            answer = self._planner.answer(drive.query, world, drive.within_m)
            reason = f"{doubt.text}; {answer_text(answer, world.graph)}"
        else:
            answer = self._planner.again(drive.answer, world, drive.within_m)
            reason = answer.reason
        if answer.status == "resolved":
            if drive.adopt(answer, world.graph, self._settings.monitor, self._settings.approach, now_ns):
                self._set_off(drive, now_ns)
        elif doubt.cause == "vanished":
            self._end("failed", f"vanished: {reason}", None, stop=True)
        else:
            self._wait(drive, doubt, reason, now_ns)

    def _wait(self, drive: Drive, doubt: Doubt, reason: str, now_ns: int) -> None:
        """The vehicle holds until there is a way again, or the patience is over."""
        if drive.holding_ns is None:
            self._report_doubt(drive, doubt)
            self._send(drive.stop(self._settings.drive))
        drive.hold(now_ns)
        self._scout.aim(drive.seq, None if drive.target.is_room else drive.target.instance)
        if drive.holding_ns is not None and now_ns - drive.holding_ns >= self._settings.drive.patience_s * 1e9:
            self._end("failed", f"{doubt.cause}: {reason}", None)

    def _take_up(self, entry: Entry, age_s: float, now_ns: int) -> None:
        """Goes on with the goal that was under way when nav_bridge died, as soon as it is known where the robot is, and in what."""
        settings, graph = self._settings, self._mirror.graph
        waited_s = (now_ns - self._owed_since_ns) * 1e-9
        if age_s > settings.drive.resume_s:
            self._drop_owed("failed", f"nav_bridge has died and was gone for {age_s:.0f} s")
        elif graph is None or self._irsd_gone or self._pose is None:
            if waited_s > settings.drive.patience_s:
                missing = "odometry" if self._pose is None else "graph"
                self._drop_owed("failed", f"nav_bridge has died, and there is no {missing} since it is back")
        elif graph.map_id != entry.map_id:
            self._drop_owed("failed", "new map: nav_bridge and irsd have died, and irsd has started another map")
        else:
            world = World(graph, self._source.cost_map, self._source.points, self._pose, _minute())
            answer = self._planner.back_to(entry.query, entry.target, world, entry.within_m)
            drive = Drive(entry.goal_id, entry.query, entry.within_m, entry.priority, entry.plan_seq)
            if not drive.adopt(answer, graph, settings.monitor, settings.approach, now_ns):
                self._drop_owed("failed", f"nav_bridge has died, and now: {answer_text(answer, graph)}")
                return
            self._owed, self._drive = None, drive
            self._report(drive, "planning", Driving(drive.length_m, None), "planning anew: nav_bridge was restarted")
            self._set_off(drive, now_ns)

    def _drop_owed(self, state: str, reason: str) -> None:
        """The goal that was under way when nav_bridge died is not taken up."""
        if self._owed is None:
            return
        entry, self._owed = self._owed[0], None
        self._journal.clear()
        drive = Drive(entry.goal_id, entry.query, entry.within_m, entry.priority, entry.plan_seq)
        self._report(drive, state, Driving(0.0, None), f"{state.capitalize()}: {reason}", reason)
        _log.info("%s %s %s", entry.goal_id, state, reason)

    # ------------------------------------------------------------------------------------------------------ telling
    def _end(self, state: str, reason: str, distance_m: float | None, *, text: str = "", stop: bool = False) -> None:
        """The drive is over; stop: the robot is told to stand still."""
        drive, self._drive = self._drive, None
        if drive is None:
            return
        self._scout.aim(None)
        self._journal.clear()
        if stop:
            self._send(drive.stop(self._settings.drive))
        self._report(drive, state, Driving(0.0, distance_m), text or f"{state.capitalize()}: {reason}", reason)
        _log.info("%s %s %s", drive.goal_id, state, text or reason)

    def _report_doubt(self, drive: Drive, doubt: Doubt) -> None:
        """Once for every hold or new plan."""
        if drive.holding_ns is None:
            _log.info("%s planning anew: %s", drive.goal_id, doubt.text)
            self._report(drive, "planning", Driving(0.0, None), f"planning anew: {doubt.text}", doubt.cause)

    def _send(self, plan: Plan) -> None:
        for sink in self._sinks:
            sink.send(plan)

    def _report(self, drive: Drive, state: str, progress: Driving, text: str, reason: str = "") -> None:
        self._state_seq += 1
        document = drive.document(self._state_seq, state, progress, text, reason)
        self._session.put(self._keys.nav("state"), json.dumps(document).encode(), express=True)


def _minute() -> int:
    """Of the day, local time."""
    now = datetime.fromtimestamp(wall_clock_ns() * 1e-9)
    return 60 * now.hour + now.minute


def _progress(drive: Drive, outcome: Driving) -> str:
    left = "" if outcome.eta_s is None else f", about {outcome.eta_s:.0f} s"
    return f"driving to {drive.name}, {outcome.remaining_m:.1f} m to go{left}"


def run_bridge(settings: BridgeSettings, robot: str | None, endpoint: str | None) -> None:
    """Runs until SIGINT or SIGTERM. robot, endpoint: from the command line, over the settings."""
    stopper = Stopper()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda received, _: stopper.request(signal.Signals(received).name))
    settings = replace(settings, zenoh=with_environment(settings.zenoh, endpoint), robot=robot or settings.robot)
    encoder = LabelEncoder.load()  # before the session: a bridge that can be asked can answer
    warm_up()
    with open_session(settings.zenoh, "peer") as session:
        bridge = Bridge(session, settings, encoder)
        notify("READY=1")
        _log.info("ready: robot %s, endpoint %s", settings.robot, settings.zenoh.endpoint)
        try:
            bridge.run(stopper)
        finally:
            bridge.close()
    _log.info("ended: %s", stopper.reason)
