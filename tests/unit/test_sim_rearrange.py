"""Things carried away, brought and moved in the embedded world, and people walking by: the sensors see it, the robot keeps off."""

from __future__ import annotations

import numpy as np
import pytest

from irsd.core.geometry import pose_from_xy_yaw
from irsd.sim.building import make_building, truth_document
from irsd.sim.furniture import person
from irsd.sim.rearrange import CATALOGUE, made, shifted, with_thing, without
from irsd.sim.sensors import CameraSettings, Eyes, LidarSettings
from irsd.sim.world import World

FAR = np.array([100.0, 100.0])
RNG = np.random.default_rng(0)


def test_a_thing_less() -> None:
    building = make_building(4)
    chair = next(t for t in building.things if t.label == "chair")
    less = without(building, chair.id)
    assert chair.id not in {t.id for t in less.things}
    assert not (less.thing == chair.id).any()
    middle = ((chair.aabb_min_m + chair.aabb_max_m) / 2)[None, :2]
    assert building.obstacles.distance(middle)[0] < 0.05 < less.obstacles.distance(middle)[0]
    assert less.space.clearance_at(middle)[0] > building.space.clearance_at(middle)[0]
    for wrong in (chair.id, 10_000, next(t.id for t in building.things if t.label == "wall")):
        with pytest.raises(ValueError, match="could be carried"):
            without(less, wrong)


@pytest.mark.parametrize("label", sorted(CATALOGUE))
def test_a_thing_more(label: str) -> None:
    building = make_building(4)
    thing, body = made(building, 500, CATALOGUE[label](RNG), (3.0, 0.0, 0.2, 0.4))
    more = with_thing(building, thing, body, FAR)
    assert more.things[-1].label == label
    assert more.rooms[more.things[-1].room].label == "corridor"
    assert truth_document(more)["instances"][-1]["id"] == 500
    assert more.thing[-1] == more.shape_thing[-1] == 500
    assert more.obstacles.distance(np.array([[3.0, 0.0]]))[0] < 0.3


def test_a_thing_elsewhere_keeps_its_shape() -> None:
    building = make_building(4)
    plant = next(t for t in building.things if t.label == "plant")
    thing, body = shifted(building, plant.id, (1.0, 0.3, 0.0), np.pi / 2)
    np.testing.assert_allclose(((thing.aabb_min_m + thing.aabb_max_m) / 2)[:2], [1.0, 0.3], atol=0.03)
    old, new = plant.aabb_max_m - plant.aabb_min_m, thing.aabb_max_m - thing.aabb_min_m
    np.testing.assert_allclose(new, [old[1], old[0], old[2]], atol=1e-5)
    assert len(body.triangles) == (building.thing == plant.id).sum()


def test_the_world_while_it_runs() -> None:
    world = World(4, explore=False)
    first = world.place(CATALOGUE["box"](RNG), 2.0, 0.0)
    second = world.place(CATALOGUE["box"](RNG), 3.0, 0.4)
    assert second == first + 1 > max(t.id for t in make_building(4).things) + 1
    with pytest.raises(ValueError, match="robot stands"):
        world.place(CATALOGUE["box"](RNG), 0.1, 0.0)
    world.step(0.5)
    world.follow([[4.0, 0.0, 0.0]])  # through the box: the robot keeps off what was brought
    for _ in range(300):
        world.step(0.02)
        assert float(world.building.obstacles.distance(world.robot.pose[None, :2])[0]) > 0.2
    world.move(first, 2.0, -0.6)
    world.remove(second)
    assert second not in {t.id for t in world.building.things}
    assert world.place(CATALOGUE["box"](RNG), 6.0, 0.0) > second + 1
    assert world.robot.collisions == 0


def test_someone_walks_by_and_hides_what_is_behind() -> None:
    building = make_building(4)
    eyes = Eyes(building, LidarSettings(), CameraSettings())
    thing, body = made(building, 999, person(RNG), (0.0, 0.0, 0.0, 0.0))
    pose = pose_from_xy_yaw(0.0, 0.0, 0.0)
    before = eyes.expose(0, pose, np.random.default_rng(1))
    eyes.show(thing.id, body, np.array([2.0, 0.0]))
    there = eyes.expose(0, pose, np.random.default_rng(1))
    seen = there.ids_px == thing.id
    assert seen.sum() > 10_000
    assert there.depth_m[seen[::2, ::2]].max() < 2.3
    assert (there.ids_px[~seen] == before.ids_px[~seen]).all()
    sweep = eyes.sweep(0, np.zeros((240, 3)), 0.0, np.random.default_rng(2))
    hit = sweep.scan.points_sensor[sweep.thing == thing.id]
    assert len(hit) > 50
    assert np.hypot(*hit[:, :2].T).max() < 2.4
    eyes.renew(without(building, next(t.id for t in building.things if t.label == "bed")))
    assert (eyes.expose(0, pose, np.random.default_rng(1)).ids_px == thing.id).sum() == seen.sum()
    eyes.show(thing.id, body, None)
    np.testing.assert_array_equal(eyes.expose(0, pose, np.random.default_rng(1)).ids_px, before.ids_px)


def test_a_walk_ends() -> None:
    world = World(4, explore=False)
    world.walk(person(RNG), [[2.0, -0.5], [2.0, 0.5]], speed_m_s=1.0)
    named = [m for m in world.step(0.9) if m.topic == "/detections/info"]
    assert any(b'"person"' in m.data for m in named)
    named = [m for m in world.step(1.5) if m.topic == "/detections/info"]
    assert b'"person"' not in named[-1].data
