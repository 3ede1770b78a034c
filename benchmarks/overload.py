"""Ten times the rates, half a million points a sweep, four times the picture: what is dropped, held and late, and what after.

    python benchmarks/overload.py [--seconds 20]

Three phases of that length with one irsd: a normal robot (5 Hz sweeps of 10,000 points, 20 Hz odometry, 4 Hz detections of 640 x 480),
the overload (50 Hz sweeps of 500,000 points, 200 Hz odometry, 40 Hz detections of 2560 x 1920: what of it this machine can send), the
normal robot again. Bars: memory bounded (below 1.5 GB), every loss counted, lag back below 2 s without a restart.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from live_irsd import Live, running_irsd

from irsd.core.runtime import monotonic_s, sleep_s
from irsd.core.types import CameraModel, LidarScan, OdomSample, StaticTransform
from irsd.io import cdr
from irsd.io.session import CDR, JSON
from irsd.sensors.encode import encode_camera_info, encode_odometry, encode_pointcloud2, encode_tf


@dataclass(frozen=True)
class Load:
    name: str
    points: int
    width_px: int
    times: int


NORMAL, HEAVY = Load("normal", 10_000, 640, 1), Load("overload", 500_000, 2560, 10)


def room(points: int, seed: int) -> np.ndarray:
    """Points [N, 3] on the inner faces of a room of 8 x 6 x 2.6 m as seen from 1 m above its middle."""
    ray = np.random.default_rng(seed).normal(size=(points, 3))
    low, high = np.array([-4.0, -3.0, -1.0]), np.array([4.0, 3.0, 1.6])
    return (ray * np.where(ray > 0, high / ray, low / ray).min(1, keepdims=True)).astype(np.float32)


def detections(width_px: int) -> bytes:
    ids = np.zeros((width_px * 3 // 4, width_px), np.uint16)
    ids[width_px // 3 : width_px // 2, width_px // 3 : width_px // 2] = 1
    return cv2.imencode(".png", ids)[1].tobytes()


class Robot:
    """A robot that stands in its room, and sends as fast as it is told to, or as it can."""

    def __init__(self, live: Live) -> None:
        self._live, self.sent = live, dict.fromkeys(("lidar", "odom", "detections"), 0)
        mounts = []
        for child, quat in (("lidar", (0, 0, 0, 1)), ("camera", (-0.5, 0.5, -0.5, 0.5))):
            mount = np.eye(4)
            x, y, z, w = quat
            mount[:3, :3] = (
                cv2.Rodrigues(2 * np.arccos(w) * np.array([x, y, z]) / max(1e-9, np.sqrt(1 - w * w)))[0]
                if w < 1
                else np.eye(3)
            )
            mount[2, 3] = 1.0
            mounts.append(StaticTransform("base_link", child, mount))
        self._tf = live.session.history_publisher("tf_static", encoding=CDR, keep=2)
        self._tf.put(encode_tf(mounts))

    def run(self, load: Load, seconds: float) -> None:
        """Prints what came of it."""
        clouds = [room(load.points, seed) for seed in range(3)]
        picture = detections(load.width_px)
        matrix = np.array(
            [[0.6 * load.width_px, 0, load.width_px / 2], [0, 0.6 * load.width_px, load.width_px * 0.375], [0, 0, 1]]
        )
        camera = CameraModel("camera", load.width_px, load.width_px * 3 // 4, matrix, "plumb_bob", np.zeros(0))
        due = {"odom": 0.0, "lidar": 0.0, "detections": 0.0}
        period = {"odom": 0.05 / load.times, "lidar": 0.2 / load.times, "detections": 0.25 / load.times}
        began_s, before = monotonic_s(), dict(self.sent)
        rss_mb, lags, recovered_s, waiting, first = 0.0, [], None, {}, self._live.read()
        while (now_s := monotonic_s() - began_s) < seconds:
            for kind, due_s in due.items():
                if now_s >= due_s:
                    due[kind] = max(due_s + period[kind], now_s - 1.0)
                    self._send(kind, clouds[self.sent[kind] % 3], picture, camera)
            reading = self._live.read()
            rss_mb = max(rss_mb, reading.rss_mb)
            lag_s = reading.status.get("lag_s")
            if lag_s is not None:
                lags.append(lag_s)
                recovered_s = None if lag_s > 2.0 else recovered_s if recovered_s is not None else now_s
            for place, count in reading.status.get("queues", {}).items():
                waiting[place] = max(waiting.get(place, 0), count)
            sleep_s(0.002)
        last = self._live.read()
        drops = {k: v - first.status.get("drops", {}).get(k, 0) for k, v in last.status.get("drops", {}).items()}
        sent = {kind: round((self.sent[kind] - before[kind]) / seconds, 1) for kind in self.sent}
        print(f"{load.name}: sent per second {sent}")
        lag = (
            f"p50 {np.percentile(lags, 50):.2f} s, p95 {np.percentile(lags, 95):.2f} s"
            if lags
            else "no sweep in the graph yet"
        )
        print(f"  memory at most {rss_mb:.0f} MB; lag {lag}; below 2 s for good after {recovered_s} s")
        print(f"  most waiting {waiting}\n  dropped { ({k: v for k, v in drops.items() if v}) }")
        print(f"  faults {sorted({fault['code'] for fault in last.status.get('faults', [])})}", flush=True)

    def _send(self, kind: str, cloud: np.ndarray, picture: bytes, camera: CameraModel) -> None:
        put, stamp_ns = self._live.session.put, int(monotonic_s() * 1e9) + 10**15
        self.sent[kind] += 1
        if kind == "odom":
            pose = OdomSample(stamp_ns, "odom", "base_link", np.zeros(3), np.array([0, 0, 0, 1.0]))
            put("odom", encode_odometry(pose), encoding=CDR, block=False)
        elif kind == "lidar":
            put(
                "lidar/points", encode_pointcloud2(LidarScan(stamp_ns, "lidar", cloud, None)), encoding=CDR, block=False
            )
        else:
            data = np.frombuffer(picture, np.uint8)
            header = cdr.make_header(stamp_ns, "camera")
            info = {
                "stamp_ns": stamp_ns,
                "frame_id": "camera",
                "detections": [{"id": 1, "label": "television", "score": 0.8}],
            }
            put("camera/camera_info", encode_camera_info(camera, stamp_ns), encoding=CDR)
            put(
                "detections/ids",
                cdr.write(cdr.make(cdr.COMPRESSED_IMAGE, header=header, format="png", data=data)),
                block=False,
            )
            put("detections/info", json.dumps(info).encode(), encoding=JSON, block=False)


def main() -> int:
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--seconds", type=float, default=20.0)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name, running_irsd(Path(name)) as live:
        robot = Robot(live)
        for load in (NORMAL, HEAVY, NORMAL):
            robot.run(load, given.seconds)
        print("the same process all the time:", live.process.is_running())
    return 0


if __name__ == "__main__":
    sys.exit(main())
