"""How well the map knows what is wall, floor, ceiling, door and window, on drives that nothing was trained on.

The map is made by the product's own map stage, with or without the network. Each point of the truth asks the nearest voxel within 8 cm; points
that the LiDAR never came near (the truth counts what the camera saw, too) are left out, and counted.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from irsd.core.geometry import invert, make_pose, pose_from_xy_yaw
from irsd.core.types import Structure, SyncedFrame
from irsd.mapping.mapper import Mapper, MappingSettings
from irsd.perception.structure_net import NanoStructure
from irsd.sensors.decode import decode
from irsd.sensors.replay import read_messages
from irsd.sensors.sync import Synchronizer, SyncSettings
from training.scoring import Evaluation, Row

NEAR_M = 0.08
_KINDS = {"/lidar/points": "lidar", "/odom": "odometry", "/tf_static": "tf_static"}


def house_frames(folder: Path) -> Iterator[SyncedFrame]:
    """The sweeps of small_house.mcap as the pipeline gets them, in the house's frame (odometry drifts as recorded)."""
    start = json.loads((folder / "ground_truth.json").read_text())["start_pose"]
    synchronizer: Synchronizer | None = None
    waiting = []
    for message in read_messages([folder / "small_house.mcap"], list(_KINDS)):
        for sensed in decode(_KINDS[message.topic], message.data):
            if synchronizer is None and message.topic == "/odom":
                odom_T_base = make_pose(sensed.position_m, sensed.quat_xyzw)
                map_T_base = pose_from_xy_yaw(start["x"], start["y"], start["yaw"])
                synchronizer = Synchronizer(SyncSettings(), map_T_base @ invert(odom_T_base))
            waiting.append(sensed)
        if synchronizer is not None:
            for sensed in waiting:
                synchronizer.push(sensed)
            waiting = []
            yield from synchronizer.pop()
    if synchronizer is not None:
        yield from synchronizer.flush()


def house_truth(folder: Path) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Points [N, 3] and ``Structure`` [N] of instances.npz."""
    with np.load(folder / "instances.npz") as data:
        return data["xyz"].astype(np.float32), data["structural"].astype(np.uint8)


def ious(mapper: Mapper, xyz: NDArray[np.float32], truth: NDArray[np.uint8]) -> dict[str, float]:
    """IoU of each class that the truth has, their mean, and the share of the truth that was asked about."""
    rows = mapper.voxels.live_rows()
    distance, nearest = cKDTree(mapper.voxels.mean[rows]).query(xyz, distance_upper_bound=NEAR_M)
    near = np.isfinite(distance)
    return table(mapper.voxels.structure[rows][nearest[near]], truth[near]) | {"asked": float(near.mean())}


def table(found: NDArray[np.uint8], truth: NDArray[np.uint8]) -> dict[str, float]:
    """IoU by class, for the classes that occur in the truth, and their mean."""
    out = {}
    for kind in Structure:
        if (truth == kind).any():
            both, either = ((found == kind) & (truth == kind)).sum(), ((found == kind) | (truth == kind)).sum()
            out[kind.name.lower()] = float(both / either)
    return out | {"miou": float(np.mean(list(out.values())))}


def score(context: Evaluation) -> list[Row]:
    """Geometry alone and with the network, over a whole recorded drive."""
    xyz, truth = house_truth(context.data)
    rows = []
    for name, model in (("geometry alone", None), ("network", NanoStructure(context.models / "structure.onnx"))):
        mapper = Mapper(MappingSettings(), model)
        for frame in house_frames(context.data):
            mapper.integrate(frame)
        found = ious(mapper, xyz, truth)
        bars = {"miou": (0.7, 0.8), "wall": (0.9, None), "floor": (0.9, None), "ceiling": (0.9, None)} if model else {}
        rows += [
            Row("structure", f"{name}, drive: {key} IoU", value, *bars.get(key, (None, None)))
            for key, value in found.items()
            if key != "asked"
        ]
        rows.append(Row("structure", f"{name}, drive: share of the truth that the LiDAR saw", found["asked"]))
    return rows
