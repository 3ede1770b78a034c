"""``irs-world``: the embedded world as a process: a robot's sensors on zenoh, as zenoh-bridge-ros2dds would put them there."""

from __future__ import annotations

import json
import logging
import signal
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import click

from irsd.core.errors import IrsdError
from irsd.core.runtime import Ring, Stopper, monotonic_s, sleep_s, wall_clock_ns
from irsd.io.keys import RobotKeys, bridge_key
from irsd.io.session import CDR, JSON, Publisher, Sample, Session, ZenohSettings, open_session, with_environment
from irsd.sensors.replay import RecordingWriter
from irsd.sim.building import truth_document
from irsd.sim.world import DETECTIONS_TOPIC, JSON_TYPE, TF_TOPIC, World, WorldMessage, WorldSettings, with_speed

_log = logging.getLogger("irsd.sim")

_STEP_S = 0.02
_STATE_PERIOD_S = 0.25
_LOG_PERIOD_S = 10.0
_MAX_LAG_S = 0.5
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
        self._waypoints: Ring[Sample] = Ring(8)
        self._subscription = session.subscribe(keys.nav("waypoints"), self._waypoints)
        self._state_seq = 0
        self.sent = 0
        self.bytes_sent = 0

    def send(self, message: WorldMessage) -> None:
        """One message on the topic's bridge key, and into the recording."""
        publisher = self._publishers.get(message.topic)
        if publisher is None:
            publisher = self._publishers[message.topic] = self._declare(message)
        publisher.put(message.data)
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

    def send_state(self, world: World) -> None:
        """``irs/<robot>/sim/state``: what the robot is doing and where it truly is."""
        self._state_seq += 1
        header = {"schema": "irs/sim/state/1", "seq": self._state_seq, "frame": "map", "stamp_ns": world.now_ns}
        self._state.put(json.dumps({**header, **world.state()}).encode())

    def new_waypoints(self) -> list[list[float]] | None:
        """The latest waypoints that came since the last call; None when none did. Bad documents are logged and dropped."""
        for sample in reversed(self._waypoints.drain()):
            try:
                return _parse_waypoints(sample.payload)
            except ValueError as error:
                _log.warning("waypoints dropped: %s", error)
        return None

    def close(self) -> None:
        """Ends the subscription and publishers."""
        for handle in (self._subscription, self._state, *self._publishers.values()):
            handle.close()

    def _declare(self, message: WorldMessage) -> Publisher:
        key = bridge_key(message.topic)
        if message.topic == TF_TOPIC:  # TRANSIENT_LOCAL on ROS: late subscribers get it
            return self._session.history_publisher(key, encoding=CDR, keep=1)
        encoding = JSON if message.topic == DETECTIONS_TOPIC else CDR
        return self._session.publisher(key, encoding=encoding, block=False)


def _parse_waypoints(payload: bytes) -> list[list[float]]:
    """[[x, y, yaw], ..] of an ``irs/nav/waypoints/1`` document. Raises ValueError saying what is wrong."""
    document: Any = json.loads(payload)
    points = document.get("waypoints") if isinstance(document, dict) else None
    if not isinstance(points, list):
        raise ValueError("no list of waypoints")
    for point in points:
        if not isinstance(point, list) or len(point) != 3 or not all(isinstance(v, (int, float)) for v in point):
            raise ValueError(f"{point!r} is not [x, y, yaw]")
    return [[float(v) for v in point] for point in points]


def run(world: World, link: Robot2Zenoh, duration_s: float | None, stopper: Stopper) -> None:
    """Lets the world go on in real time until stopped. Late by more than half a second, time slips instead of racing."""
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
            _log.info("%d waypoints received" if waypoints else "stop received (%d waypoints)", len(waypoints))
            world.follow(waypoints)
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


@click.command()
@click.option(
    "--seed", default=1, show_default=True, help="Which building; the same seed is the same building and noise."
)
@click.option("--robot", default="robot", show_default=True, help="Name of the robot in the keys irs/<robot>/...")
@click.option("--endpoint", default=None, help="Where irsd listens (default: IRSD_ENDPOINT or its default).")
@click.option("--speed", default=1.0, show_default=True, type=click.FloatRange(0.1, 1.5), help="Top speed in m/s.")
@click.option(
    "--duration", default=None, type=click.FloatRange(min=0), help="Seconds until it ends (default: for ever)."
)
@click.option("--no-explore", is_flag=True, help="Stand and wait for waypoints instead of exploring first.")
@click.option(
    "--record", type=click.Path(dir_okay=False, path_type=Path), help="Also write all messages to this MCAP file."
)
@click.option(
    "--truth", type=click.Path(dir_okay=False, path_type=Path), help="Write the ground truth to this JSON file."
)
def main(
    seed: int,
    robot: str,
    endpoint: str | None,
    speed: float,
    duration: float | None,
    no_explore: bool,
    record: Path | None,
    truth: Path | None,
) -> None:
    """A furnished building with a robot in it: LiDAR, camera, odometry and detections on zenoh, as ROS 2 CDR.

    The robot explores every room, then waits for waypoints on irs/<robot>/nav/waypoints.
    """
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(name)s %(levelname)s %(message)s")
    stopper = Stopper()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda signum, _frame: stopper.request(f"signal {signum}"))
    try:
        settings = with_speed(WorldSettings(), speed)
        world = World(seed, settings, explore=not no_explore, start_ns=wall_clock_ns())
        if truth is not None:
            truth.write_text(json.dumps(truth_document(world.building), indent=1) + "\n")
        with ExitStack() as stack:
            recording = stack.enter_context(RecordingWriter(record)) if record is not None else None
            session = stack.enter_context(open_session(with_environment(ZenohSettings(), endpoint)))
            link = Robot2Zenoh(session, robot, recording)
            stack.callback(link.close)
            _log.info("world %d is up: %s", seed, ", ".join(room.label for room in world.building.rooms))
            run(world, link, duration, stopper)
    except (IrsdError, OSError, ValueError) as error:
        raise click.ClickException(str(error)) from error


if __name__ == "__main__":
    main()
