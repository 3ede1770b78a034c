"""Compile (or load from the cache) every kernel of fusion before the first picture has to wait for one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from irsd.core.grid import GridFrame
from irsd.core.types import CameraModel, CameraView, Detections, Rooms
from irsd.instances.lift import LiftedMask, LiftedView, LiftSettings, lift
from irsd.instances.memory import FusionSettings, InstanceMemory


def _embed(names: Sequence[str]) -> NDArray[np.float32]:
    return np.eye(len(names), 8, dtype=np.float32)


def warm_up() -> None:
    """Fuse a few tiny pictures: two things of two masks that become one, rooms, collecting, resting, forgetting and restoring."""
    memory = InstanceMemory(FusionSettings(forget_views=10, rest_views=4), _embed)
    axis = np.arange(0.02, 0.4, 0.04)
    cube = np.stack(np.meshgrid(axis, axis, axis), -1).reshape(-1, 3).astype(np.float32)
    halves = (cube[: len(cube) // 2], cube[len(cube) // 2 :])
    rooms = Rooms(GridFrame((-1.0, -1.0), 0.1, 20, 20), np.ones((20, 20), np.int32), (1,), (), (), ())
    camera = CameraModel("", 4, 4, np.eye(3), "plumb_bob", np.zeros(0))
    clouds = [halves] * 3 + [(cube,)] * 4 + [(cube + np.float32(3.0),)] + [()] * 12
    for stamp_ns, masks in enumerate(clouds):
        lifted = tuple(LiftedMask(k, points, (("thing", 1.0),), 1.0, None, False) for k, points in enumerate(masks))
        memory.observe(CameraView(stamp_ns, np.eye(4), camera, None, None), LiftedView(stamp_ns, lifted, cube), rooms)
        memory.collect(stamp_ns)
    memory.known(cube, 8)
    for stamp_s in range(1, 9):  # rays pass through all of it until it is gone
        memory.watch(np.zeros(3), 4.0 * cube, stamp_s * 1_000_000_000)
    InstanceMemory(FusionSettings(), _embed).restore(memory.states())
    blind = InstanceMemory(
        FusionSettings(), _embed
    )  # two sides of one thing by pictures that are masks alone, edges and all
    nothing = np.zeros((0, 3), np.float32)
    for stamp_ns, side in enumerate((cube[:520], cube[480:])):
        mask = LiftedMask(1, side, (("thing", 1.0),), 1.0, None, False)
        blind.observe(
            CameraView(stamp_ns, np.eye(4), camera, None, None), LiftedView(stamp_ns, (mask,), nothing, False), None
        )
    blind.collect(1)
    ids = np.zeros((8, 8), np.uint16)
    ids[2:6, 2:6] = 1
    score, number = np.ones(1, np.float32), np.ones(1, np.int32)
    seen = Detections(0, "", ids, number, score, ("thing",), ((("thing", 1.0),),), None)
    small = CameraModel("", 8, 8, np.array([[8.0, 0, 3.5], [0, 8.0, 3.5], [0, 0, 1]]), "plumb_bob", np.zeros(0))
    ahead = cube + np.array([-0.2, -0.2, 1.0], np.float32)
    lift(CameraView(0, np.eye(4), small, seen, None), ahead, np.zeros(len(ahead), np.uint8), LiftSettings())
