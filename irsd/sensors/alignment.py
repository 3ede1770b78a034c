"""Whether LiDAR and camera still sit where their mountings say: does a mask hold one depth, as a thing does?

Turn the camera away from where it truly looks, and masks catch the wall behind their things: the spread of depths within masks grows.
As in J. Levinson and S. Thrun, "Automatic Online Calibration of Cameras and Lasers" (RSS 2013), a mounting is right when turning the
camera a little either way makes the fit worse; theirs compares edges, of which a sparse LiDAR and soft masks have too few.
"""

from __future__ import annotations

from collections import deque

import cv2
import numpy as np
from numpy.typing import NDArray

from irsd.core.faults import Finding
from irsd.core.geometry import invert, transform
from irsd.core.types import CameraModel, CameraView, SyncedFrame

_STEPS_DEG = (-4.0, -3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0, 4.0)
_SCANS = 5  # laid over each other: one sweep of a sparse LiDAR has too few points on a thing
_FAR = 0.5  # of the logarithm of depth; what is farther off is no worse
_VIEWS, _MIN_VIEWS = 40, 12
_MIN_POINTS = 100.0  # within masks, per view
_PERIOD_NS = 1_500_000_000
_LEAST_DEG = 1.5
_BETTER = 0.95  # what the spread must come to if the camera were turned, of what it is

Fit = NDArray[np.float64]
"""[axis, step, 2]: sum of the spread of log depth within masks, and points in them; axis 0 yaw, 1 pitch."""


def fit(view: CameraView, points_camera: NDArray[np.float32]) -> Fit:
    """The fit of points [N, 3] (optical frame) to a view's masks, with the camera turned by each of ``_STEPS_DEG`` about each axis."""
    assert view.detections is not None
    ids = view.detections.ids_px
    slots = int(ids.max()) + 1
    points_camera = _near_picture(points_camera, view.camera)
    out = np.zeros((2, len(_STEPS_DEG), 2))
    for axis in range(2):
        for step, angle_deg in enumerate(_STEPS_DEG):
            turn, _ = cv2.Rodrigues(np.radians([0.0, angle_deg, 0.0] if axis == 0 else [angle_deg, 0.0, 0.0]))
            pixels, depth = _seen(points_camera @ turn.T.astype(np.float32), view.camera)
            number = ids[pixels[:, 1], pixels[:, 0]]
            number, log_depth = number[number > 0], np.log(depth[number > 0])
            if not len(number):
                continue
            count = np.bincount(number, minlength=slots)
            mean = np.bincount(number, log_depth, slots) / np.maximum(count, 1)
            out[axis, step] = np.minimum(np.abs(log_depth - mean[number]), _FAR).sum(), len(number)
    return out


def _near_picture(points: NDArray[np.float32], camera: CameraModel) -> NDArray[np.float32]:
    """The points that a turn by the largest step can bring into the picture."""
    before = points[points[:, 2] > 0.3]
    margin = 1.5 * np.tan(np.radians(_STEPS_DEG[-1])) * camera.matrix[[0, 1], [0, 1]] + 0.05 * camera.width_px
    uv = before[:, :2] / before[:, 2:] * camera.matrix[[0, 1], [0, 1]] + camera.matrix[:2, 2]
    inside = ((uv > -margin) & (uv < margin + np.array([camera.width_px, camera.height_px]))).all(1)
    return np.asarray(before[inside], np.float32)


def _seen(points: NDArray[np.float32], camera: CameraModel) -> tuple[NDArray[np.intp], NDArray[np.float32]]:
    """Pixels [n, 2] and depths [n] of the points within the picture; distortion moves a point by less than what matters here."""
    before = points[points[:, 2] > 0.3]
    uv = before[:, :2] / before[:, 2:] * camera.matrix[[0, 1], [0, 1]] + camera.matrix[:2, 2]
    inside = ((uv > -0.5) & (uv < (camera.width_px - 0.5, camera.height_px - 0.5))).all(1)
    return np.rint(uv[inside]).astype(np.intp), before[inside, 2]


class AlignmentWatch:
    """Owner of the last sweeps and of the fits of the last views with masks. One thread looks; ``findings``: what it says since."""

    def __init__(self) -> None:
        self._scans: deque[NDArray[np.float32]] = deque(maxlen=_SCANS)
        self._fits: dict[str, deque[Fit]] = {}
        self._looked_ns: dict[str, int] = {}
        self.findings: tuple[Finding, ...] = ()

    def look(self, frame: SyncedFrame) -> None:
        """The views with masks in a frame, of each camera one in ``_PERIOD_NS``."""
        self._scans.append(frame.scan.points_map)
        for view in frame.views:
            name = view.camera.frame_id
            passed_ns = view.stamp_ns - self._looked_ns.get(name, view.stamp_ns - _PERIOD_NS)
            if view.detections is None or not len(view.detections.number) or 0 <= passed_ns < _PERIOD_NS:
                continue
            self._looked_ns[name] = view.stamp_ns
            points = transform(invert(view.map_T_camera), np.concatenate(list(self._scans)))
            found = fit(view, points.astype(np.float32, copy=False))
            if found[0, len(_STEPS_DEG) // 2, 1] >= _MIN_POINTS:
                self._fits.setdefault(name, deque(maxlen=_VIEWS)).append(found)
        self.findings = tuple(finding for name, fits in self._fits.items() if (finding := judge(name, list(fits))))


def judge(name: str, fits: list[Fit]) -> Finding | None:
    """What the fits of some views say together; None while they are few, or the mounting fits about as well as any other."""
    if len(fits) < _MIN_VIEWS:
        return None
    spread, points = np.moveaxis(np.sum(fits, axis=0), -1, 0)
    mean = spread / np.maximum(points, 1.0)
    axis, step = np.unravel_index(int(np.argmin(mean)), mean.shape)
    here, best, off_deg = float(mean[0, len(_STEPS_DEG) // 2]), float(mean[axis, step]), _STEPS_DEG[step]
    if abs(off_deg) < _LEAST_DEG or best > _BETTER * here:
        return None
    way = ("yaw", "pitch")[int(axis)]
    text = f"{name}: depths within masks spread by {here:.1%}, by {best:.1%} if it were turned by {off_deg:+.0f} degrees in {way}"
    return Finding("extrinsic_drift", name, text)
