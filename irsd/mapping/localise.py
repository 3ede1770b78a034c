"""Where the odometry's frame lies in the map: every sweep is laid on the voxels that are there already, and so is the next one.

Odometry says how the robot moved since the last sweep; the map says where it is. What drifted while the robot was away is put right
as soon as it sees mapped walls again. A match that is too thin, fits badly or asks for too large a step moves nothing: it is
counted, and odometry alone goes on.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from irsd.core.geometry import Pose, pose_from_xy_yaw, transform, yaw_of
from irsd.core.settings import setting
from irsd.core.types import CameraView, Localisation, SyncedFrame
from irsd.mapping.registration import Alignment, Reach, align
from irsd.mapping.trust import OdometryTrust, size_m
from irsd.mapping.voxels import VoxelMap

_FADE = 0.95  # of the squared deviations, per sweep: the last 20 sweeps
_FIRST_DEVIATION_M = 0.04


@dataclass(frozen=True)
class LocaliseSettings:
    """How sweeps are laid on the map, which takes the drift out of the odometry."""

    enabled: bool = setting(
        True, "correct the odometry by the map; false: the map's frame is the odometry's (it is localised already)"
    )
    max_points: int = setting(
        1000, "points of a sweep that are laid on the map (the others take turns)", lo=50, hi=100_000
    )
    reach_m: float = setting(0.2, "planes of the map are looked for up to this far from a point", lo=0.05, hi=1.0)
    upright: float = setting(0.5, "|n_z| up to which a plane tells of x, y and yaw", lo=0.1, hi=1.0)
    noise_m: float = setting(
        0.05, "least scale of the robust weight; three times the range noise or more", lo=0.01, hi=0.5
    )
    weak: float = setting(
        0.01, "share of the points that must tell of a direction, or it is left to odometry (corridors)", lo=0.0, hi=0.3
    )
    min_overlap: float = setting(0.1, "share of a sweep's points that must have a plane in the map", lo=0.01, hi=1.0)
    min_fit: float = setting(
        0.5, "mean weight of those points, 1 = all on their planes, below which the match is bad", lo=0.0, hi=1.0
    )
    drifts_from: float = setting(
        0.002,
        "share of its way from which the odometry counts as drifting, and every sweep corrects it; below, only what is surely off is "
        "put right",
        lo=0.0,
        hi=0.1,
    )
    drift: float = setting(
        0.01, "share of its way by which an odometry that drifts may be off, as one sigma", lo=0.001, hi=0.5
    )
    match_m: float = setting(
        0.01, "by how much one sweep's place on the map may be off, as one sigma", lo=0.001, hi=0.2
    )
    max_step_m: float = setting(0.3, "largest step of one sweep; farther is a mistake", lo=0.01, hi=5.0)
    max_turn_rad: float = setting(0.1, "largest turn of one sweep", lo=0.005, hi=1.0)
    publish_tf: bool = setting(
        False, "also publish map -> odom on /tf (leave it off where AMCL or a SLAM publishes that)"
    )


class Localiser:
    """Owner of map_T_odom, an upright transform. Called by the map thread; what it returns is not written again."""

    def __init__(self, settings: LocaliseSettings) -> None:
        self._settings = settings
        self._x_m, self._y_m, self._yaw_rad, self._z_m = 0.0, 0.0, 0.0, 0.0
        self._deviation_m = _FIRST_DEVIATION_M
        self._trust = OdometryTrust(drift=settings.drift, match_m=settings.match_m, drifts_from=settings.drifts_from)
        self._turn = 0
        self._state = "odometry" if settings.enabled else "off"
        self._counters = dict.fromkeys(("matched", "thin", "bad_fit", "too_far", "degenerate"), 0)

    @property
    def map_T_odom(self) -> Pose:
        """Where the odometry's frame lies in the map now."""
        return pose_from_xy_yaw(self._x_m, self._y_m, self._yaw_rad, self._z_m)

    def begin_at(self, map_T_odom: Pose) -> None:
        """Where the odometry's frame lies in a stored map, as far as its stored walls tell."""
        self._x_m, self._y_m, self._z_m = map(float, map_T_odom[:3, 3])
        self._yaw_rad = yaw_of(map_T_odom)
        self._deviation_m = _FIRST_DEVIATION_M
        self._trust.begin_at(self.map_T_odom)

    def place(self, frame: SyncedFrame, voxels: VoxelMap) -> tuple[SyncedFrame, Localisation]:
        """A frame of the synchroniser, which is in the odometry's frame, laid in the map; and where that has put the robot."""
        before = self.map_T_odom
        predicted = moved(frame, before)
        self._trust.follow(frame.map_T_base, before)
        if self._settings.enabled and voxels.slot_count and len(frame.scan.points_map):
            found = self._match(predicted, voxels)
            self._state = "odometry" if found is None else "map"
            if found is not None:
                self._move(self._trust.part_of(found, before), predicted.map_T_base[:2, 3])
                predicted = moved(frame, self.map_T_odom)
        where = Localisation(frame.stamp_ns, frame.odom_frame, self.map_T_odom, predicted.map_T_base, self._state)
        return predicted, where

    def counters(self) -> dict[str, int]:
        """Sweeps that were laid on the map, and those that were not by reason: too few points on known surface (thin), points off
        their planes (bad_fit), too large a step (too_far). degenerate: laid on the map, but for some direction."""
        return {f"localise_{name}": count for name, count in self._counters.items()}

    def _match(self, frame: SyncedFrame, voxels: VoxelMap) -> NDArray[np.float64] | None:
        """The move (x, y, yaw about the robot) that lays the sweep on the map, or None; counts."""
        s, points = self._settings, frame.scan.points_map
        stride = max(-(-len(points) // s.max_points), 1)
        self._turn += 1
        some = np.ascontiguousarray(points[self._turn % stride :: stride], np.float32)
        # Three deviations, as KISS-ICP: a robot that was right so far looks for walls near where they should be.
        scale_m = min(max(3 * self._deviation_m, s.noise_m), s.reach_m)
        cells = 1 if scale_m <= 2 * voxels.planes.cell_m else 2
        reach = Reach(cells, s.reach_m, s.upright, scale_m, s.weak)
        least = max(round(s.min_overlap * len(some)), 10)
        pivot = np.asarray(frame.map_T_base[:3, 3], np.float64)
        found = align(some, pivot, frame.scan.origin_map, voxels.planes, reach, least=least, rounds=8)
        verdict = self._judge(found, least)
        self._counters[verdict] += 1
        if verdict != "matched":
            self._deviation_m = min(
                1.1 * self._deviation_m, s.reach_m / 3
            )  # the longer without, the farther it may be off
            return None
        self._counters["degenerate"] += found.free < 3
        self._deviation_m = float(np.sqrt(_FADE * self._deviation_m**2 + (1 - _FADE) * size_m(found.move) ** 2))
        return found.move

    def _judge(self, found: Alignment, least: int) -> str:
        if found.matched < least or not found.free:
            return "thin"
        if found.fit < self._settings.min_fit:
            return "bad_fit"
        step_m, turn_rad = float(np.hypot(found.move[0], found.move[1])), abs(float(found.move[2]))
        return "too_far" if step_m > self._settings.max_step_m or turn_rad > self._settings.max_turn_rad else "matched"

    def _move(self, move: NDArray[np.float64], pivot_xy: NDArray[np.float64]) -> None:
        """Turns and shifts the odometry's frame as the sweep was, about the robot."""
        c, s = float(np.cos(move[2])), float(np.sin(move[2]))
        x, y = self._x_m - float(pivot_xy[0]), self._y_m - float(pivot_xy[1])
        self._x_m = float(pivot_xy[0] + move[0]) + c * x - s * y
        self._y_m = float(pivot_xy[1] + move[1]) + s * x + c * y
        self._yaw_rad += float(move[2])


def moved(frame: SyncedFrame, parent_T_frame: Pose) -> SyncedFrame:
    """The frame with everything in it seen from a parent frame."""
    scan = replace(
        frame.scan,
        points_map=np.asarray(transform(parent_T_frame, frame.scan.points_map), np.float32),
        origin_map=np.asarray(transform(parent_T_frame, frame.scan.origin_map[None])[0], np.float64),
    )
    views = tuple(_view(view, parent_T_frame) for view in frame.views)
    return replace(frame, map_T_base=parent_T_frame @ frame.map_T_base, scan=scan, views=views)


def _view(view: CameraView, parent_T_frame: Pose) -> CameraView:
    return replace(view, map_T_camera=parent_T_frame @ view.map_T_camera)
