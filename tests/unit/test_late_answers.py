"""What the eyes answer late is lifted where it was seen: with the pose and the map of its picture's time, not those of now."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from tiny_onnx import image_encoder

from irsd.config import PipelineSettings
from irsd.core.geometry import invert
from irsd.core.types import CameraImage, CameraModel, CameraView, DeskewedScan, SyncedFrame
from irsd.perception.budget import BudgetSettings, Stage
from irsd.perception.chain import Chain, ModelSet
from irsd.perception.encoder import LabelEncoder
from irsd.perception.families.clip import ClipImageEncoder
from irsd.perception.inline import InlineEyes
from irsd.perception.job import PerceptionResult, Sight
from irsd.perception.models import Session
from irsd.perception.roles import Boxes, Masks
from irsd.perception.settings import PerceptionSettings
from irsd.pipeline import MapPipeline

CAMERA = CameraModel(
    "camera", 160, 120, np.array([[120.0, 0, 80], [0, 120.0, 60], [0, 0, 1]]), "plumb_bob", np.zeros(0)
)
RED = (210, 30, 30)
CENTRE, HALF_M = np.array([2.0, 0.4, 0.5]), 0.25
MAP_R_OPTICAL = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])  # looking along x


class RedDetector:
    """The box of all that is red."""

    def detect(self, image_rgb: NDArray[np.uint8], prompts: tuple[str, ...]) -> Boxes:
        rows, columns = np.nonzero(image_rgb[..., 0] > 150)
        box = [[columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]] if len(rows) else []
        count = len(box)
        boxes = np.array(box, np.float32).reshape(-1, 4)
        return Boxes(boxes, np.full(count, 0.9, np.float32), np.zeros(count, np.int32))


class RedSegmenter:
    """All that is red."""

    def segment(self, image_rgb: NDArray[np.uint8], boxes_px: NDArray[np.float32]) -> Masks:
        return Masks(np.array([image_rgb[..., 0] > 150] * len(boxes_px)), np.ones(len(boxes_px), np.float32))


class LateEyes(InlineEyes):
    """Answers so many sweeps after the picture."""

    delay = 0

    def results(self) -> list[PerceptionResult]:
        self._late = [*getattr(self, "_late", []), *((0, r) for r in super().results())]
        due = [r for age, r in self._late if age >= self.delay]
        self._late = [(age + 1, r) for age, r in self._late if age < self.delay]
        return due


def no_boxes(boxes_px: NDArray[np.float32], sight: Sight, hw: tuple[int, int]) -> Masks:
    raise AssertionError("the segmenter always may run here")


def surface(low: np.ndarray, high: np.ndarray, step_m: float) -> NDArray[np.float32]:
    """Points on the faces of a box."""
    axes = [np.arange(a, b + 1e-6, step_m) for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    on_face = (np.abs(grid - low) < step_m / 2) | (np.abs(grid - high) < step_m / 2)
    return grid[on_face.any(1)].astype(np.float32)


WORLD = np.concatenate([
    surface(np.array([-1.0, -2.5, 0.0]), np.array([5.0, 2.5, 2.5]), 0.06),
    surface(CENTRE - HALF_M, CENTRE + HALF_M, 0.03),
])  # fmt: skip


def pose(rotation: np.ndarray, position: np.ndarray) -> NDArray[np.float64]:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = rotation, position
    return out


def frame(k: int) -> SyncedFrame:
    """The k-th sweep of a robot that drives sideways and turns, with a picture of the red cube."""
    map_T_base = pose(np.eye(3), np.array([-0.4, -0.05 * k, 0.0]))
    angle = -0.03 * k
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    map_T_camera = pose(turn @ MAP_R_OPTICAL, map_T_base[:3, 3] + [0, 0, 1.0])
    corners = CENTRE + HALF_M * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    seen = corners @ invert(map_T_camera)[:3, :3].T + invert(map_T_camera)[:3, 3]
    pixel = (seen @ CAMERA.matrix.T)[:, :2] / seen[:, 2:]
    bgr = np.full((120, 160, 3), 60, np.uint8)
    cv2.fillConvexPoly(bgr, cv2.convexHull(pixel.round().astype(np.int32)), RED[::-1])
    stamp_ns = k * 200_000_000
    view = CameraView(stamp_ns, map_T_camera, CAMERA, None, CameraImage(stamp_ns, "camera", bgr))
    rng = np.random.default_rng(k)
    points = WORLD + rng.normal(0, 0.003, WORLD.shape).astype(np.float32)
    return SyncedFrame(
        k, stamp_ns, map_T_base, DeskewedScan(stamp_ns, points, map_T_base[:3, 3] + [0, 0, 0.6]), (view,)
    )


def run(tmp_path: Path, labels: LabelEncoder, delay: int) -> dict[str, NDArray[np.float32]]:
    """Points of the things by label, after twelve sweeps and what was late."""
    encoder = ClipImageEncoder(Session(image_encoder(tmp_path / "e.onnx", np.eye(3, 8))), "colours", side_px=8)
    models = ModelSet(encoder, None, None, RedDetector(), RedSegmenter(), None, no_boxes, lambda: None, lambda: None)
    costs = {Stage.DETECT: (0.01, 0.0), Stage.SEGMENT: (0.01, 0.0), Stage.EMBED: (0.0, 0.001)}
    eyes = LateEyes(Chain(PerceptionSettings(), models, ("box",)), BudgetSettings(), costs)
    eyes.delay = delay
    pipeline = MapPipeline(PipelineSettings(), labels, map_id="test", eyes=eyes)
    for k in range(1, 16):
        pipeline.step(frame(k))
    result = pipeline.finish(16 * 200_000_000)
    arrays = pipeline.arrays()
    return {node.labels[0][0]: arrays[node.id].points_map for node in result.snapshot.instances}


@pytest.mark.parametrize("delay", [0, 5])
def test_a_late_answer_is_lifted_where_it_was_seen(tmp_path: Path, delay: int) -> None:
    things = run(tmp_path, LabelEncoder.load(), delay)
    assert list(things) == ["box"]
    off_m = np.abs(things["box"] - CENTRE).max(1)  # Chebyshev: the cube's faces are HALF_M away
    assert np.percentile(off_m, 95) < HALF_M + 0.05
    assert len(things["box"]) > 50
