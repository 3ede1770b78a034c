"""Parts of the map become things where no picture made one; the camera's instances come first; ids stay while the map grows."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from irsd.core.types import InstanceState, InstanceUpdate, LooseChange
from irsd.instances.part import ProposalSettings
from irsd.instances.pieces import pieces_of
from irsd.instances.proposals import Proposals

SECOND = 1_000_000_000
VOXEL = 0.04
Floats = NDArray[np.float32]


def box(x: float, y: float, size: tuple[float, float, float], z: float = 0.3) -> Floats:
    """The shell of a box as voxel centres."""
    axes = [np.arange(0, s, VOXEL) + VOXEL / 2 for s in size]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    low, high = grid.min(0), grid.max(0)
    shell = (np.isclose(grid, low) | np.isclose(grid, high)).any(1)
    return (grid[shell] + (x, y, z)).astype(np.float32)


class Map:
    """Rows and points as a voxel map hands them out, and a camera's claims on them."""

    def __init__(self) -> None:
        self.points = np.zeros((0, 3), np.float32)
        self.claimed: dict[int, Floats] = {}
        self.ids = itertools.count(1)
        self.proposals = Proposals(ProposalSettings(settle_s=4.0), lambda: next(self.ids))
        self.now_s = 0

    def change(self, *parts: NDArray[np.int32], gone: NDArray[np.int32] | None = None) -> None:
        rows = np.concatenate([np.zeros(0, np.int32), *parts]).astype(np.int32)
        offset = np.cumsum([0, *map(len, parts)]).astype(np.int64)
        nothing = np.zeros(0, np.int32)
        self.proposals.take(
            LooseChange(rows, self.points[rows], offset, nothing if gone is None else gone), self.now_s * SECOND
        )

    def add(self, points: Floats) -> NDArray[np.int32]:
        self.points = np.concatenate([self.points, points])
        return np.arange(len(self.points) - len(points), len(self.points), dtype=np.int32)

    def rows_at(self, points: Floats) -> NDArray[np.int32]:
        key = {tuple(p): k for k, p in enumerate(np.floor(self.points / VOXEL).astype(int).tolist())}
        return np.array([key.get(tuple(p), -1) for p in np.floor(points / VOXEL).astype(int).tolist()], np.int32)

    def owners(self, points: Floats) -> NDArray[np.int64]:
        out = np.zeros(len(points), np.int64)
        for instance_id, mine in self.claimed.items():
            keys = {tuple(p) for p in np.floor(mine / VOXEL).astype(int).tolist()}
            out[[tuple(p) in keys for p in np.floor(points / VOXEL).astype(int).tolist()]] = instance_id
        return out

    def after(
        self, seconds: int, *camera: InstanceState, ended: tuple[int, ...] = ()
    ) -> tuple[dict[int, InstanceState], InstanceUpdate]:
        self.now_s += seconds
        self.claimed.update({state.id: state.points_map for state in camera})
        for instance_id in ended:
            del self.claimed[instance_id]
        stamp_ns = self.now_s * SECOND
        update = InstanceUpdate(stamp_ns, tuple(camera), ended, ())
        update = self.proposals.join(update, None, self.rows_at, self.owners, stamp_ns)
        return {state.id: state for state in update.changed}, update


def seen(instance_id: int, points: Floats) -> InstanceState:
    return InstanceState(instance_id, points, None, (("sofa", 1.0),), 0, 5, 1.0, 0, 0)


def test_a_part_is_told_once_it_keeps_its_size_and_keeps_its_id_while_it_grows() -> None:
    world = Map()
    whole = box(1.0, 1.0, (0.8, 0.6, 0.8))
    rows = world.add(whole)
    world.change(rows[: len(rows) // 3])
    assert world.after(2)[0] == {}
    world.change(rows[: len(rows) * 2 // 3])  # twice as large: the clock begins anew
    assert world.after(3)[0] == {}
    told, _ = world.after(2)
    (instance_id,) = told
    assert told[instance_id].observations == 0
    world.change(rows)
    told, update = world.after(6)
    assert list(told) == [instance_id]
    assert update.ended == ()
    assert len(told[instance_id].points_map) == len(whole)


def test_two_parts_that_prove_to_be_one_end_in_the_larger_ones_id() -> None:
    world = Map()
    a, b = world.add(box(0.0, 0.0, (1.0, 0.5, 0.5))), world.add(box(1.2, 0.0, (0.4, 0.4, 0.4)))
    world.change(a, b)
    told, _ = world.after(5)
    larger, smaller = sorted(told, key=lambda i: -len(told[i].points_map))
    world.change(np.concatenate([a, b, world.add(box(1.0, 0.0, (0.2, 0.4, 0.2)))]))
    told, update = world.after(5)
    assert larger in told
    assert update.ended == (smaller,)
    assert update.merged == ((larger, smaller),)


def test_what_the_camera_claims_is_the_cameras_and_is_completed_by_the_map() -> None:
    world = Map()
    whole = box(0.0, 0.0, (1.6, 0.8, 0.8))
    world.change(world.add(whole))
    (part,) = world.after(5)[0]
    told, update = world.after(1, seen(70, whole[whole[:, 0] < 0.8]))  # half of it, by a mask that was too small
    assert update.ended == (part,)
    assert update.merged == ((70, part),)
    assert len(told[70].points_map) == len(whole)
    assert told[70].labels == (("sofa", 1.0),)
    told, update = world.after(1, ended=(70,))  # the camera was wrong: the part is back under its own id
    assert list(told) == [part]
    assert set(update.ended) == {70}


def test_a_part_of_a_things_size_is_known_by_its_voxels() -> None:
    world = Map()
    whole, other, heap = box(1.0, 1.0, (0.8, 0.6, 0.8)), box(4.0, 1.0, (0.5, 0.5, 0.8)), box(0.0, 9.0, (6.0, 3.0, 1.0))
    rows, more, most = world.add(whole), world.add(other), world.add(heap)
    world.change(rows, more, most)
    world.after(2)
    numbers = world.proposals.alone(np.concatenate([[-1], rows, more, most, [10**6]]).astype(np.int32))
    first, second, third = np.split(numbers[1:-1], np.cumsum([len(rows), len(more)]))
    assert (numbers[0], numbers[-1]) == (0, 0)
    assert len({first[0], second[0], 0}) == 3
    assert set(first) == {first[0]}
    assert set(second) == {second[0]}
    assert not third.any()


def test_fragments_end_in_the_part_that_has_them_and_come_back_when_it_gives_them_up() -> None:
    world = Map()
    whole = box(1.0, 1.0, (1.6, 0.8, 0.6))
    world.change(world.add(whole))
    left = whole[whole[:, 0] < np.quantile(whole[:, 0], 0.2)]
    (part,) = world.after(6)[0]
    told, _ = world.after(2, seen(77, left))
    assert set(told) == {part, 77}
    (contest,) = world.proposals.contested()
    assert contest.fragments == (77,)
    assert len(contest.points_map) == len(whole)
    world.proposals.absorb(contest.number, [77])
    told, update = world.after(2)
    assert set(told) == {part}
    assert len(told[part].points_map) == len(whole)
    assert (update.ended, update.merged) == ((77,), ((part, 77),))
    told, _ = world.after(2, seen(77, left))  # the camera goes on seeing it
    assert 77 not in told
    assert list(world.proposals.absorbed) == [77]
    (contest,) = world.proposals.contested()
    assert contest.fragments == (77,)
    world.proposals.absorb(contest.number, [])
    told, update = world.after(2, seen(77, left))
    assert set(told) == {part, 77}
    assert update.ended == ()


def test_a_fragment_that_grows_out_of_its_part_is_free_and_so_are_those_of_a_part_that_ends() -> None:
    world = Map()
    whole, beside = box(1.0, 1.0, (1.6, 0.8, 0.6)), box(4.0, 1.0, (1.6, 0.8, 0.6))
    rows = world.add(whole)
    world.change(rows)
    world.add(beside)  # no part of its own
    left, right = (whole[whole[:, 0] < 1.5], whole[whole[:, 0] > 2.2])
    world.after(6)
    world.after(2, seen(77, left), seen(78, right))
    (contest,) = world.proposals.contested()
    assert contest.fragments == (77, 78)
    world.proposals.absorb(contest.number, [77, 78])
    assert set(world.after(2)[0]).isdisjoint({77, 78})
    told, _ = world.after(2, seen(77, np.concatenate([left, beside])))
    assert 77 in told
    assert list(world.proposals.absorbed) == [78]
    world.change(gone=rows)
    told, _ = world.after(2)
    assert 78 in told
    assert not world.proposals.absorbed


def test_a_fragment_that_moves_from_one_part_to_another_is_the_others_alone() -> None:
    world = Map()
    one, two = box(1.0, 1.0, (1.6, 0.8, 0.6)), box(6.0, 1.0, (1.6, 0.8, 0.6))
    rows = world.add(one)
    world.change(rows, world.add(two))
    world.after(6)
    few = [shape[shape[:, 0] < np.quantile(shape[:, 0], 0.2)] for shape in (one, two)]
    world.after(2, seen(77, few[0]))
    (contest,) = world.proposals.contested()
    world.proposals.absorb(contest.number, [77])
    world.after(2)
    world.after(2, seen(77, few[1]))
    (other,) = [c for c in world.proposals.contested() if c.number != contest.number]
    world.proposals.absorb(other.number, [77])
    assert 77 not in world.after(2)[0]
    world.change(gone=rows)  # the first part ends, and has nothing to give back
    assert 77 not in world.after(2)[0]
    assert list(world.proposals.absorbed) == [77]


def test_an_heir_gets_the_part_and_what_its_fragments_had() -> None:
    world = Map()
    whole = box(1.0, 1.0, (1.6, 0.8, 0.6))
    world.change(world.add(whole))
    first, second, third = (whole[(whole[:, 0] > a) & (whole[:, 0] <= b)] for a, b in ((0, 1.3), (1.4, 1.7), (2.2, 3)))
    (part,) = world.after(6)[0]
    world.after(2, seen(77, first), seen(78, second), seen(79, third))
    (contest,) = world.proposals.contested()
    assert contest.fragments == (77, 78, 79)
    world.proposals.absorb(contest.number, [78], heir=77)
    told, update = world.after(2)
    assert set(update.ended) <= {78, part}
    assert 78 in update.ended
    assert (77, 78) in update.merged
    has, all_of = {tuple(p) for p in told[77].points_map.tolist()}, {tuple(p) for p in whole.tolist()}
    assert has >= {tuple(p) for p in np.concatenate([first, second]).tolist()}
    assert has <= all_of - {tuple(p) for p in third.tolist()}
    assert len(has) > 0.9 * (len(whole) - len(third))  # but for a rim beside what another one has


def test_what_rests_gives_its_fragments_back() -> None:
    world = Map()
    whole = box(1.0, 1.0, (1.6, 0.8, 0.6))
    world.change(world.add(whole))
    world.after(6)
    world.after(2, seen(77, whole[whole[:, 0] < np.quantile(whole[:, 0], 0.2)]))
    (contest,) = world.proposals.contested()
    world.proposals.absorb(contest.number, [77])
    (part,) = world.after(2)[0]
    over, back = world.proposals.withdraw()
    assert over == (part,)
    assert [state.id for state in back] == [77]


def test_a_small_claim_takes_its_voxels_and_leaves_the_part_a_thing() -> None:
    world = Map()
    table, cup = box(0.0, 0.0, (1.6, 0.8, 0.8)), box(0.4, 0.4, (0.12, 0.12, 0.12), z=1.1)
    world.change(world.add(np.concatenate([table, cup])))
    (part,) = world.after(5)[0]
    told, update = world.after(1, seen(70, cup))
    assert update.ended == ()
    assert len(told[part].points_map) == len(table)
    assert len(told[70].points_map) == len(cup)


def test_a_part_that_was_carried_away_ends() -> None:
    world = Map()
    rows = world.add(box(0.0, 0.0, (0.5, 0.5, 0.5)))
    world.change(rows)
    (part,) = world.after(5)[0]
    world.change(gone=rows)
    assert world.after(1)[1].ended == (part,)


def test_beam_traces_specks_and_room_sized_heaps_are_no_things() -> None:
    world = Map()
    trace = np.stack([np.arange(0, 2.4, VOXEL), np.zeros(60), np.full(60, 1.2)], 1).astype(np.float32)
    world.change(
        world.add(trace), world.add(box(3.0, 0.0, (0.12, 0.12, 0.12))), world.add(box(0.0, 5.0, (6.0, 3.0, 1.0)))
    )
    assert world.after(6)[0] == {}


def test_withdrawn_things_come_back_under_their_ids_and_stored_ids_are_taken_up_again() -> None:
    world = Map()
    shape = box(0.0, 0.0, (0.6, 0.6, 0.6))
    world.change(world.add(shape))
    (part,) = world.after(5)[0]
    assert world.proposals.withdraw() == ((part,), ())
    told, _ = world.after(5)
    assert list(told) == [part]
    again = Map()
    again.proposals.restore([told[part]])
    again.ids = itertools.count(500)
    again.change(again.add((shape + np.float32(0.01)).astype(np.float32)))
    assert list(again.after(6)[0]) in ([], [part])  # under its old id, told again only if it differs
    again.change(again.add(box(3.0, 3.0, (0.6, 0.6, 0.6))))
    assert list(again.after(6)[0]) == [500]


def test_heaps_come_apart_where_their_voxels_do_not_touch() -> None:
    one, two = box(0.0, 0.0, (1.6, 0.6, 0.6)), box(1.76, 0.0, (1.6, 0.6, 0.6))
    speck = box(3.5, 0.0, (0.08, 0.08, 0.08))
    piece = pieces_of(np.concatenate([one, two, speck]), 0.05, 60)
    assert set(piece[: len(one)]) == {piece[0]}
    assert set(piece[len(one) :]) == {piece[-1]} != {piece[0]}
