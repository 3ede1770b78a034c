"""LiDAR against camera: boxes before a wall, seen by a camera that sits right, or was knocked."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from irsd.core.types import CameraModel, CameraView, DeskewedScan, Detections, SyncedFrame
from irsd.ingest import IngestSettings, SensorDecoder
from irsd.sensors.alignment import AlignmentWatch
from irsd.sensors.replay import read_messages
from irsd.sensors.sync import Synchronizer, SyncSettings

CAMERA = CameraModel(
    "camera", 640, 480, np.array([[420.0, 0, 320], [0, 420.0, 240], [0, 0, 1]]), "plumb_bob", np.zeros(0)
)


def turned(yaw_deg: float, pitch_deg: float = 0.0) -> NDArray[np.float64]:
    out = np.eye(4)
    out[:3, :3] = cv2.Rodrigues(np.radians([pitch_deg, yaw_deg, 0.0]))[0]
    return out


def frame(seed: int) -> SyncedFrame:
    """Boxes 2 to 4 m away before a wall at 6 m: their masks, a little ragged, and 3000 points of what a LiDAR at the camera sees."""
    rng = np.random.default_rng(seed)
    ids = np.zeros((480, 640), np.uint16)
    depth = np.full((480, 640), 6.0)
    for number in range(1, 7):
        x, y = (int(v) for v in rng.integers((20, 60), (560, 380)))
        w, h = (int(v) for v in rng.integers(40, 110, 2))
        near = float(rng.uniform(2.0, 4.0))
        depth[y : y + h, x : x + w] = near
        ragged = rng.integers(-3, 4, 4)
        ids[max(0, y + ragged[0]) : y + h + ragged[1], max(0, x + ragged[2]) : x + w + ragged[3]] = number
    u, v = rng.integers((0, 0), (640, 480), (3000, 2)).T
    z = depth[v, u] + rng.normal(0, 0.02, 3000)
    points = np.stack([(u - 320) / 420 * z, (v - 240) / 420 * z, z], 1).astype(np.float32)
    numbers = np.unique(ids[ids > 0])
    count = len(numbers)
    seen = Detections(
        seed * 2 * 10**9,
        "camera",
        ids,
        numbers.astype(np.int32),
        np.ones(count, np.float32),
        ("box",) * count,
        ((("box", 1.0),),) * count,
        None,
    )
    view = CameraView(seed * 2 * 10**9, np.eye(4), CAMERA, seen, None)
    return SyncedFrame(seed, seed * 2 * 10**9, np.eye(4), DeskewedScan(seed * 2 * 10**9, points, np.zeros(3)), (view,))


def watched(yaw_deg: float, pitch_deg: float, views: int = 20) -> AlignmentWatch:
    watch = AlignmentWatch()
    for seed in range(views):
        one = frame(seed)
        watch = watch if seed else AlignmentWatch()
        watch._scans.clear()
        watch.look(replace(one, views=(replace(one.views[0], map_T_camera=turned(yaw_deg, pitch_deg)),)))
    return watch


@pytest.mark.parametrize(("yaw_deg", "pitch_deg"), [(0.0, 0.0), (0.5, -0.5)])
def test_a_mounting_that_is_right_is_no_fault(yaw_deg: float, pitch_deg: float) -> None:
    assert watched(yaw_deg, pitch_deg).findings == ()


@pytest.mark.parametrize(
    ("yaw_deg", "pitch_deg", "says"), [(3.0, 0.0, "in yaw"), (-2.0, 0.0, "in yaw"), (0.0, 3.0, "in pitch")]
)
def test_a_camera_that_was_knocked_is_found(yaw_deg: float, pitch_deg: float, says: str) -> None:
    (finding,) = watched(yaw_deg, pitch_deg).findings
    assert finding.code == "extrinsic_drift"
    assert says in finding.text


def test_a_few_views_say_nothing() -> None:
    assert watched(3.0, 0.0, views=8).findings == ()


def test_on_a_recording_with_noisy_masks(shared_data: Path) -> None:
    house = shared_data / "small_house"
    decoder, sync = SensorDecoder(IngestSettings()), Synchronizer(SyncSettings())
    right, knocked = AlignmentWatch(), AlignmentWatch()
    for message in read_messages([house / "small_house_short.mcap", house / "small_house.detections.mcap"]):
        for value in decoder.decode(message.topic, message.data):
            sync.push(value)
        for one in sync.pop():
            right.look(one)
            views = tuple(replace(view, map_T_camera=view.map_T_camera @ turned(3.0)) for view in one.views)
            knocked.look(replace(one, views=views))
    assert right.findings == ()
    assert "by +3 degrees in yaw" in knocked.findings[0].text
