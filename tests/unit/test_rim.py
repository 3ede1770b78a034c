"""Evidence near the edges of masks, against a distance transform of the mask's own pixels."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from irsd.core.types import CameraModel, CameraView
from irsd.instances.rim import rim_weights
from irsd.instances.voxels import FULL

SIZE = 200
CAMERA = CameraModel(
    "camera", SIZE, SIZE, np.array([[100.0, 0, 99.5], [0, 100.0, 99.5], [0, 0, 1]]), "plumb_bob", np.zeros(0)
)


def weights(mask: NDArray[np.bool_], edge_px: float = 6.0, share: float = 0.8) -> NDArray[np.float64]:
    """Evidence of every pixel of a mask [200, 200] on a wall 2 m ahead, whose voxels of 2 cm are a pixel each; 0 outside."""
    row, column = np.nonzero(mask)
    points = np.stack([(column - 99.5) / 50, (row - 99.5) / 50, np.full(len(row), 2.0)], -1).astype(np.float32)
    view = CameraView(1, np.eye(4), CAMERA, None, None)
    rows, starts = np.arange(len(points), dtype=np.int32), np.array([0, len(points)], np.int64)
    out = np.zeros(mask.shape)
    out[row, column] = rim_weights(view, points, rows, starts, 0.02, edge_px, share) / FULL
    return out


def disc(x: float, y: float, radius: float) -> NDArray[np.bool_]:
    v, u = np.mgrid[:SIZE, :SIZE]
    return np.asarray((u - x) ** 2 + (v - y) ** 2 < radius**2)


def test_evidence_rises_with_the_distance_to_the_edge() -> None:
    mask = disc(90, 110, 25) | disc(120, 90, 20)
    got = weights(mask)
    inside = cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, 5)
    assert (got[inside > 8] == 1.0).all()
    rim = mask & (inside < 5)
    assert np.abs(got[rim] - np.minimum(inside[rim] / 6.0, 1.0)).max() < 0.75  # the raster's cells are two pixels
    assert np.abs(got[rim] - np.minimum(inside[rim] / 6.0, 1.0)).mean() < 0.3
    assert got[mask].min() > 0


def test_small_masks_keep_a_certain_core() -> None:
    got = weights(disc(100, 100, 4))
    assert got[100, 100] == 1.0
    assert got[got > 0].min() < 1.0


def test_the_border_of_the_picture_is_no_edge() -> None:
    mask = np.zeros((SIZE, SIZE), np.bool_)
    mask[60:140, 120:] = True
    got = weights(mask)
    assert (got[80:120, 140:] == 1.0).all()
    assert got[100, 121] < 0.6


def test_what_is_not_ahead_of_the_camera_is_taken_as_it_is() -> None:
    view = CameraView(1, np.eye(4), CAMERA, None, None)
    rows, starts = np.zeros(1, np.int32), np.array([0, 1, 1], np.int64)
    assert rim_weights(view, np.array([[0, 0, -1]], np.float32), rows, starts, 0.02, 6.0, 0.8).tolist() == [FULL]
