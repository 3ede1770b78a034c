"""Things that were carried away: rays through where they stood, looks in a row, what is told of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from irsd.core.geometry import pose_from_xy_yaw
from irsd.core.types import CameraModel, CameraView, InstanceState, InstanceUpdate
from irsd.instances.change import ChangeSettings, ChangeWatch, Verdict, range_image, seen_at
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
    there = seen_at(ORIGIN, near, far, block(2.0), 0.25)
    passed, confirmed = int((there > 0).sum()), int((there == -1).sum())
    assert {
        "passed": passed > 100 and not confirmed,
        "confirmed": confirmed > 50 and not passed,
        "nothing": passed + confirmed == 0,
    }[seen]


def test_nothing_measured_is_no_evidence() -> None:
    near, far = range_image(ORIGIN, np.zeros((0, 3), np.float32))
    assert not seen_at(ORIGIN, near, far, block(2.0), 0.25).any()
    watch = ChangeWatch(SETTINGS)
    assert watch.look(ORIGIN, scan(), 0) == Verdict()
    watch.place(1, block(2.0))
    assert watch.look(ORIGIN, np.zeros((0, 3), np.float32), 0) == Verdict()


def test_three_good_looks_in_a_row() -> None:
    watch, second = ChangeWatch(SETTINGS), 10**9
    watch.place(7, block(2.0))
    watch.place(8, block(2.0, 3.0))
    empty, there = scan((3.5, 0.3, 0.98)), scan((2.0, 0.3, 0.0), (3.5, 0.3, 0.98))
    looks = [watch.look(ORIGIN, s, k * second).gone for k, s in enumerate([empty, empty, there, empty, empty])]
    assert looks == [()] * 5
    assert watch.look(ORIGIN, empty, 5 * second + 1).gone == (7,)
    watch.forget(7)
    assert watch.look(ORIGIN, empty, 7 * second).gone == ()


def test_rays_that_always_passed_say_nothing() -> None:
    """Glass and thin rods: the camera sees them, the LiDAR does not; so it is no witness once the camera looks elsewhere."""
    watch, second, camera = ChangeWatch(SETTINGS), 10**9, pose_from_xy_yaw(0.0, 0.0, 0.0)
    for k in range(5):
        watch.place(7, block(2.0))
        watch.picture(camera, k * second, [7], [])
        watch.look(ORIGIN, scan(), k * second)
    assert [watch.look(ORIGIN, scan(), k * second).gone for k in range(5, 60)] == [()] * 55


def optical(x: float, y: float, yaw: float) -> NDArray[np.float64]:
    """map_T_camera of a camera at the height of the sensor that looks along yaw (z ahead, x right, y down)."""
    pose = pose_from_xy_yaw(x, y, yaw, 0.6)
    pose[:3, :3] = pose[:3, :3] @ np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
    return pose


def picture_on_wall() -> NDArray[np.float32]:
    """Points of something flat on the wall five metres ahead: the LiDAR can't tell it from the wall."""
    y, z = np.meshgrid(np.arange(-0.4, 0.4, 0.04), np.arange(0.3, 0.9, 0.04))
    return np.column_stack([np.full(y.size, 4.97), y.ravel(), z.ravel()]).astype(np.float32)


def looked_at(watch: ChangeWatch, times: int, hit: bool, begin_s: float, step_m: float, x: float = 2.5) -> list[int]:
    """Pictures at 5 Hz, the camera going sideways by step_m each, a scan with every picture; ids found gone."""
    gone: list[int] = []
    for k in range(times):
        stamp = round((begin_s + 0.2 * k) * 1e9)
        pose = optical(x, -0.5 + step_m * k, 0.0)
        watch.picture(pose, stamp, [7] if hit else [], [] if hit else [7])
        gone += watch.look(ORIGIN, scan(), stamp).gone
    return gone


def test_a_picture_taken_off_the_wall_is_gone_after_three_looks_from_places_apart() -> None:
    watch = ChangeWatch(SETTINGS)
    watch.place(7, picture_on_wall())
    assert looked_at(watch, 10, True, 0.0, 0.1) == []
    assert looked_at(watch, 8, False, 2.0, 0.1) == [], "two looks"
    assert looked_at(watch, 3, False, 3.6, 0.1) == [7], "the third"


def test_a_detector_that_misses_for_a_while_kills_nothing() -> None:
    watch = ChangeWatch(SETTINGS)
    watch.place(7, picture_on_wall())
    assert looked_at(watch, 10, True, 0.0, 0.1) == []
    assert looked_at(watch, 100, False, 2.0, 0.0) == [], "from one place, however long"
    watch = ChangeWatch(SETTINGS)
    watch.place(7, picture_on_wall())
    assert looked_at(watch, 10, True, 0.0, 0.1) == []
    assert looked_at(watch, 100, False, 2.0, 0.02, x=1.0) == [], "from farther away than it was ever detected"
    rng = np.random.default_rng(3)  # seldom detected at all: many more looks are asked for
    watch = ChangeWatch(SETTINGS)
    watch.place(7, picture_on_wall())
    found = [looked_at(watch, 1, bool(hit), 0.2 * k, 0.0, 2.5) for k, hit in enumerate(rng.random(300) < 0.2)]
    assert found == [[]] * 300
    assert looked_at(watch, 12, False, 60.0, 0.1) == []


def test_what_the_lidar_confirms_is_there_whatever_the_camera_misses() -> None:
    watch, there = ChangeWatch(SETTINGS), scan((2.0, 0.2, 0.0))
    watch.place(7, block(2.0))
    gone: list[int] = []
    for k in range(60):
        pose = optical(0.02 * k, 0.0, 0.0)
        watch.picture(pose, k * 200_000_000, [7] if k < 10 else [], [] if k < 10 else [7])
        gone += watch.look(ORIGIN, there, k * 200_000_000).gone
    assert gone == []


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
    known = [(s.id, s.labels[0][0], s.state) for s in back[-1].changed if s.id != 2]
    assert known == [(1, "chair", "present")], "put back where it was: known again, and not moved"


def test_can_be_switched_off() -> None:
    watch = ChangeWatch(dataclasses.replace(SETTINGS, enabled=False))
    watch.place(7, block(2.0))
    assert [watch.look(ORIGIN, scan(), k * 10**9) for k in range(9)] == [Verdict()] * 9


class House:
    """A memory in a round room: things by name at bearings, looked at once a second by camera and LiDAR."""

    def __init__(self) -> None:
        self.memory, self.stamp = InstanceMemory(FusionSettings(), embed), 0
        self.told: dict[int, InstanceState] = {}
        self.ended: list[int] = []

    def look(self, times: int, **things: tuple[float, float]) -> None:
        """things: name = (x, y) of a cube of half a metre; the floor is seen with every picture."""
        floor = np.stack(np.meshgrid(np.arange(-4, 4, 0.1), np.arange(-4, 4, 0.1), [0.0]), -1).reshape(-1, 3)
        clouds = {name: block(x, y) for name, (x, y) in things.items()}
        seen = np.concatenate([floor.astype(np.float32), *clouds.values()])
        masks = tuple(
            LiftedMask(n, points, ((name.rstrip("_"), 0.9),), 0.9, None, False)
            for n, (name, points) in enumerate(clouds.items(), 1)
        )
        boxes = [(float(np.hypot(x + 0.25, y)) - 0.2, 0.13, float(np.arctan2(y, x + 0.25))) for x, y in things.values()]
        for _ in range(times):
            self.stamp += 10**9
            view = CameraView(self.stamp, optical(0.0, 0.0, 0.0), CAMERA, None, None)
            self.memory.observe(view, LiftedView(self.stamp, masks, seen), None)
            self.memory.watch(ORIGIN, scan(*boxes), self.stamp)
            update = self.memory.collect(self.stamp)
            self.told |= {state.id: state for state in update.changed}
            self.ended += update.ended


def test_a_thing_that_vanishes_here_and_appears_there_keeps_its_id() -> None:
    house = House()
    house.look(6, chair=(2.0, 0.0), sofa=(0.0, 2.5))
    assert sorted((s.id, s.state) for s in house.told.values()) == [(1, "present"), (2, "present")]
    house.look(8, chair=(-2.5, 0.0), sofa=(0.0, 2.5))
    states = {s.labels[0][0]: s for s in house.memory.states()}
    assert {name: (s.id, s.state) for name, s in states.items()} == {"chair": (1, "moved"), "sofa": (2, "present")}
    assert states["chair"].points_map[:, 0].max() < -1.5
    assert states["chair"].observations == 14
    assert states["chair"].first_seen_ns == 10**9
    assert 1 not in house.ended


def test_a_thing_found_again_much_later_keeps_its_id_too() -> None:
    house = House()
    house.look(6, chair=(2.0, 0.0), sofa=(0.0, 2.5))
    house.look(20, sofa=(0.0, 2.5))
    assert house.told[1].state == "gone"
    assert 1 in house.ended
    house.look(4, chair=(-2.5, 0.0), sofa=(0.0, 2.5))
    assert (house.told[1].state, house.told[1].existence > 0.5) == ("moved", True)


def test_where_it_could_be_either_of_two_both_end_and_a_new_one_begins() -> None:
    house = House()
    house.look(6, chair=(2.0, 0.0), chair_=(0.0, 2.5))
    house.look(20)
    house.look(5, chair=(-2.5, 0.0))
    assert [(s.id, s.state) for s in house.memory.states()] == [(3, "present")]


def test_another_thing_does_not_inherit_the_id() -> None:
    house = House()
    house.look(6, chair=(2.0, 0.0))
    house.look(20)
    house.look(5, wardrobe=(-2.5, 0.0))
    assert [(s.id, s.labels[0][0]) for s in house.memory.states()] == [(2, "wardrobe")]


def test_a_thing_pushed_aside_leaves_no_ghost() -> None:
    house = House()
    house.look(20, chair=(2.0, 0.0))
    house.look(8, chair=(2.0, 0.4))
    (state,) = house.memory.states()
    assert (state.id, state.state) == (1, "moved")
    assert np.quantile(state.points_map[:, 1], 0.1) > 0.05, "nothing of it is where it stood"


def test_moved_and_gone_after_a_restart() -> None:
    house = House()
    house.look(6, chair=(2.0, 0.0), sofa=(0.0, 2.5))
    house.look(8, chair=(-2.5, 0.0), sofa=(0.0, 2.5))
    again = House()
    again.memory.restore(house.memory.states())
    assert {s.id: s.state for s in again.memory.states()} == {1: "moved", 2: "present"}
    again.look(4, chair=(-2.5, 0.0))  # the sofa was carried away meanwhile
    assert again.told[2].state == "gone"
