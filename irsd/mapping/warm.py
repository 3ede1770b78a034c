"""Compile (or load from the cache) every kernel of the map before the first scan has to wait for one."""

from __future__ import annotations

import numpy as np

from irsd.core.grid import GridFrame
from irsd.core.types import CameraModel, DeskewedScan, Plan, SyncedFrame
from irsd.mapping.mapper import Mapper, MappingSettings
from irsd.mapping.registration import Reach, align
from irsd.mapping.relocalise import find_place
from irsd.mapping.voxels import VoxelSettings


def warm_up() -> None:
    """Map two small scans and read every product. About 20 s of one core when nothing is cached, else about 0.5 s.

    Where compiled code is kept, also for a read-only installation: see ``irsd.core.jit``.
    """
    mapper = Mapper(MappingSettings(voxels=VoxelSettings(max_voxels=1000)))
    grid = np.stack(np.meshgrid([1.0, 1.5], [-0.5, 0.5], [0.0, 2.5]), -1).reshape(-1, 3).astype(np.float32)
    for stamp_ns in range(2):
        scan = DeskewedScan(stamp_ns, grid, np.array([0.0, 0.0, 0.6]))
        mapper.integrate(SyncedFrame(stamp_ns, stamp_ns, np.eye(4), scan, ()))
    mapper.walls.add(grid, grid)
    mapper.voxels.rows_at(grid)
    mapper.visible(np.eye(4), CameraModel("", 64, 48, np.diag([50.0, 50.0, 1.0]), "plumb_bob", np.zeros(5)), 5.0)
    align(grid, np.zeros(3), np.zeros(3), mapper.voxels.planes, Reach(1, 0.2, 0.5, 0.1, 0.01), least=0, rounds=1)
    mapper.wall_points()
    mapper.plan_evidence()
    room = np.zeros((16, 16), np.bool_)
    room[1:-1, 1:-1] = True
    plan = Plan(GridFrame((0.0, 0.0), 0.1, 16, 16), 0.0, ~room, room)
    find_place(plan, (0.8, 0.8), plan)
    mapper.navigation_grid()
