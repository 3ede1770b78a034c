"""Brings the sensors together: every sweep with the robot's motion taken out, and the camera views with their poses.

A frame leaves when odometry encloses its whole sweep; camera views ride on the first frame that ends after them and knows their
pose, so detections may come seconds late. Nothing waits longer than ``max_wait_s`` of sensor time, every buffer is bounded, and
every message that is given up is counted. Single-threaded; knows no wall clock, so a recording gives the same frames every time.
"""

from __future__ import annotations

import bisect
from dataclasses import dataclass, replace

import numpy as np

from irsd.core.geometry import Pose
from irsd.core.settings import setting
from irsd.core.types import (
    CameraImage,
    CameraModel,
    CameraView,
    DeskewedScan,
    Detections,
    LidarScan,
    OdomSample,
    Sensed,
    SyncedFrame,
)
from irsd.sensors.motion import MountTree, PoseTrack, deskew

COUNTERS = (
    "frames",  # emitted
    "views",  # emitted with them
    "odometry_out_of_order",  # came after a newer one, used all the same
    "odometry_duplicate",
    "odometry_clock_reset",  # stamps went back by more than the buffer: everything buffered is void
    "scan_out_of_order",  # came after a newer one, used all the same
    "scan_late",  # older than a frame that has left, dropped
    "scan_duplicate",
    "scan_no_pose",  # odometry did not enclose it in time, dropped
    "scan_no_tf",  # no mounting of the LiDAR in time, dropped
    "scan_overflow",  # too many waiting, oldest dropped
    "view_no_pose",
    "view_no_tf",
    "view_no_camera",  # no CameraInfo with its frame in time, dropped
    "view_wrong_size",  # another aspect ratio than its CameraInfo says
    "view_overflow",
    "image_overflow",
    "image_unused",  # images are not wanted (keep_images is off)
    "tf_overflow",
)


@dataclass(frozen=True, slots=True)
class SyncSettings:
    """How long to wait for whom, and how much to hold meanwhile."""

    odom_buffer_s: float = setting(10.0, "poses kept, and so how late detections may come", lo=1.0, hi=120.0)
    max_wait_s: float = setting(
        1.0, "sensor time that a sweep or view waits for odometry, TF or CameraInfo", lo=0.05, hi=10.0
    )
    max_odom_gap_s: float = setting(
        0.5, "longest time between odometry samples that may be interpolated", lo=0.01, hi=5.0
    )
    max_pending_scans: int = setting(32, "sweeps that may wait", lo=1, hi=1000)
    max_pending_views: int = setting(48, "camera views that may wait", lo=1, hi=1000)
    max_pending_images: int = setting(4, "pictures among them that are held decoded", lo=1, hi=100)
    keep_images: bool = setting(False, "make views of pictures too; irsd does so by itself when it has eyes of its own")


@dataclass(frozen=True, slots=True)
class _Sweep:
    scan: LidarScan
    start_ns: int
    end_ns: int
    arrived_ns: int


@dataclass(frozen=True, slots=True)
class _View:
    stamp_ns: int
    frame_id: str
    arrived_ns: int
    detections: Detections | None
    image: CameraImage | None


@dataclass(frozen=True, slots=True)
class _Obstacle:
    """Why a message can't be used now. counter: which counter it falls under when it is given up; final: waiting won't help."""

    counter: str
    text: str
    final: bool = False


class Synchronizer:
    """Push decoded messages in the order they come, pop frames in the order of their end. Single writer of all sensor buffers.

    map_T_odom: where the odometry's frame lies in the map. A frame's ``stamp_ns`` and ``map_T_base`` are those of the sweep's end, so
    that all in it has happened by then; ``map_T_base`` is the pose of the odometry's child frame.
    """

    def __init__(self, settings: SyncSettings, map_T_odom: Pose | None = None) -> None:
        self._settings = settings
        self._map_T_odom: Pose = np.eye(4) if map_T_odom is None else map_T_odom
        self._track = PoseTrack(settings.odom_buffer_s)
        self._mounts = MountTree()
        self._cameras: dict[str, CameraModel] = {}
        self._sweeps: list[_Sweep] = []
        self._views: list[_View] = []
        self._base, self._odom_frame = "", "odom"
        self._now_ns = 0
        self._last: tuple[int, str] | None = None  # end and frame of the newest sweep that left
        self._lidar_seen = False
        self._seq = 0
        self._scan_obstacle: _Obstacle | None = None
        self._view_obstacle: _Obstacle | None = None
        self._given_up: dict[str, str] = {}  # sweep, view: why the newest one could not be placed, until one can
        self._counters = dict.fromkeys(COUNTERS, 0)

    # ------------------------------------------------------------------------------------------------ in
    def push(self, sensed: Sensed) -> None:
        """Takes one decoded message of any kind."""
        if isinstance(sensed, OdomSample):
            self._push_odometry(sensed)
        elif isinstance(sensed, LidarScan):
            self._push_scan(sensed)
        elif isinstance(sensed, Detections):
            self._push_view(sensed.stamp_ns, sensed.frame_id, detections=sensed)
        elif isinstance(sensed, CameraImage):
            if self._settings.keep_images:
                self._push_view(sensed.stamp_ns, sensed.frame_id, image=sensed)
            else:
                self._counters["image_unused"] += 1
        elif isinstance(sensed, CameraModel):
            self._cameras[sensed.frame_id] = sensed
        elif not self._mounts.push(sensed):
            self._counters["tf_overflow"] += 1

    def _push_odometry(self, sample: OdomSample) -> None:
        outcome = self._track.push(sample)
        if outcome != "kept":
            self._counters[f"odometry_{outcome}"] += 1
        if outcome == "clock_reset":
            self._sweeps.clear()
            self._views.clear()
            self._last = None
        self._base, self._odom_frame = sample.child_frame_id, sample.frame_id or "odom"
        self._advance_clock(sample.stamp_ns)

    def _push_scan(self, scan: LidarScan) -> None:
        start_ns = end_ns = scan.stamp_ns
        if scan.time_offset_s is not None and scan.time_offset_s.size:
            # float32 holds whole microseconds: its rounding must not push the end past the pose taken at that instant
            start_ns += round(float(scan.time_offset_s.min()) * 1e6) * 1000
            end_ns += round(float(scan.time_offset_s.max()) * 1e6) * 1000
        self._lidar_seen = True
        self._advance_clock(end_ns)
        if self._last is not None and end_ns < self._last[0]:
            self._counters["scan_late"] += 1
            return
        at = bisect.bisect_left(self._sweeps, end_ns, key=lambda sweep: sweep.end_ns)
        same = any(s.end_ns == end_ns and s.scan.frame_id == scan.frame_id for s in self._sweeps[at : at + 8])
        if same or self._last == (end_ns, scan.frame_id):
            self._counters["scan_duplicate"] += 1
            return
        self._counters["scan_out_of_order"] += at < len(self._sweeps)
        self._sweeps.insert(at, _Sweep(scan, start_ns, end_ns, self._now_ns))
        if len(self._sweeps) > self._settings.max_pending_scans:
            del self._sweeps[0]
            self._counters["scan_overflow"] += 1

    def _push_view(
        self, stamp_ns: int, frame_id: str, detections: Detections | None = None, image: CameraImage | None = None
    ) -> None:
        """Joins the half of a view that is waiting already, or starts a new one; keeps within the bounds."""
        at = next((k for k, v in enumerate(self._views) if (v.stamp_ns, v.frame_id) == (stamp_ns, frame_id)), None)
        if at is not None:
            old = self._views[at]
            self._views[at] = replace(old, detections=detections or old.detections, image=image or old.image)
        else:
            bisect.insort(
                self._views, _View(stamp_ns, frame_id, self._now_ns, detections, image), key=lambda v: v.stamp_ns
            )
        with_image = [k for k, v in enumerate(self._views) if v.image is not None]
        if len(with_image) > self._settings.max_pending_images:
            self._counters["image_overflow"] += 1
            oldest = self._views.pop(with_image[0])
            if oldest.detections is not None:
                self._views.insert(with_image[0], replace(oldest, image=None))
        if len(self._views) > self._settings.max_pending_views:
            del self._views[0]
            self._counters["view_overflow"] += 1

    def _advance_clock(self, stamp_ns: int) -> None:
        """Sensor time: the newest LiDAR or odometry stamp; a stamp that is off by more than the buffer sets it anew."""
        if stamp_ns > self._now_ns or stamp_ns < self._now_ns - self._settings.odom_buffer_s * 1e9:
            self._now_ns = stamp_ns

    # ------------------------------------------------------------------------------------------------ out
    def pop(self) -> list[SyncedFrame]:
        """The frames that became complete, oldest first."""
        frames: list[SyncedFrame] = []
        while self._sweeps:
            sweep = self._sweeps[0]
            obstacle = self._obstacle(sweep.scan.frame_id, sweep.start_ns, sweep.end_ns, "scan")
            if obstacle is not None:
                self._scan_obstacle = obstacle
                if not (obstacle.final or self._waited_enough(sweep.arrived_ns)):
                    break
                self._counters[obstacle.counter] += 1
                self._given_up["sweep"] = obstacle.text
            else:
                self._scan_obstacle = None
                self._given_up.pop("sweep", None)
                frames.append(self._frame(sweep))
            del self._sweeps[0]
        return frames

    def flush(self) -> list[SyncedFrame]:
        """At the end of the input: what can still leave. Views after the last sweep get a frame with no points."""
        frames = self.pop()
        for sweep in self._sweeps:
            obstacle = self._obstacle(sweep.scan.frame_id, sweep.start_ns, sweep.end_ns, "scan")
            if obstacle is None:
                frames.append(self._frame(sweep))
            else:
                self._counters[obstacle.counter] += 1
        self._sweeps.clear()
        if self._views and self._track:
            end_ns = max(self._track.last_ns, self._last[0] if self._last else 0)
            views = self._take_views(end_ns, give_up=True)
            if views and self._track.covers(end_ns, end_ns):
                map_T_base = self._map_T_base(np.array([end_ns], np.int64))[0]
                nothing = DeskewedScan(end_ns, np.zeros((0, 3), np.float32), map_T_base[:3, 3].copy())
                frames.append(self._numbered(end_ns, map_T_base, nothing, views))
        return frames

    def blocked_by(self) -> str | None:
        """Which sensor keeps frames or views from leaving, in words, or None while all is well."""
        silent = [name for name, seen in (("lidar", self._lidar_seen), ("odometry", bool(self._track))) if not seen]
        if silent:
            return f"{', '.join(silent)}: nothing received yet"
        if self._scan_obstacle is not None:
            return self._scan_obstacle.text
        if self._last is not None and not self._sweeps:
            quiet_s = (self._now_ns - self._last[0]) * 1e-9
            if quiet_s > self._settings.max_wait_s:
                return f"lidar: last sweep {quiet_s:.1f} s ago"
        return None if self._view_obstacle is None else self._view_obstacle.text

    def obstacles(self) -> list[str]:
        """What sweeps and views wait for in vain, in words: ``tf_static: ...``, ``camera_info: ...`` or ``odometry: ...``.

        Waiting for the next pose is none: only what a measurement was given up for, until one gets through.
        """
        return list(self._given_up.values())

    def counters(self) -> dict[str, int]:
        """Everything that was emitted, out of order or given up; the keys are ``COUNTERS``."""
        return dict(self._counters)

    # ------------------------------------------------------------------------------------------------ parts
    def _obstacle(self, frame_id: str, start_ns: int, end_ns: int, who: str) -> _Obstacle | None:
        """What keeps a measurement of ``frame_id`` over start..end from being placed in the map, or None."""
        no_pose = f"{who}_no_pose"
        if not self._track:
            return _Obstacle(no_pose, "odometry: nothing received yet")
        behind_s = (end_ns - self._track.last_ns) * 1e-9
        if behind_s > 0:
            text = f"odometry: newest pose is {behind_s:.3f} s older than the {who}"
            return _Obstacle(no_pose, text, final=behind_s > self._settings.odom_buffer_s)
        if start_ns < self._track.first_ns:
            ahead_s = (self._track.first_ns - start_ns) * 1e-9
            return _Obstacle(no_pose, f"odometry: oldest pose is {ahead_s:.3f} s newer than the {who}", final=True)
        gap_s = self._track.widest_gap_ns(start_ns, end_ns) * 1e-9
        if gap_s > self._settings.max_odom_gap_s:
            return _Obstacle(no_pose, f"odometry: {gap_s:.2f} s without a pose")
        if self._mounts.find(self._base, frame_id) is None:
            return _Obstacle(f"{who}_no_tf", f"tf_static: no chain from {self._base} to {frame_id or '(empty)'}")
        return None

    def _waited_enough(self, arrived_ns: int) -> bool:
        return self._now_ns - arrived_ns > self._settings.max_wait_s * 1e9

    def _map_T_base(self, stamps_ns: np.ndarray) -> np.ndarray:
        return np.asarray(self._map_T_odom @ self._track.poses(stamps_ns), np.float64)

    def _frame(self, sweep: _Sweep) -> SyncedFrame:
        """The sweep in the map frame with the views that are due; ``_obstacle`` must be None."""
        scan = sweep.scan
        base_T_sensor = self._mounts.find(self._base, scan.frame_id)
        assert base_T_sensor is not None
        knots_ns = self._track.knots(sweep.start_ns, sweep.end_ns)
        map_T_base = self._map_T_base(knots_ns)
        map_T_sensor = np.asarray(map_T_base @ base_T_sensor, np.float64)
        times_s = np.zeros(len(scan.points_sensor), np.float32) if scan.time_offset_s is None else scan.time_offset_s
        points_map = deskew(scan.points_sensor, times_s, (knots_ns - scan.stamp_ns) / 1e9, map_T_sensor)
        self._last = (sweep.end_ns, scan.frame_id)
        deskewed = DeskewedScan(sweep.end_ns, points_map, map_T_sensor[:, :3, 3].mean(0))
        return self._numbered(sweep.end_ns, map_T_base[-1], deskewed, self._take_views(sweep.end_ns))

    def _numbered(
        self, stamp_ns: int, map_T_base: Pose, scan: DeskewedScan, views: tuple[CameraView, ...]
    ) -> SyncedFrame:
        self._seq += 1
        self._counters["frames"] += 1
        self._counters["views"] += len(views)
        return SyncedFrame(self._seq, stamp_ns, map_T_base, scan, views, self._odom_frame)

    def _take_views(self, end_ns: int, *, give_up: bool = False) -> tuple[CameraView, ...]:
        """Removes and returns the views up to ``end_ns`` that can be placed; gives up those that waited long enough."""
        taken: list[CameraView] = []
        waiting: list[_View] = []
        for view in self._views:
            made = self._view(view) if view.stamp_ns <= end_ns else None
            if isinstance(made, CameraView):
                taken.append(made)
                self._view_obstacle = None
                self._given_up.pop("view", None)
            elif made is None and not give_up:
                waiting.append(view)
            else:
                self._view_obstacle = obstacle = made or _Obstacle("view_no_pose", "odometry: ended before the view")
                if give_up or obstacle.final or self._waited_enough(view.arrived_ns):
                    self._counters[obstacle.counter] += 1
                    self._given_up["view"] = obstacle.text
                else:
                    waiting.append(view)
        self._views = waiting
        return tuple(taken)

    def _view(self, view: _View) -> CameraView | _Obstacle:
        """The view with its camera and pose, or why not."""
        camera = self._cameras.get(view.frame_id)
        if camera is None and not view.frame_id and len(self._cameras) == 1:
            camera = next(iter(self._cameras.values()))
        if camera is None:
            return _Obstacle("view_no_camera", f"camera_info: none for frame {view.frame_id or '(empty)'}")
        pixels = view.detections.ids_px if view.detections is not None else view.image.bgr if view.image else None
        assert pixels is not None
        fitted = _fitted(camera, pixels.shape[0], pixels.shape[1])
        if fitted is None:
            size = f"{pixels.shape[1]} x {pixels.shape[0]}"
            expected = f"{camera.width_px} x {camera.height_px}"
            return _Obstacle("view_wrong_size", f"camera: picture of {size}, camera_info says {expected}", final=True)
        obstacle = self._obstacle(camera.frame_id, view.stamp_ns, view.stamp_ns, "view")
        if obstacle is not None:
            return obstacle
        base_T_camera = self._mounts.find(self._base, camera.frame_id)
        assert base_T_camera is not None
        map_T_camera = self._map_T_base(np.array([view.stamp_ns], np.int64))[0] @ base_T_camera
        return CameraView(view.stamp_ns, map_T_camera, fitted, view.detections, view.image)


def _fitted(camera: CameraModel, height_px: int, width_px: int) -> CameraModel | None:
    """The camera for pictures that were resized on their way (same aspect ratio within 2 %), else None."""
    if (height_px, width_px) == (camera.height_px, camera.width_px):
        return camera
    scale = np.array([width_px / camera.width_px, height_px / camera.height_px])
    if abs(scale[0] / scale[1] - 1) > 0.02:
        return None
    matrix = camera.matrix.copy()
    matrix[:2, 2] = (matrix[:2, 2] + 0.5) * scale - 0.5  # pixel centres lie at whole numbers
    matrix[:2, :2] *= scale[:, None]
    return replace(camera, width_px=width_px, height_px=height_px, matrix=matrix)
