"""What a thing is by its shape: an instance's point cloud to a vector in the text encoder's space.

The network is ours (``irsd/models/nano/shape_encoder.md``). Beside it lies ``shape_encoder.json``: how its cosines become
probabilities, and below which it does not know. ``features`` is what it is fed with, in training as here.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from irsd.core.errors import ModelError
from irsd.perception.models import Cancel, Session

__all__ = ["MEASURES", "MIN_POINTS", "POINTS", "UNKNOWN", "Calibration", "ShapeEncoder", "features", "grounded"]

POINTS = 256  # of a cloud, that the network sees
MEASURES = 12
MIN_POINTS = 4  # fewer say nothing of a shape
UNKNOWN = "object"  # the name for what the network does not know
_THIN_M = 0.02  # thinner than a voxel means nothing
_FOOT_M = 0.2  # what ends no higher above the floor stands on it: the map takes the lowest voxels of a foot for floor
_BARE_M = 0.03  # what ends lower has lost nothing
_LEG_M = 0.06  # so much of the lower end is drawn out down to the floor
_INPUTS, _OUTPUT = ("points", "measures"), "embedding"


def grounded(points: NDArray[np.floating], floor_z_m: float) -> NDArray[np.float32]:
    """The cloud [k, 3], its lower end drawn out to the floor where it ends just above: else legs are short and all boxes hover."""
    cloud = np.array(points, np.float32)
    z = cloud[:, 2] - np.float32(floor_z_m)
    low = float(np.quantile(z, 0.01))
    if _BARE_M < low < _FOOT_M:
        share = np.clip(1 - (z - low) / _LEG_M, 0, 1)
        cloud[:, 2] -= np.where(z < low, low - _THIN_M, (low - _THIN_M) * share).astype(np.float32)
    return cloud


def features(points: NDArray[np.floating], floor_z_m: float) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """A cloud [k, 3] (metres, z up, k >= MIN_POINTS) as (float32 [POINTS, 4], float32 [MEASURES]), however it is turned and placed.

    Columns: along the short and the long side of the smallest upright box, height from the middle, height above the floor, of
    POINTS points at even steps of the given order. Which way a side points is not told: training turns both at random.
    Measures: logarithms of short side, long side and height; lowest and highest z above the floor; logarithm of k; logarithms
    of two ratios; spread in the plan; mean height within the box; shares of points in its lowest and highest seventh.
    The box leaves out one point in a hundred at each end, because masks bleed.
    """
    cloud = np.asarray(points - np.array([0, 0, floor_z_m]), np.float32)
    turned, (short, long) = _along_sides(cloud[:, :2])
    low, high = (float(v) for v in np.quantile(cloud[:, 2], (0.01, 0.99)))
    height = max(high - low, _THIN_M)
    columns = np.column_stack([turned, cloud[:, 2] - (low + high) / 2, cloud[:, 2]])
    within = (cloud[:, 2] - low) / height
    measures = (
        *(np.log(short), np.log(long), np.log(height), low, high),
        *(np.log(len(cloud)) / 3, np.log(short / long), np.log(height / long), turned.std()),
        *(within.mean(), (within < 1 / 7).mean(), (within > 6 / 7).mean()),
    )
    chosen = np.linspace(0, len(cloud) - 1, POINTS).round().astype(np.int64)
    return np.asarray(columns[chosen], np.float32), np.array(measures, np.float32)


def _along_sides(xy: NDArray[np.float32]) -> tuple[NDArray[np.float32], tuple[float, float]]:
    """Plan points [k, 2] along (short, long) side of their smallest rectangle, from its middle; and the sides' lengths."""
    _, _, angle_deg = cv2.minAreaRect(np.ascontiguousarray(xy))
    angle = np.deg2rad(angle_deg)
    turned = xy @ np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]], np.float32)
    low, high = np.quantile(turned, (0.01, 0.99), axis=0)
    turned -= ((low + high) / 2).astype(np.float32)
    a, b = (max(float(v), _THIN_M) for v in high - low)
    return (turned[:, ::-1], (b, a)) if a > b else (turned, (a, b))


@dataclass(frozen=True, slots=True)
class Calibration:
    """How cosines are to be read: probabilities are softmax(scale * cosine) over the names in question with UNKNOWN among them;
    a best name below min_probability is not known."""

    scale: float
    min_probability: float

    @classmethod
    def load(cls, path: Path) -> Calibration:
        """From a JSON file. ModelError when it is missing or lacks a number."""
        try:
            values = json.loads(path.read_text(encoding="utf-8"))
            return cls(float(values["scale"]), float(values["min_probability"]))
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise ModelError(
                f"calibration {path} can't be read ({error!r}): it belongs beside its .onnx file"
            ) from None

    def probabilities(self, cosine: NDArray[np.float32]) -> NDArray[np.float32]:
        """float32 [n, m], rows sum to 1, for cosines [n, m] to m names."""
        scaled = self.scale * (cosine - cosine.max(1, keepdims=True))
        share = np.exp(scaled)
        return np.asarray(share / share.sum(1, keepdims=True), np.float32)


class ShapeEncoder:
    """Point clouds to unit vectors in the space of ``encoder.LabelEncoder``."""

    name = "shape_encoder"
    dimension = 384

    def __init__(self, path: Path, *, threads: int = 1, cancel: Cancel | None = None) -> None:
        """path: the .onnx file, with its calibration (.json) beside it. ModelError when either is missing or wrong."""
        self._session = Session(path, threads=threads, inputs=_INPUTS, outputs=(_OUTPUT,), cancel=cancel)
        self.calibration = Calibration.load(path.with_suffix(".json"))

    def encode(self, clouds: Sequence[NDArray[np.float32]], floor_z_m: float) -> NDArray[np.float32]:
        """float32 [n, 384], unit rows, for n clouds float32 [k, 3] in the map frame; floor_z_m: the floor's height there.

        A cloud of fewer than MIN_POINTS points gets a row of zeros: it is like nothing.
        """
        out = np.zeros((len(clouds), self.dimension), np.float32)
        for k, cloud in enumerate(clouds):
            if len(cloud) >= MIN_POINTS:
                # One cloud a run: int8 arithmetic takes its scale from all that is run together.
                inputs = features(grounded(cloud, floor_z_m), floor_z_m)
                feeds = {name: part[None] for name, part in zip(_INPUTS, inputs, strict=True)}
                ((out[k],),) = self._session.run(feeds, (_OUTPUT,))
        return out
