"""The instance memory: fusion, evidence, merging, rooms, publication, determinism, resuming."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from irsd.core.grid import GridFrame
from irsd.core.types import CameraModel, CameraView, InstanceUpdate, Rooms
from irsd.instances.lift import LiftedMask, LiftedView
from irsd.instances.memory import FusionSettings, InstanceMemory

CAMERA = CameraModel("camera", 4, 4, np.eye(3), "plumb_bob", np.zeros(0))
SETTINGS = FusionSettings()
AXES = {"chair": 0, "seat": 0, "sofa": 1, "lamp": 2, "book": 3, "desk": 4}


def embed(names: Sequence[str]) -> NDArray[np.float32]:
    """Synonyms share a vector, all other names are at right angles."""
    return np.eye(8, dtype=np.float32)[[AXES.get(n, 7) for n in names]]


def box(x: float, size: float = 0.4, y: float = 0.0, z: float = 0.48) -> NDArray[np.float32]:
    """The points of a solid cube of 4 cm voxels that starts at (x, y, z), multiples of 4 cm."""
    axis = np.arange(0.02, size, 0.04)
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1).reshape(-1, 3)
    return (grid + np.array([x, y, z])).astype(np.float32)


class World:
    """Feeds pictures to a memory. seen: what the camera sees beside the masks."""

    def __init__(self, settings: FusionSettings = SETTINGS, rooms: Rooms | None = None) -> None:
        self.memory = InstanceMemory(settings, embed)
        self.rooms = rooms
        self.stamp = 0

    def look(
        self, *masks: tuple[str, NDArray[np.float32]], seen: NDArray[np.float32] | None = None, times: int = 1
    ) -> None:
        for _ in range(times):
            self.stamp += 250_000_000
            lifted = tuple(LiftedMask(k + 1, p, ((name, 0.8),), 0.8, None, False) for k, (name, p) in enumerate(masks))
            everything = [p for _, p in masks] + ([] if seen is None else [seen])
            points = np.concatenate(everything) if everything else np.zeros((0, 3), np.float32)
            view = CameraView(self.stamp, np.eye(4), CAMERA, None, None)
            self.memory.observe(view, LiftedView(self.stamp, lifted, points), self.rooms)

    def collect(self) -> InstanceUpdate:
        return self.memory.collect(self.stamp)


def two_rooms() -> Rooms:
    labels = np.zeros((20, 40), np.int32)
    labels[:, :20], labels[:, 20:] = 1, 2
    return Rooms(GridFrame((-2.0, -1.0), 0.1, 20, 40), labels, (1, 2), (), (), ())  # the border is x = 0


def test_nothing_seen() -> None:
    world = World()
    assert world.collect() == InstanceUpdate(0, (), (), ())
    world.look()
    world.look(("chair", np.zeros((0, 3), np.float32)))
    assert world.collect().changed == ()
    assert world.memory.states() == ()


def test_published_when_confirmed_and_reported_once() -> None:
    world = World()
    world.look(("chair", box(0)), times=2)
    assert world.collect().changed == ()
    world.look(("chair", box(0)))
    (state,) = world.collect().changed
    assert (state.id, state.observations, state.existence, state.room) == (1, 3, 1.0, 0)
    assert state.labels == (("chair", 1.0),)
    assert (state.first_seen_ns, state.last_seen_ns) == (250_000_000, 750_000_000)
    assert sorted(map(tuple, state.points_map.tolist())) == sorted(map(tuple, box(0).tolist()))
    assert world.collect().changed == ()  # nothing new: nothing reported
    world.look(("sofa", box(5)), times=3)
    assert [s.id for s in world.collect().changed] == [2]


def test_two_things_of_one_name_stay_two() -> None:
    world = World()
    world.look(("chair", box(0)), ("chair", box(0.48)), times=4)
    assert len(world.collect().changed) == 2


def test_synonyms_are_one_thing_with_its_commoner_name() -> None:
    world = World()
    world.look(("chair", box(0)), times=5)
    world.look(("seat", box(0)), times=3)
    (state,) = world.collect().changed
    assert state.labels == (("chair", 1.0),)
    assert state.observations == 8


def test_wrong_names_do_not_spawn_and_stay_a_minor_label() -> None:
    world = World()
    for k in range(30):
        world.look(("lamp" if k % 10 == 0 else "sofa", box(0)))
    (state,) = world.collect().changed
    assert [name for name, _ in state.labels] == ["sofa", "lamp"]
    assert state.labels[0][1] == pytest.approx(0.9)


def test_a_book_on_a_desk_stays_a_book() -> None:
    world = World()
    desk, book = box(0, 0.8), box(0.2, 0.12, 0.2, 1.28)
    for k in range(20):
        if k % 4:
            world.look(("desk", desk), ("book", book))
        else:
            world.look(("desk", np.concatenate([desk, book])))  # a merged mask
    states = world.collect().changed
    assert sorted(s.labels[0][0] for s in states) == ["book", "desk"]
    assert {len(s.points_map) for s in states} == {len(desk), len(book)}


def test_each_voxel_has_one_owner_and_rare_spill_belongs_to_nobody() -> None:
    world = World()
    table, spill = box(0), box(0.4, 0.2)
    world.look(("desk", np.concatenate([table, spill])), seen=spill)
    world.look(("desk", table), seen=spill, times=9)
    (state,) = world.collect().changed
    assert len(state.points_map) == len(table)
    world.look(("chair", spill), ("desk", table), times=5)
    clouds = [set(map(tuple, s.points_map.tolist())) for s in world.collect().changed]
    assert len(clouds) == 2
    assert not clouds[0] & clouds[1]


def test_halves_become_one_when_masks_keep_covering_both() -> None:
    world = World()
    whole = box(0, 0.8)
    left, right = whole[whole[:, 0] < 0.4], whole[whole[:, 0] >= 0.4]
    world.look(("sofa", left), ("sofa", right), times=3)
    assert [s.id for s in world.collect().changed] == [1, 2]
    world.look(("sofa", whole), times=6)
    update = world.collect()
    assert [(s.id, len(s.points_map)) for s in update.changed] == [(1, len(whole))]
    assert (update.ended, update.merged) == ((2,), ((1, 2),))


def test_merged_masks_of_neighbours_do_not_merge_them() -> None:
    world = World()
    one, two = box(0), box(0.4)
    for k in range(50):
        if k % 12 == 11:
            world.look(("chair", np.concatenate([one, two])))
        else:
            world.look(("chair", one), ("chair", two))
        world.collect()
    assert sorted(len(s.points_map) for s in world.memory.states()) == [len(one), len(one)]


def sides(names: bool) -> int:
    """Things published after two sides of a box were seen in turn, by pictures that tell nothing beside their masks."""
    rng = np.random.default_rng(0)
    memory, stamp = InstanceMemory(SETTINGS, embed), 0
    truth = np.eye(64, dtype=np.float32)[0]

    def look(*clouds: NDArray[np.float32]) -> None:
        nonlocal stamp
        stamp += 250_000_000
        masks = []
        for k, cloud in enumerate(clouds):
            noisy = truth + (0.0 if names else 0.04) * rng.normal(size=64)
            vector = (noisy / np.linalg.norm(noisy)).astype(np.float32)
            masks.append(LiftedMask(k + 1, cloud, (("desk", 0.8),), 0.8, vector, False))
        empty = np.zeros((0, 3), np.float32)
        memory.observe(CameraView(stamp, np.eye(4), CAMERA, None, None), LiftedView(stamp, tuple(masks), empty), None)

    for _ in range(40):  # other things, often seen, teach what meanings are like
        look(box(5))
    memory.collect(stamp)
    whole = box(0, 0.8)
    left, right = whole[whole[:, 0] < 0.44], whole[whole[:, 0] > 0.40]
    for _ in range(3):
        look(left)
        look(right)
        look(left, right)
    memory.collect(stamp)
    return len([s for s in memory.states() if s.points_map[:, 0].max() < 2])


def test_sides_of_one_thing_become_one_unless_only_its_name_says_so() -> None:
    assert sides(names=False) == 1
    assert sides(names=True) == 2


def test_what_is_seldom_seen_where_it_should_be_is_not_published() -> None:
    world = World()
    world.look(("lamp", box(0)), times=3)
    world.look(seen=box(0), times=60)
    assert world.collect().changed == ()
    assert world.memory.states() == ()


def test_what_is_gone_ends() -> None:
    world = World()
    world.look(("lamp", box(0)), times=3)
    assert len(world.collect().changed) == 1
    world.look(seen=box(0), times=100)
    update = world.collect()
    assert (update.changed, update.ended) == ((), (1,))


def test_unconfirmed_instances_are_forgotten() -> None:
    world = World(dataclasses.replace(SETTINGS, forget_views=10))
    world.look(("lamp", box(0)))
    world.look(("chair", box(3)), times=12)
    world.collect()
    assert len(world.memory) == 1


@pytest.mark.parametrize(
    ("settings", "found"),
    [
        ({}, 2),  # of the second mask 1 in 15 points lies in room 1: it does not cross the border
        ({"cross_share": 0.05}, 1),
        ({"room_prior": False}, 1),
    ],
)
def test_rooms_part_what_overlaps_at_their_border_unless_the_mask_crosses(
    settings: dict[str, float], found: int
) -> None:
    world = World(dataclasses.replace(SETTINGS, **settings), rooms=two_rooms())
    for cloud in (box(-0.12, 0.12), box(-0.04, 0.6)):
        world.look(("sofa", cloud), seen=box(-0.12, 0.12), times=4)
        world.collect()
    states = world.memory.states()
    assert len(states) == found
    assert [s.room for s in states] == ([1, 2] if found == 2 else [2])


def test_rooms_that_change_move_their_instances() -> None:
    rooms = two_rooms()
    world = World(rooms=rooms)
    world.look(("chair", box(0.48)), times=3)
    assert world.collect().changed[0].room == 2
    world.rooms = dataclasses.replace(rooms, labels=np.where(rooms.labels == 2, 7, 1).astype(np.int32), ids=(1, 7))
    world.look()
    assert [(s.id, s.room) for s in world.collect().changed] == [(1, 7)]


def random_story(seed: int) -> list[list[tuple[str, NDArray[np.float32]]]]:
    rng = np.random.default_rng(seed)
    things = [(name, box(float(x), 0.4)) for name, x in (("chair", 0), ("chair", 0.48), ("sofa", 0.96), ("lamp", 3))]
    story = []
    for _ in range(40):
        masks = [
            (str(rng.choice(list(AXES))) if rng.random() < 0.08 else n, p[rng.random(len(p)) < 0.8]) for n, p in things
        ]
        story.append([masks[k] for k in rng.permutation(4) if rng.random() < 0.9])
    return story


def test_same_story_same_bytes() -> None:
    def tell() -> list[bytes]:
        world, out = World(rooms=two_rooms()), []
        for masks in random_story(5):
            world.look(*masks)
            out += [
                repr((s.id, s.labels, s.room, s.observations)).encode() + s.points_map.tobytes()
                for s in world.collect().changed
            ]
        return out

    assert tell() == tell()


def test_numbers_and_order_of_masks_in_a_picture_do_not_matter() -> None:
    def tell(step: int) -> list[tuple[str, tuple[tuple[float, ...], ...]]]:
        world = World()
        for masks in random_story(6):
            world.look(*masks[::step])
            world.collect()
        return sorted(
            (s.labels[0][0], tuple(sorted(map(tuple, s.points_map.round(3).tolist())))) for s in world.memory.states()
        )

    assert tell(1) == tell(-1)


def test_few_false_instances_in_a_noisy_story() -> None:
    world = World()
    for masks in random_story(7):
        world.look(*masks)
        world.collect()
    assert sorted(s.labels[0][0] for s in world.memory.states()) == ["chair", "chair", "lamp", "sofa"]


def test_restore_resumes_ids_and_matches_what_was_known() -> None:
    world = World(rooms=two_rooms())
    world.look(("chair", box(0)), ("sofa", box(-1)), times=5)
    world.collect()
    states = world.memory.states()
    again = World(rooms=two_rooms())
    again.memory.restore(states)
    for a, b in zip(states, again.memory.states(), strict=True):
        assert (a.id, a.labels, a.room, a.observations) == (b.id, b.labels, b.room, b.observations)
        clouds = [np.array(sorted(map(tuple, cloud.tolist()))) for cloud in (a.points_map, b.points_map)]
        np.testing.assert_allclose(clouds[0], clouds[1], atol=SETTINGS.voxel_m / 16)
    again.look(("chair", box(0)), ("lamp", box(2)), times=3)
    changed = {s.labels[0][0]: s for s in again.collect().changed}
    assert changed["chair"].id in {s.id for s in states}
    assert changed["chair"].observations == 8
    assert changed["lamp"].id == 3


def test_embeddings_of_the_detector_are_averaged() -> None:
    world = World()
    for k in range(4):
        angle = 0.2 * (-1) ** k
        vector = np.array([np.cos(angle), np.sin(angle)], np.float32)
        lifted = LiftedView(k, (LiftedMask(1, box(0), (("chair", 0.5),), 0.5, vector, False),), box(0))
        world.memory.observe(CameraView(k, np.eye(4), CAMERA, None, None), lifted, None)
    (state,) = world.collect().changed
    assert state.embedding is not None
    np.testing.assert_allclose(state.embedding, [1.0, 0.0], atol=1e-6)


def test_what_is_known_of_points_is_who_owns_them_and_how_well_its_meaning_is_known() -> None:
    world = World()
    world.look(("chair", box(0)), ("lamp", box(2)), times=3)
    points = np.concatenate([box(0)[:5], box(2)[:5], box(5)[:5]])
    known = world.memory.known(points, 8)
    assert known.id.tolist() == [1, 2]
    assert known.of_point.tolist() == [0] * 5 + [1] * 5 + [-1] * 5
    assert known.looks.tolist() == [3, 3]
    np.testing.assert_allclose(known.embedding, embed(["chair", "lamp"]))
    other_space = world.memory.known(points, 16)
    assert other_space.looks.tolist() == [0, 0]
    assert not other_space.embedding.any()
    assert len(world.memory.known(points[:0], 8).id) == 0


def test_an_embedding_that_was_not_measured_matches_and_adds_nothing() -> None:
    world = World()
    world.look(("chair", box(0)), times=3)
    known = world.memory.known(box(0), 8)
    mask = LiftedMask(1, box(0), (("chair", 0.8),), 0.8, known.embedding[0], False, measured=False)
    view = CameraView(world.stamp + 1, np.eye(4), CAMERA, None, None)
    world.memory.observe(view, LiftedView(view.stamp_ns, (mask,), box(0)), None)
    again = world.memory.known(box(0), 8)
    assert (again.id.tolist(), again.looks.tolist(), again.observations.tolist()) == ([1], [3], [4])
