"""The embedded world in simulated time: a building, a robot in it, and every message its sensors would send.

Nothing here knows zenoh or the wall clock: ``step`` returns the messages that became due, so that a whole drive can be computed
faster than real time, and the same seed and calls give the same bytes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from irsd.core.geometry import matrix_to_quat_xyzw, pose_from_xy_yaw
from irsd.core.types import OdomSample
from irsd.sensors.encode import (
    encode_camera_info,
    encode_compressed_image,
    encode_detections,
    encode_odometry,
    encode_pointcloud2,
    encode_tf,
)
from irsd.sim.building import Building, make_building
from irsd.sim.detector import Detector, DetectorSettings
from irsd.sim.drive import Command, LookTask, PathTask, exploring_tour
from irsd.sim.parts import Item
from irsd.sim.rearrange import Walk, made, shifted, thing_of, with_thing, without
from irsd.sim.robot import Robot, RobotSettings, steer_clear
from irsd.sim.sensors import CAMERA_FRAME, CameraSettings, Eyes, LidarSettings, mountings

LIDAR_TOPIC, ODOM_TOPIC, TF_TOPIC = "/lidar/points", "/odom", "/tf_static"
IMAGE_TOPIC, INFO_TOPIC = "/camera/image/compressed", "/camera/camera_info"
IDS_TOPIC, DETECTIONS_TOPIC = "/detections/ids", "/detections/info"
JSON_TYPE = "json"
DEFAULT_START_NS = 1_700_000_000 * 10**9

_TICK_NS = 20_000_000
_IMAGE_TYPE = "sensor_msgs/msg/CompressedImage"


class WorldMessage(NamedTuple):
    """A message as the robot would send it. data: CDR, or JSON where type_name is ``json``."""

    topic: str
    type_name: str
    data: bytes
    log_time_ns: int


@dataclass(frozen=True, slots=True)
class WorldSettings:
    """Rates and settings of the parts. yaw_rad turns the building about the start; detections: whether a simulated detector looks at
    the pictures, too; detector_latency_s: how late detections are."""

    robot: RobotSettings = field(default_factory=RobotSettings)
    lidar: LidarSettings = field(default_factory=LidarSettings)
    camera: CameraSettings = field(default_factory=CameraSettings)
    detector: DetectorSettings = field(default_factory=DetectorSettings)
    camera_period_s: float = 0.2
    odometry_period_s: float = 0.04
    tf_period_s: float = 2.0
    detections: bool = True
    detector_latency_s: float = 0.1
    look_rad_s: float = 1.5
    yaw_rad: float = 0.0


class World:
    """The single owner of the world's state. ``sensing=False`` leaves out rays and messages (to test driving quickly)."""

    def __init__(
        self,
        seed: int,
        settings: WorldSettings | None = None,
        *,
        explore: bool = True,
        start_ns: int = DEFAULT_START_NS,
        sensing: bool = True,
    ) -> None:
        self.settings = settings or WorldSettings()
        self.building = make_building(seed, yaw_rad=self.settings.yaw_rad)
        self.now_ns = self.start_ns = start_ns
        self.robot = Robot(self.building.obstacles, self.settings.robot, np.random.default_rng([seed, 1]))
        self.waypoints_stuck = 0
        self._seed = seed
        self._eyes = Eyes(self.building, self.settings.lidar, self.settings.camera) if sensing else None
        self._detector = Detector(self.building.things, self.settings.detector)
        self._tour = list(exploring_tour(self.building)) if explore else []
        self._tour_work = max(sum(self._work_s(leg.length_m, leg.turn_rad) for leg in self._tour), 1e-9)
        self._tasks: list[PathTask | LookTask] = []
        self.map_T_odom = (0.0, 0.0, 0.0)  # (x_m, y_m, yaw_rad), as the robot's localisation says
        self._way: PathTask | None = None
        self._way_frame = "map"
        self._trail: list[tuple[int, float, float, float]] = [(start_ns, 0.0, 0.0, 0.0)]
        self._due = dict.fromkeys(("lidar", "camera", "odometry", "tf"), start_ns)
        self._due["lidar"] += _ns(self.settings.lidar.period_s)
        self._due["camera"] += _ns(self.settings.lidar.period_s / 2)  # not both at once: shorter pauses in between
        self._late: list[WorldMessage] = []
        self._shots = 0
        self._last_id = max(thing.id for thing in self.building.things)
        self._walks: list[Walk] = []

    # ------------------------------------------------------------------------------------------------- what to do
    @property
    def phase(self) -> str:
        """exploring | idle | driving"""
        if self._way is not None:
            return "driving"
        return "exploring" if self._tour or self._tasks else "idle"

    @property
    def progress(self) -> float:
        """Share of the exploring tour that is done, 0..1 (1 without a tour)."""
        left = sum(self._work_s(leg.length_m, leg.turn_rad) for leg in self._tour)
        for task in self._tasks:
            if isinstance(task, PathTask):
                left += self._work_s(task.remaining_m, 0.0)
            else:
                left += self._work_s(0.0, task.remaining_rad)
        return float(np.clip(1.0 - left / self._tour_work, 0.0, 1.0)) if self._tour or self._tasks else 1.0

    def start_at(self, stamp_ns: int) -> None:
        """Sets the clock of a world in which no time has passed yet. Raises ValueError for any other."""
        if self.now_ns != self.start_ns:
            raise ValueError("the world's clock can only be set before its first step")
        shift_ns = stamp_ns - self.start_ns
        self.now_ns = self.start_ns = stamp_ns
        self._due = {what: due_ns + shift_ns for what, due_ns in self._due.items()}
        self._trail = [(stamp_ns, 0.0, 0.0, 0.0)]

    def follow(self, waypoints: Sequence[Sequence[float]], frame: str = "map") -> None:
        """Follow (x, y, yaw) waypoints in a frame, map or odom, instead of whatever was going on; an empty list stops.

        As on a real robot the way is followed by odometry and ``map_T_odom``, never by the true pose. Ends the exploring tour.
        """
        self._tour, self._tasks, self._way, self._way_frame = [], [], None, frame
        if len(waypoints):
            way = np.array([list(map(float, point)) for point in waypoints])
            path = np.vstack([self._believed()[:2], way[:, :2]])
            self._way = PathTask(path, float(way[-1, 2]), self.settings.robot.speed_m_s)

    # ------------------------------------------------------------------------------------------------- what changes
    def remove(self, thing_id: int) -> None:
        """A thing is carried away. ValueError for what is not there or part of the shell."""
        self._renew(without(self.building, thing_id))

    def place(self, item: Item, x_m: float, y_m: float, z_m: float = 0.0, yaw_rad: float = 0.0) -> int:
        """Another thing is brought; returns its id. ValueError where the robot stands in the way."""
        self._last_id += 1
        thing, body = made(self.building, self._last_id, item, (x_m, y_m, z_m, yaw_rad))
        self._renew(with_thing(self.building, thing, body, self.robot.pose[:2]))
        return thing.id

    def move(self, thing_id: int, x_m: float, y_m: float, z_m: float | None = None, turn_rad: float = 0.0) -> None:
        """A thing is put elsewhere: its middle at (x, y), its lowest point at z (None: as before), turned about its middle."""
        old_z = float(thing_of(self.building, thing_id).aabb_min_m[2])
        thing, body = shifted(self.building, thing_id, (x_m, y_m, old_z if z_m is None else z_m), turn_rad)
        self._renew(with_thing(without(self.building, thing_id), thing, body, self.robot.pose[:2]))

    def walk(self, item: Item, path_xy: Sequence[Sequence[float]], speed_m_s: float = 1.0) -> int:
        """Somebody walks along a path, seen by the sensors, and is out of sight at its end; returns their id."""
        self._last_id += 1
        thing, body = made(self.building, self._last_id, item, (0.0, 0.0, 0.0, 0.0))
        self._walks.append(Walk(thing, body, np.array(path_xy, np.float64), speed_m_s, self.now_ns))
        self._detector.renew((*self.building.things, *(walk.thing for walk in self._walks)))
        return thing.id

    def _renew(self, building: Building) -> None:
        self.building = building
        self.robot.obstacles = building.obstacles
        self._detector.renew((*building.things, *(walk.thing for walk in self._walks)))
        if self._eyes is not None:
            self._eyes.renew(building)

    def _walk_on(self, eyes: Eyes) -> None:
        for walk in self._walks:
            eyes.show(walk.thing.id, walk.body, walk.place(self.now_ns))
        self._walks = [walk for walk in self._walks if walk.place(self.now_ns) is not None]

    def state(self) -> dict[str, Any]:
        """What ``irs/<robot>/sim/state`` says besides its header."""
        return {
            "phase": self.phase,
            "progress": round(self.progress, 3),
            "true_pose": self.robot.pose.round(4).tolist(),
            "odom_pose": self.robot.odometry.round(4).tolist(),
            "collisions": self.robot.collisions,
            "stuck": self.waypoints_stuck,
        }

    # ------------------------------------------------------------------------------------------------- time passes
    def step(self, dt_s: float) -> list[WorldMessage]:
        """Lets dt_s pass (rounded up to 20 ms ticks); the messages that became due, oldest first."""
        out: list[WorldMessage] = []
        end_ns = self.now_ns + _ns(dt_s)
        if self.now_ns == self.start_ns:
            out += self._messages_due()
        while self.now_ns < end_ns:
            self.now_ns += _TICK_NS
            dt = _TICK_NS * 1e-9
            wanted = self._wanted(dt)
            speed, turn = steer_clear(self.building.space, self.robot.pose, wanted.speed_m_s, wanted.turn_rad_s)
            self.robot.move(speed, turn, dt)
            x, y, yaw = self.robot.pose.tolist()
            self._trail.append((self.now_ns, x, y, yaw))
            del self._trail[:-64]
            out += self._messages_due()
        return out

    def _wanted(self, dt_s: float) -> Command:
        """The task's command; the next task where one is done."""
        if self._way is not None:
            command = self._way.command(self._believed(), dt_s)
            if command.done:
                self._way = None
                self.waypoints_stuck += command.stuck
            return command
        while True:
            if not self._tasks:
                if not self._tour:
                    return Command(0.0, 0.0)
                leg = self._tour.pop(0)
                speed = self.settings.robot.speed_m_s
                if len(leg.path_xy) > 1:
                    self._tasks.append(PathTask(leg.path_xy, None, speed))
                self._tasks.append(LookTask(leg.turn_rad, self.settings.look_rad_s))
            command = self._tasks[0].command(self.robot.pose, dt_s)
            if not command.done:
                return command
            self._tasks.pop(0)

    def _believed(self) -> NDArray[np.float64]:
        """Where the robot thinks it is, in the frame of its way: (x, y, unwrapped yaw)."""
        if self._way_frame == "odom":
            return self.robot.odometry
        x, y, yaw = self.map_T_odom
        c, s = np.cos(yaw), np.sin(yaw)
        ahead, left, turned = self.robot.odometry
        return np.array([x + c * ahead - s * left, y + s * ahead + c * left, yaw + turned])

    def _work_s(self, length_m: float, turn_rad: float) -> float:
        return length_m / self.settings.robot.speed_m_s + abs(turn_rad) / self.settings.look_rad_s

    # ------------------------------------------------------------------------------------------------- messages
    def _messages_due(self) -> list[WorldMessage]:
        if self._eyes is None:
            return []
        settings = self.settings
        out: list[WorldMessage] = []
        if self._is_due("tf", settings.tf_period_s):
            out.append(
                WorldMessage(TF_TOPIC, "tf2_msgs/msg/TFMessage", encode_tf(mountings(), self.now_ns), self.now_ns)
            )
        if self._is_due("odometry", settings.odometry_period_s):
            out.append(self._odometry())
        if self._is_due("lidar", settings.lidar.period_s):
            out.append(self._scan(self._eyes))
        if self._is_due("camera", settings.camera_period_s):
            out += self._picture(self._eyes)
        ready = [m for m in self._late if m.log_time_ns <= self.now_ns]
        self._late = [m for m in self._late if m.log_time_ns > self.now_ns]
        return out + ready

    def _is_due(self, what: str, period_s: float) -> bool:
        if self.now_ns < self._due[what]:
            return False
        self._due[what] += _ns(period_s)
        return True

    def _odometry(self) -> WorldMessage:
        x, y, yaw = self.robot.odometry
        quat = matrix_to_quat_xyzw(pose_from_xy_yaw(x, y, yaw)[:3, :3])
        sample = OdomSample(self.now_ns, "odom", "base_link", np.array([x, y, 0.0]), quat)
        data = encode_odometry(sample, (self.robot.speed_m_s, 0.0, 0.0), (0.0, 0.0, self.robot.turn_rad_s))
        return WorldMessage(ODOM_TOPIC, "nav_msgs/msg/Odometry", data, self.now_ns)

    def _scan(self, eyes: Eyes) -> WorldMessage:
        """The turn that ends now; its header stamp is the turn's start."""
        stamp_ns = self.now_ns - _ns(self.settings.lidar.period_s)
        poses = self.true_poses(eyes.column_times_s(), stamp_ns)
        self._walk_on(eyes)
        rng = np.random.default_rng([self._seed, 2, (self.now_ns - self.start_ns) // _TICK_NS])
        phase = -np.pi + float(rng.uniform(0, 2 * np.pi / self.settings.lidar.columns))
        sweep = eyes.sweep(stamp_ns, poses, phase, rng)
        data = encode_pointcloud2(sweep.scan, sweep.intensity)
        return WorldMessage(LIDAR_TOPIC, "sensor_msgs/msg/PointCloud2", data, self.now_ns)

    def true_poses(self, offset_s: NDArray[np.float64], stamp_ns: int) -> NDArray[np.float64]:
        """[N, 3] true (x, y, yaw) at stamp + offset [N], from the last second's trail."""
        trail = np.array(self._trail, dtype=np.float64)
        trail[:, 0] = [(t - stamp_ns) * 1e-9 for t, *_ in self._trail]
        return np.column_stack([np.interp(offset_s, trail[:, 0], trail[:, k]) for k in (1, 2, 3)])

    def _picture(self, eyes: Eyes) -> list[WorldMessage]:
        """Picture and calibration now, detections when the detector has thought about it."""
        self._walk_on(eyes)
        self._shots += 1
        rng = np.random.default_rng([self._seed, 3, self._shots])
        exposure = eyes.expose(self.now_ns, pose_from_xy_yaw(*self.robot.pose.tolist()), rng)
        if self.settings.detections:
            detections = self._detector.detect(self.now_ns, CAMERA_FRAME, exposure.ids_px, rng)
            ids, info = encode_detections(detections)
            later_ns = self.now_ns + _ns(self.settings.detector_latency_s)
            self._late += [
                WorldMessage(IDS_TOPIC, _IMAGE_TYPE, ids, later_ns),
                WorldMessage(DETECTIONS_TOPIC, JSON_TYPE, info, later_ns),
            ]
        picture = encode_compressed_image(exposure.image)
        calibration = encode_camera_info(eyes.camera_model, self.now_ns)
        return [
            WorldMessage(IMAGE_TOPIC, _IMAGE_TYPE, picture, self.now_ns),
            WorldMessage(INFO_TOPIC, "sensor_msgs/msg/CameraInfo", calibration, self.now_ns),
        ]


def simulate(seed: int, duration_s: float, settings: WorldSettings | None = None) -> Iterator[WorldMessage]:
    """All messages of an exploring drive, as fast as they can be computed. The same arguments give the same bytes."""
    world = World(seed, settings)
    while world.now_ns < world.start_ns + _ns(duration_s):
        yield from world.step(_TICK_NS * 1e-9)


def with_speed(settings: WorldSettings, speed_m_s: float) -> WorldSettings:
    """The settings with another top speed."""
    return replace(settings, robot=replace(settings.robot, speed_m_s=speed_m_s))


def _ns(seconds: float) -> int:
    return round(seconds * 1e9)
