"""Sensors that lie: each detector against streams that it must and must not find."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from irsd.core.faults import Finding
from irsd.core.geometry import make_pose
from irsd.core.types import CameraImage, LidarScan, OdomSample, Sensed, StaticTransform
from irsd.faults import ADVICE
from irsd.sensors.encode import encode_compressed_image, encode_odometry, encode_pointcloud2, encode_tf
from irsd.sensors.picture_health import judge_picture
from irsd.sensors.watch import SensorWatch, WatchSettings, clock_step_ns, cycle_of, mounting_change, odometry_step

NS = 1_000_000_000
START_NS = 1_700_000_000 * NS
UPRIGHT = np.array([0.0, 0.0, 0.0, 1.0])


def pose(t_s: float, x_m: float = 0.0, yaw_rad: float = 0.0) -> OdomSample:
    turn = np.array([0.0, 0.0, np.sin(yaw_rad / 2), np.cos(yaw_rad / 2)])
    return OdomSample(START_NS + round(t_s * NS), "odom", "base_link", np.array([x_m, 0.0, 0.0]), turn)


def scan(t_s: float, seed: int) -> LidarScan:
    points = np.random.default_rng(seed).normal(0, 3, (50, 3)).astype(np.float32)
    return LidarScan(START_NS + round(t_s * NS), "lidar", points, None)


class Stream:
    """A robot's second after second, told to a watch. Arrival times are the true time plus a delay."""

    def __init__(self, settings: WatchSettings | None = None) -> None:
        self.watch = SensorWatch(settings or WatchSettings())
        self.now_s = 0.0

    def hear(self, kind: str, value: Sensed, payload: bytes, delay_s: float = 0.0) -> None:
        self.watch.hear("/" + kind, kind, payload, round((self.now_s + delay_s) * NS), (value,))

    def odometry(self, sample: OdomSample, delay_s: float = 0.0) -> None:
        self.hear("odometry", sample, encode_odometry(sample), delay_s)

    def lidar(self, one: LidarScan, delay_s: float = 0.0) -> None:
        self.hear("lidar", one, encode_pointcloud2(one), delay_s)

    def ticks(self, seconds: float) -> Iterator[int]:
        for k in range(round(seconds * 10)):
            yield k
            self.now_s += 0.1

    def found(self) -> list[Finding]:
        self.watch.refresh(round(self.now_s * NS))
        return self.watch.findings(round(self.now_s * NS))

    def codes(self) -> set[str]:
        return {finding.code for finding in self.found()}


def test_a_healthy_robot_has_no_faults_standing_or_driving() -> None:
    stream = Stream()
    for k in stream.ticks(6):
        t_s = stream.now_s
        stream.odometry(pose(t_s, max(0.0, t_s - 3.0)))
        stream.lidar(scan(t_s, k), delay_s=0.05 + 0.03 * (k % 3))
        assert stream.found() == []


def test_a_frozen_lidar_is_found_within_three_seconds_and_forgotten_with_the_next_sweep() -> None:
    stream = Stream()
    for k in stream.ticks(5):
        stream.odometry(pose(stream.now_s))
        stream.lidar(scan(stream.now_s, min(k, 20)))  # from 2 s on it sends one sweep again and again, with new stamps
        if stream.now_s < 2.0:
            assert stream.codes() == set()
        if stream.now_s > 4.5:
            assert stream.codes() == {"sensor_frozen"}
    stream.lidar(scan(stream.now_s, 999))
    assert stream.codes() == set()


def test_frozen_odometry_repeats_its_stamp_and_a_standing_robot_does_not() -> None:
    stream = Stream()
    for _ in stream.ticks(3):
        stream.odometry(pose(0.0))
    assert "sensor_frozen" in stream.codes()


@pytest.mark.parametrize("jump_s", [3600.0, -3600.0, 5.0])
def test_a_clock_that_jumps_is_shown_for_a_while(jump_s: float) -> None:
    stream = Stream(WatchSettings(shown_s=4.0))
    for k in stream.ticks(12):
        ahead_s = jump_s if stream.now_s >= 2.0 else 0.0
        stream.odometry(pose(stream.now_s + ahead_s))
        stream.lidar(scan(stream.now_s + ahead_s, k), 0.05)
        if 2.3 < stream.now_s < 5.5:
            texts = [f.text for f in stream.found() if f.code == "time_jump"]
            assert len(texts) == 2
            assert f"{jump_s:+.1f} s" in texts[0]
    assert stream.codes() == set()


@given(st.lists(st.floats(0.0, 3.0), min_size=3, max_size=60), st.floats(0.02, 0.5))
def test_delay_alone_is_never_a_jump(delays_s: list[float], period_s: float) -> None:
    """A network that stalls and catches up: messages arrive in order, however late and bunched."""
    arrived_ns, before = 0, None
    for k, delay_s in enumerate(delays_s):
        stamp_ns = round(k * period_s * NS)
        arrived_ns = max(arrived_ns, stamp_ns + round(min(delay_s, 0.9) * NS))
        if before is not None:
            assert clock_step_ns((before[0], stamp_ns), (before[1], arrived_ns), NS) == 0
        before = (stamp_ns, arrived_ns)


def test_two_clocks_that_differ() -> None:
    stream = Stream()
    for k in stream.ticks(3):
        stream.odometry(pose(stream.now_s))
        stream.lidar(scan(stream.now_s - 0.8, k), 0.05)
    (finding,) = stream.found()
    assert (finding.code, finding.subject) == ("clock_offset", "/lidar")
    assert "-0.8" in finding.text
    for k in stream.ticks(4):  # corrected
        stream.odometry(pose(stream.now_s))
        stream.lidar(scan(stream.now_s, 100 + k), 0.05)
    assert stream.codes() == set()


def test_odometry_that_jumps() -> None:
    assert odometry_step(pose(0.0), pose(0.1, 0.2), 5.0) == ""
    assert odometry_step(pose(0.0), pose(2.0, 4.0), 5.0) == ""  # a gap in the odometry of a moving robot
    assert "moved 2.00 m in 0.10 s" in odometry_step(pose(0.0), pose(0.1, 2.0), 5.0)
    assert "turned 90 degrees" in odometry_step(pose(0.0), pose(0.1, 0.0, np.pi / 2), 5.0)
    stream = Stream(WatchSettings(shown_s=2.0))
    for _ in stream.ticks(1):
        stream.odometry(pose(stream.now_s))
    for _ in stream.ticks(1):
        stream.odometry(pose(stream.now_s, 3.0))
    assert stream.codes() == {"odometry_jump"}
    for _ in stream.ticks(2):
        stream.odometry(pose(stream.now_s, 3.0))
    assert stream.codes() == set()


def mount(parent: str, child: str, x_m: float = 0.0) -> StaticTransform:
    return StaticTransform(parent, child, make_pose(np.array([x_m, 0.0, 0.0]), UPRIGHT))


def test_mountings_that_disagree() -> None:
    assert mounting_change(mount("a", "b"), mount("a", "b", 0.001)) == ""
    assert "0.100 m" in mounting_change(mount("a", "b"), mount("a", "b", 0.1))
    assert "mounted on a and on c" in mounting_change(mount("a", "b"), mount("c", "b"))
    stream = Stream()
    for one in (mount("base", "lidar"), mount("base", "lidar", 0.3)):
        stream.hear("tf_static", one, encode_tf([one]))
    assert stream.codes() == {"tf_inconsistent"}


def test_mountings_in_a_circle() -> None:
    assert cycle_of({"a": "b", "b": "c"}, "a") == ()
    assert cycle_of({"a": "b", "b": "c", "c": "a"}, "a") == ("a", "b", "c")
    assert cycle_of({"x": "a", "a": "b", "b": "a"}, "x") == ()  # it hangs on a circle, and is none
    stream = Stream()
    for one in (mount("a", "b"), mount("b", "c"), mount("c", "a")):
        stream.hear("tf_static", one, encode_tf([one]))
    assert stream.codes() == {"tf_cycle"}
    back = mount("world", "a")
    stream.hear("tf_static", back, encode_tf([back]))
    assert "tf_cycle" not in stream.codes()


def picture(seed: int = 0, blur_px: float = 0.0, gain: float = 1.0) -> Any:
    """Boxes before a wall, with pixel noise: uint8 [480, 640, 3]."""
    rng = np.random.default_rng(seed)
    bgr = np.full((480, 640, 3), 150, np.uint8)
    for _ in range(25):
        x, y = (int(v) for v in rng.integers(0, (560, 400)))
        w, h = (int(v) for v in rng.integers(20, 160, 2))
        cv2.rectangle(bgr, (x, y), (x + w, y + h), tuple(int(v) for v in rng.integers(20, 240, 3)), -1)
    if blur_px:
        bgr = np.asarray(cv2.GaussianBlur(bgr, (0, 0), blur_px), np.uint8)
    noise = rng.normal(0, 2.0, bgr.shape)
    return np.clip(bgr * gain + noise, 0, 255).astype(np.uint8)


@pytest.mark.parametrize("seed", range(5))
def test_pictures(seed: int) -> None:
    assert judge_picture(picture(seed)) == ("", "")
    assert judge_picture(picture(seed, blur_px=1.0)) == ("", "")
    assert judge_picture(picture(seed, blur_px=8.0))[0] == "camera_blurred"
    assert judge_picture(picture(seed, gain=0.05))[0] == "camera_dark"
    plain = np.clip(np.random.default_rng(seed).normal(120, 2, (480, 640, 3)), 0, 255).astype(np.uint8)
    assert judge_picture(plain)[0] == "camera_covered"
    assert judge_picture(picture(seed)[:1, :1])[0] in ("", "camera_covered", "camera_dark")


def test_a_covered_camera_is_found_within_three_seconds_and_recovers() -> None:
    stream = Stream()
    cover = np.full((120, 160, 3), 90, np.uint8)
    for k in stream.ticks(8):
        bgr = picture(k)[::4, ::4] if not 2.0 <= stream.now_s < 5.0 else cover + (k % 2)
        image = CameraImage(START_NS + round(stream.now_s * NS), "camera", np.ascontiguousarray(bgr, np.uint8))
        stream.hear("image_compressed", image, encode_compressed_image(image, "png"))
        if 4.6 < stream.now_s < 5.0:
            assert stream.codes() == {"camera_covered"}
    assert stream.codes() == set()


def test_every_code_is_explained() -> None:
    for code in ("sensor_frozen", "time_jump", "clock_offset", "odometry_jump", "tf_inconsistent", "tf_cycle"):
        assert code in ADVICE
