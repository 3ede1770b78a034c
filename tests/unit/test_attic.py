"""Voxels at rest: packing loses nothing that counts, and a memory that packs answers as one that does not."""

from __future__ import annotations

import dataclasses
from array import array

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from test_memory import World, box, embed, two_rooms

from irsd.core.types import InstanceState
from irsd.instances.blocks import block_of, find_resting, key_at, place_in_block, resting_blocks
from irsd.instances.memory import FusionSettings, InstanceMemory
from irsd.instances.pack import pack_all, read_palette
from irsd.instances.settle import Limits
from irsd.instances.table import enter_key, new_table
from irsd.instances.voxel_memory import VoxelMemory
from irsd.instances.voxels import CLAIMS, MOST, NOBODY, voxel_keys

EVERYTHING = Limits(0.2, 0.3, 0.0, 0.9, True, 0.25, 0.25)
VOXEL_M = 0.04


def filled(seed: int) -> tuple[VoxelMemory, NDArray[np.int64]]:
    """Voxels of a few blocks about the origin with claims of slots 0..8 (id = 100 + slot), and their keys."""
    rng = np.random.default_rng(seed)
    memory = VoxelMemory(VOXEL_M, 64)
    points = ((rng.integers(-20, 20, (rng.integers(1, 900), 3)) + rng.uniform(0.01, 0.99, 3)) * VOXEL_M).astype(
        np.float32
    )
    keys = np.unique(voxel_keys(points, memory.per_m))
    memory.gather(points, np.array([0, len(points)], np.int64))
    rows, cells = memory.find(keys), memory.cells
    for row in rows.tolist():
        count = int(rng.integers(1, CLAIMS + 1))
        cells.owner[row, :count] = rng.choice(9, count, replace=False)
        cells.hits[row, :count] = rng.integers(1, MOST, count)
        cells.seen[row, :count] = rng.integers(1, MOST, count)
        cells.views[row] = rng.integers(0, MOST)
    return memory, keys


def told(memory: VoxelMemory, keys: NDArray[np.int64]) -> list[tuple[object, ...]]:
    """All that counts of voxels: views and claims, in any order of these."""
    cells, rows = memory.cells, memory.find(keys)
    assert (rows >= 0).all()
    out = []
    for row in rows.tolist():
        claims = [
            (int(cells.owner[row, c]), int(cells.hits[row, c]), int(cells.seen[row, c]))
            for c in range(CLAIMS)
            if cells.owner[row, c] != NOBODY
        ]
        out.append((int(cells.views[row]), sorted(claims)))
    return out


@pytest.mark.parametrize("seed", range(6))
def test_a_block_comes_back_as_it_was(seed: int) -> None:
    memory, keys = filled(seed)
    before, cells = told(memory, keys), memory.cells
    points, mass = cells.point[memory.find(keys)], cells.mass[memory.find(keys)]
    levels, ids = np.ones(9, np.float32), np.arange(100, 109)
    blocks, rows, offset = resting_blocks(cells, int(memory.counts[0]), np.zeros(9, np.int32), 1)
    assert sorted(rows.tolist()) == sorted(memory.find(keys).tolist())
    assert all(
        block_of(int(cells.key[r])) == b for b, s, e in zip(blocks, offset, offset[1:], strict=False) for r in rows[s:e]
    )
    mine = np.zeros(len(cells.key), np.uint8)
    mine[rows] = np.random.default_rng(seed).integers(0, 16, len(rows))
    owning = {
        int(cells.key[r]): {int(cells.owner[r, c]) for c in range(CLAIMS) if mine[r] >> c & 1} - {NOBODY} for r in rows
    }
    data, ends = pack_all(cells, levels, ids, rows, offset, mine, EVERYTHING, memory.per_m)
    memory.drop(rows)
    assert len(memory) == 0
    for k, block in enumerate(blocks.tolist()):
        part = data[ends[k] : ends[k + 1]]
        slots = np.array(read_palette(part.tobytes()), np.int32) - np.int32(100)
        opened = memory.unpack(part, slots, block, 7)
        for row, claims, flags in zip(opened.rows.tolist(), opened.slots, opened.owned, strict=True):
            assert set(claims[flags].tolist()) == owning[int(memory.cells.key[row])]
    assert told(memory, keys) == before
    again = memory.find(keys)
    assert (memory.cells.frame[again] == 7).all()
    np.testing.assert_allclose(memory.cells.point[again], points, atol=VOXEL_M / 31)
    assert ((memory.cells.mass[again] <= mass) & (2 * memory.cells.mass[again] > mass)).all()


@given(st.integers(-(2**19), 2**19), st.integers(-(2**19), 2**19), st.integers(-(2**19), 2**19))
def test_block_and_place_are_the_key(i: int, j: int, k: int) -> None:
    half = 1 << 20
    key = ((i + half) << 42) | ((j + half) << 21) | (k + half)
    assert key_at(block_of(key), place_in_block(key)) == key


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_points_find_the_blocks_they_lie_in_at_borders_too(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cells = rng.integers(-3, 3, (40, 3)) * 16 + rng.choice([0, 0, 1e-5, -1e-5, 8.5], (40, 3))
    points = (cells * VOXEL_M).astype(np.float32)
    of_point = [block_of(int(key)) for key in voxel_keys(points, 1.0 / VOXEL_M)]
    packed = sorted(set(of_point))[::2] or of_point[:1]
    blocks, table = np.zeros(256, np.int64), new_table(10)
    blocks[: len(packed)] = packed
    for place in range(len(packed)):
        enter_key(table, packed[place], place)
    found = find_resting(table, blocks, points, 1.0 / VOXEL_M).tolist()
    assert sorted(blocks[found].tolist()) == sorted(set(of_point) & set(packed))


# ----------------------------------------------------------------------------------------------------------- the memory
def tour(rest_views: int, seed: int) -> tuple[World, list[tuple[int, ...]]]:
    """A robot looks at twelve things here and there, some rows of pictures at each place, and comes back."""
    rng = np.random.default_rng(seed)
    world = World(dataclasses.replace(FusionSettings(), rest_views=rest_views), rooms=two_rooms())
    names, log = ["chair", "sofa", "lamp", "book", "desk"], []
    things = [(names[k % 5], box(-1.92 + 0.32 * k, 0.28)) for k in range(12)]
    for _ in range(14):
        place = int(rng.integers(11))
        for _ in range(int(rng.integers(2, 9))):
            shown = [things[k] for k in (place, place + 1) if rng.random() < 0.9]
            world.look(*shown, seen=things[place][1])
        update = world.collect()
        log += [tuple(s.id for s in update.changed), update.ended]
    return world, log


def compared(one: tuple[InstanceState, ...], other: tuple[InstanceState, ...]) -> None:
    for a, b in zip(one, other, strict=True):
        for name in ("id", "labels", "room", "observations", "existence", "first_seen_ns", "last_seen_ns", "state"):
            assert getattr(a, name) == getattr(b, name)
        clouds = [np.unique(voxel_keys(s.points_map, 1.0 / VOXEL_M)) for s in (a, b)]
        np.testing.assert_array_equal(clouds[0], clouds[1])
        assert a.embedding is not None
        assert b.embedding is not None
        np.testing.assert_allclose(a.embedding, b.embedding, atol=1e-3)


@pytest.mark.parametrize("seed", range(5))
def test_packing_changes_no_answer(seed: int) -> None:
    (resting, log), (awake, other) = tour(3, seed), tour(1_000_000, seed)
    assert log == other
    assert len(resting.memory._voxels) < len(awake.memory._voxels)
    probes = np.concatenate([box(x, 0.28) for x in np.arange(-2.0, 2.0, 0.16)])
    np.testing.assert_array_equal(resting.memory.claimed(probes), awake.memory.claimed(probes))
    compared(resting.memory.states(), awake.memory.states())


def test_same_pictures_same_bytes() -> None:
    one, two = (tour(3, 1)[0].memory.states() for _ in range(2))
    for a, b in zip(one, two, strict=True):
        assert a.points_map.tobytes() == b.points_map.tobytes()
        assert a.embedding is not None
        assert b.embedding is not None
        assert a.embedding.tobytes() == b.embedding.tobytes()


def test_what_nobody_looks_at_costs_no_rows_and_no_slot_until_it_is_seen_again() -> None:
    world = World(dataclasses.replace(FusionSettings(), rest_views=8))
    for k in range(60):
        world.look(("chair", box(k, 0.4)), times=4)
        world.collect()
    memory = world.memory
    assert len(memory) == 60
    assert len(memory._voxels) < 8 * len(box(0, 0.4))
    assert len(memory._roster.by_slot) < 8
    assert len(memory._roster.things.id) == 64
    world.look(("chair", box(0, 0.4)))
    (state,) = world.collect().changed
    assert (state.id, state.observations, len(state.points_map)) == (1, 5, len(box(0, 0.4)))


def test_rooms_reach_what_is_at_rest() -> None:
    world = World(dataclasses.replace(FusionSettings(), rest_views=4))
    world.look(("chair", box(-1)), times=4)
    world.collect()
    world.look(("sofa", box(1)), times=20)
    world.collect()
    world.rooms = two_rooms()
    world.look(("sofa", box(1)))
    assert {s.labels[0][0]: s.room for s in world.collect().changed} == {"chair": 1, "sofa": 2}


def test_what_owns_no_voxel_awake_or_in_its_outline_keeps_its_room_when_rooms_change() -> None:
    world = World(dataclasses.replace(FusionSettings(), rest_views=4))
    world.look(("chair", box(-1)), ("sofa", box(1)), times=4)
    world.collect()
    (chair, sofa) = (world.memory._roster.by_id[s.id] for s in world.memory.states())
    chair.owned, chair.blocks = chair.owned[:0], array("q", [1])  # what it owns is at rest, what it only claims is not
    world.memory.follow_rooms(two_rooms())
    assert [world.memory._roster.things.room[i.slot] for i in (chair, sofa)] == [0, 2]
    chair.outline = np.zeros((0, 3), np.float32)
    world.memory.follow_rooms(None)
    assert world.memory._roster.things.room[chair.slot] == 0


def test_a_stored_map_of_many_things_is_put_to_rest_at_once() -> None:
    world = World()
    for k in range(10):
        world.look(("chair", box(k)), times=4)
    world.collect()
    states = world.memory.states()
    many = [
        dataclasses.replace(s, id=s.id + 10 * k, points_map=s.points_map + np.float32(12 * k))
        for k in range(60)
        for s in states
    ]
    memory = InstanceMemory(FusionSettings(), embed)
    memory.restore(many)
    assert len(memory) == 600
    assert len(memory._voxels) == 0
    assert memory.claimed(box(24, y=24, z=24.48)[:3]).tolist() == [21] * 3
    back = memory.states()
    assert [s.id for s in back] == sorted(s.id for s in many)
    assert all(
        len(a.points_map) == len(b.points_map) for a, b in zip(back, sorted(many, key=lambda s: s.id), strict=True)
    )
