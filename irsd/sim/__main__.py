"""``irs-world``: the embedded world as a process: a robot's sensors on zenoh, as zenoh-bridge-ros2dds would put them there."""

from __future__ import annotations

import argparse
import json
import logging
import signal
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from irsd.core.errors import DecodeError, IrsdError, TransportError
from irsd.core.runtime import Mailbox, Ring, Stopper, monotonic_s, sleep_s, wall_clock_ns
from irsd.io.handles import Query
from irsd.io.keys import RobotKeys, bridge_key
from irsd.io.localisation import MapFrame
from irsd.io.session import CDR, JSON, Publisher, Sample, Session, ZenohSettings, open_session, with_environment
from irsd.sensors.replay import RecordingWriter
from irsd.sim.building import truth_document
from irsd.sim.changes import apply
from irsd.sim.orders import Orders, Way
from irsd.sim.world import DETECTIONS_TOPIC, JSON_TYPE, TF_TOPIC, World, WorldMessage, WorldSettings, with_speed

_log = logging.getLogger("irsd.sim")

_STEP_S = 0.02
_STATE_PERIOD_S = 0.25
_LOG_PERIOD_S = 10.0
_MAX_LAG_S = 0.5
_ANSWER_S = 2.0
_DETECTIONS_SCHEMA = {
    "type": "object",
    "required": ["stamp_ns", "detections"],
    "properties": {
        "stamp_ns": {"type": "integer"},
        "frame_id": {"type": "string"},
        "detections": {"type": "array", "items": {"type": "object", "required": ["id", "label", "score"]}},
    },
}


class Robot2Zenoh:
    """Publishes the world's messages and hears its waypoints; counts what it sent."""

    def __init__(self, session: Session, robot: str, recording: RecordingWriter | None) -> None:
        keys = RobotKeys(robot)
        self._session = session
        self._recording = recording
        self._publishers: dict[str, Publisher] = {}
        self._state = session.publisher(keys.key("sim/state"), encoding=JSON)
        self._orders = Orders()
        self._map_frame = MapFrame(session, keys)
        self._waypoints: Ring[Sample] = Ring(8)
        self._subscription = session.subscribe(keys.nav("waypoints"), self._waypoints)
        self._changes: Ring[tuple[bytes, Mailbox[dict[str, Any]]]] = Ring(8)
        self._answering = session.queryable(keys.key("sim/change"), self._ask_for_change)
        self._state_seq = 0
        self.sent = 0
        self.bytes_sent = 0

    def send(self, message: WorldMessage) -> None:
        """One message on the topic's bridge key, and into the recording."""
        self.warm_up(message)
        self._publishers[message.topic].put(message.data)
        self.sent += 1
        self.bytes_sent += len(message.data)
        if self._recording is None:
            return
        if message.type_name == JSON_TYPE:
            self._recording.write_json(
                message.topic, "Detections", _DETECTIONS_SCHEMA, message.data, message.log_time_ns
            )
        else:
            self._recording.write(message.topic, message.type_name, message.data, message.log_time_ns)

    def warm_up(self, message: WorldMessage) -> None:
        """Declares the message's publisher without sending, so that the first second is like every other."""
        if message.topic not in self._publishers:
            self._publishers[message.topic] = self._declare(message)

    def send_state(self, world: World) -> None:
        """``irs/<robot>/sim/state``: what the robot is doing and where it truly is."""
        self._state_seq += 1
        header = {"schema": "irs/sim/state/1", "seq": self._state_seq, "frame": "map", "stamp_ns": world.now_ns}
        self._state.put(json.dumps({**header, **world.state()}).encode())

    @property
    def map_T_odom(self) -> tuple[float, float, float]:
        """Where irsd says that the odometry's frame lies in its map: (x_m, y_m, yaw_rad)."""
        return self._map_frame.xy_yaw

    def new_waypoints(self) -> Way | None:
        """The way to follow from now on; None to go on as before. Bad documents are logged and dropped.

        A plan that is not repeated in time is taken for a stop.
        """
        latest: Way | None = None
        for sample in self._waypoints.drain():
            try:
                heard = self._orders.hear(sample.payload, sample.received_ns * 1e-9)
            except ValueError as error:
                _log.warning("waypoints dropped: %s", error)
                continue
            latest = latest if heard is None else heard
        if self._orders.overdue(monotonic_s()):
            _log.warning("no word from the planner in time: holding")
            return Way([], "map")
        return latest

    def make_changes(self, world: World) -> None:
        """What was asked for at ``irs/<robot>/sim/change``, between two steps of the world."""
        for payload, answer in self._changes.drain():
            try:
                answer.put(apply(world, payload))
                _log.info("the world was changed: %s", payload.decode())
            except DecodeError as error:
                answer.put({"error": str(error)})

    def _ask_for_change(self, query: Query) -> None:
        """On a thread of the session: hands the question to the world's and waits for what comes of it."""
        answer: Mailbox[dict[str, Any]] = Mailbox()
        self._changes.put((query.payload, answer))
        done = answer.get(_ANSWER_S)
        if done is None:
            raise TransportError("the world is too busy")
        if "error" in done:
            raise DecodeError(done["error"])
        query.reply(query.key, json.dumps(done).encode())

    def close(self) -> None:
        """Ends the subscription and publishers."""
        self._map_frame.close()
        for handle in (self._answering, self._subscription, self._state, *self._publishers.values()):
            handle.close()

    def _declare(self, message: WorldMessage) -> Publisher:
        key = bridge_key(message.topic)
        if message.topic == TF_TOPIC:  # TRANSIENT_LOCAL on ROS: late subscribers get it
            return self._session.history_publisher(key, encoding=CDR, keep=1)
        encoding = JSON if message.topic == DETECTIONS_TOPIC else CDR
        return self._session.publisher(key, encoding=encoding, block=False)


def run(world: World, link: Robot2Zenoh, duration_s: float | None, stopper: Stopper) -> None:
    """Lets the world go on in real time until stopped. Late by more than half a second, time slips instead of racing."""
    world.start_at(wall_clock_ns())  # stamps then are the wall clock's, however long the start took
    began = monotonic_s()
    slipped_s, next_state_s, next_log_s = 0.0, 0.0, 0.0
    while not stopper.requested:
        passed_s = (world.now_ns - world.start_ns) * 1e-9
        if duration_s is not None and passed_s >= duration_s:
            return
        ahead_s = passed_s + slipped_s - (monotonic_s() - began)
        if ahead_s > 0:
            sleep_s(ahead_s)
        elif ahead_s < -_MAX_LAG_S:
            slipped_s -= ahead_s
            _log.warning("the world is too slow: %.1f s lost so far", slipped_s)
        waypoints = link.new_waypoints()
        if waypoints is not None:
            count = len(waypoints.points)
            _log.info("%d waypoints received" if count else "stop received (%d waypoints)", count)
            world.follow(*waypoints)
        world.map_T_odom = link.map_T_odom
        link.make_changes(world)
        for message in world.step(_STEP_S):
            link.send(message)
        if passed_s >= next_state_s:
            next_state_s += _STATE_PERIOD_S
            link.send_state(world)
        if passed_s >= next_log_s:
            next_log_s += _LOG_PERIOD_S
            x, y, _ = world.robot.pose
            _log.info(
                "%3.0f s: %s %3.0f %%, at (%.1f, %.1f), %d messages, %d collisions",
                passed_s, world.phase, 100 * world.progress, x, y, link.sent, world.robot.collisions,
            )  # fmt: skip


def _arguments() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="irs-world",
        description="A furnished building with a robot in it: LiDAR, camera, odometry and detections on zenoh, as ROS 2 CDR. "
        "The robot explores every room, then waits for waypoints on irs/<robot>/nav/waypoints. "
        "Things are carried about by queries to irs/<robot>/sim/change.",
    )
    add = parser.add_argument
    add("--seed", type=int, default=1, help="which building; the same seed is the same building and noise (1)")
    add("--robot", default="robot", help="name of the robot in the keys irs/<robot>/... (robot)")
    add("--endpoint", help="where irsd listens (IRSD_ENDPOINT, or irsd's default)")
    add("--speed", type=_speed, default=1.0, metavar="M_S", help="top speed in m/s, 0.1 .. 1.5 (1.0)")
    add("--duration", type=float, metavar="S", help="seconds until it ends (for ever)")
    add("--no-explore", action="store_true", help="stand and wait for waypoints instead of exploring first")
    add("--no-detections", action="store_true", help="pictures only: irsd sees with its own eyes")
    add("--record", type=Path, metavar="FILE.mcap", help="also write all messages to this recording")
    add("--truth", type=Path, metavar="FILE.json", help="write the ground truth")
    return parser


def _speed(text: str) -> float:
    speed = float(text)
    if not 0.1 <= speed <= 1.5:
        raise argparse.ArgumentTypeError(f"{text} is not in 0.1 .. 1.5 m/s")
    return speed


def main(arguments: list[str] | None = None) -> None:
    """Runs the world until its duration is over or a signal comes. Exits with 1 and one line when it can't."""
    parser = _arguments()
    options = parser.parse_args(arguments)
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(name)s %(levelname)s %(message)s")
    stopper = Stopper()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda signum, _frame: stopper.request(f"signal {signum}"))
    try:
        settings = with_speed(WorldSettings(detections=not options.no_detections), options.speed)
        world = World(options.seed, settings, explore=not options.no_explore)
        if options.truth is not None:
            options.truth.write_text(json.dumps(truth_document(world.building), indent=1) + "\n")
        with ExitStack() as stack:
            recording = stack.enter_context(RecordingWriter(options.record)) if options.record else None
            session = stack.enter_context(open_session(with_environment(ZenohSettings(), options.endpoint)))
            link = Robot2Zenoh(session, options.robot, recording)
            stack.callback(link.close)
            for message in World(options.seed, settings).step(2 * settings.camera_period_s):
                link.warm_up(message)
            _log.info("world %d is up: %s", options.seed, ", ".join(room.label for room in world.building.rooms))
            run(world, link, options.duration, stopper)
    except (IrsdError, OSError, ValueError) as error:
        parser.exit(1, f"irs-world: {error}\n")


if __name__ == "__main__":
    main()
