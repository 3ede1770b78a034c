"""Things that were carried away: rays through where they stood, looks in a row, what is told of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from irsd.core.types import CameraModel, CameraView, InstanceUpdate
from irsd.instances.change import ChangeSettings, ChangeWatch, judge, range_image
from irsd.instances.lift import LiftedMask, LiftedView
from irsd.instances.memory import FusionSettings, InstanceMemory

ORIGIN = np.array([0.0, 0.0, 0.6])
SETTINGS = ChangeSettings()
CAMERA = CameraModel("camera", 4, 4, np.eye(3), "plumb_bob", np.zeros(0))


def block(x: float, y: float = 0.0, size: float = 0.5) -> NDArray[np.float32]:
    """The points of a solid cube about the height of the sensor."""
    axis = np.arange(0.02, size, 0.04)
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1).reshape(-1, 3)
    return (grid + np.array([x, y - size / 2, 0.6 - size / 2])).astype(np.float32)


def scan(*boxes: tuple[float, float, float], wall_m: float = 5.0) -> NDArray[np.float32]:
    """Rays from ORIGIN into a round room; boxes: (distance, half angle rad, bearing rad) stand in the way."""
    azimuth, elevation = np.meshgrid(np.deg2rad(np.arange(-180, 180, 0.8)), np.deg2rad(np.arange(-16, 16, 0.8)))
    distance = np.full(azimuth.shape, wall_m)
    for near_m, half_rad, bearing in boxes:
        distance[np.abs(azimuth - bearing) < half_rad] = near_m
    flat = np.cos(elevation)
    rays = np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)], -1)
    return (ORIGIN + (rays * distance[..., None]).reshape(-1, 3)).astype(np.float32)


@pytest.mark.parametrize(
    ("boxes", "seen"),
    [((), "passed"), (((2.0, 0.2, 0.0),), "confirmed"), (((1.0, 0.3, 0.0),), "nothing")],
)
def test_free_there_or_blocked(boxes: tuple[tuple[float, float, float], ...], seen: str) -> None:
    near, far = range_image(ORIGIN, scan(*boxes))
    passed, confirmed = judge(ORIGIN, near, far, block(2.0), 0.25)
    assert {
        "passed": passed > 100 and not confirmed,
        "confirmed": confirmed > 50 and not passed,
        "nothing": passed + confirmed == 0,
    }[seen]


def test_nothing_measured_is_no_evidence() -> None:
    near, far = range_image(ORIGIN, np.zeros((0, 3), np.float32))
    assert judge(ORIGIN, near, far, block(2.0), 0.25) == (0, 0)
    watch = ChangeWatch(SETTINGS)
    assert watch.look(ORIGIN, scan(), 0) == []
    watch.place(1, block(2.0))
    assert watch.look(ORIGIN, np.zeros((0, 3), np.float32), 0) == []


def test_three_good_looks_in_a_row() -> None:
    watch, second = ChangeWatch(SETTINGS), 10**9
    watch.place(7, block(2.0))
    watch.place(8, block(2.0, 3.0))
    empty, there = scan((3.5, 0.3, 0.98)), scan((2.0, 0.3, 0.0), (3.5, 0.3, 0.98))
    assert [watch.look(ORIGIN, s, k * second) for k, s in enumerate([empty, empty, there, empty, empty])] == [[]] * 5
    assert watch.look(ORIGIN, empty, 5 * second + 1) == [7]
    watch.forget(7)
    assert watch.look(ORIGIN, empty, 7 * second) == []


def embed(names: Sequence[str]) -> NDArray[np.float32]:
    return np.eye(8, dtype=np.float32)[[len(n) % 8 for n in names]]


def test_a_thing_carried_away_is_gone_and_another_is_new() -> None:
    memory, second = InstanceMemory(FusionSettings(), embed), 10**9
    stamp = 0

    def look(name: str, points: NDArray[np.float32], sweep: NDArray[np.float32]) -> InstanceUpdate:
        nonlocal stamp
        stamp += second
        lifted = LiftedView(stamp, (LiftedMask(1, points, ((name, 0.9),), 0.9, None, False),), points)
        memory.observe(CameraView(stamp, np.eye(4), CAMERA, None, None), lifted, None)
        memory.watch(ORIGIN, sweep, stamp)
        return memory.collect(stamp)

    chair, lamp = block(2.0), block(2.0, 3.0)
    for _ in range(6):
        update = look("chair", chair, scan((2.0, 0.2, 0.0)))
    assert [(s.id, s.state) for s in update.changed] == [(1, "present")]
    told = []
    for _ in range(3):  # the chair is gone, a lamp stands elsewhere
        told += [(s.id, s.state, s.existence) for s in look("lamp", lamp, scan((3.5, 0.2, 0.98))).changed]
    assert (1, "gone", 0.0) in told
    assert (2, "present", 1.0) in told
    ended = [i for _ in range(6) for i in look("lamp", lamp, scan((3.5, 0.2, 0.98))).ended]
    assert ended == [1]
    assert [s.id for s in memory.states()] == [2]
    back = [look("chair", chair, scan((2.0, 0.2, 0.0))) for _ in range(3)]
    assert [s.labels[0][0] for u in back for s in u.changed if s.id == 3] == ["chair"]


def test_can_be_switched_off() -> None:
    watch = ChangeWatch(dataclasses.replace(SETTINGS, enabled=False))
    watch.place(7, block(2.0))
    assert [watch.look(ORIGIN, scan(), k * 10**9) for k in range(9)] == [[]] * 9
