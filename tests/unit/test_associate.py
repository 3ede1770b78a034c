"""The voxel memory and the matching of masks to instances, against plain dictionaries, sets and loops."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from irsd.instances.associate import Rules, Things, choose, dot, match, new_things, rooms_of_masks
from irsd.instances.settle import Limits, connected_parts, settle
from irsd.instances.table import drop_key, enter_key, find_key, new_table
from irsd.instances.voxel_memory import VoxelMemory
from irsd.instances.voxels import CLAIMS, FULL, MOST, add_evidence, voxel_keys

RULES = Rules(0.3, 0.8, 0.5, 0.25, 0.5, 0.5, 0.9, 0.0, 0.0, 0.95, 0.0, 0.8, 1.0)
NOTHING = np.zeros((0, 3), np.float32)


def centres(numbers: NDArray[np.int64] | list[int]) -> NDArray[np.float32]:
    """One point in each of some voxels of 1 m, by number."""
    n = np.asarray(numbers, np.int64)
    return np.stack([n % 7, n // 7 % 7, n // 49], -1).astype(np.float32) + np.float32(0.5)


def joined(lists: list[list[int]]) -> list[int]:
    return [v for one in lists for v in one]


def write(
    memory: VoxelMemory,
    masks: list[list[int]],
    slots: list[int],
    view: int,
    seen: list[int] | None = None,
    weight: int | None = None,
) -> None:
    """One picture straight into the voxels."""
    offset = np.cumsum([0, *map(len, masks)]).astype(np.int64)
    rows, starts = memory.gather(centres(joined(masks)), offset)
    shown = memory.sight(rows, centres(seen or []), view)
    observations = np.full(64, view, np.int32)
    weights = certain(rows) if weight is None else np.full(len(rows), weight, np.uint8)
    add_evidence(
        memory.cells, memory.counts, rows, weights, starts, np.array(slots, np.int32), shown, observations, 1.0
    )


def certain(rows: NDArray[np.int32]) -> NDArray[np.uint8]:
    return np.full(len(rows), FULL, np.uint8)


def test_voxel_keys_are_the_cells() -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform(-50, 50, (2000, 3)).astype(np.float32)
    keys = voxel_keys(points, 25.0)
    cells = [tuple(np.floor(p.astype(np.float64) * 25.0).astype(int)) for p in points]
    assert len(set(keys.tolist())) == len(set(cells))
    assert len({(k, c) for k, c in zip(keys.tolist(), cells, strict=True)}) == len(set(cells))


@pytest.mark.parametrize("seed", range(3))
def test_table_equals_a_dictionary_while_keys_come_and_go(seed: int) -> None:
    rng = np.random.default_rng(seed)
    table, rows = new_table(10), np.zeros(1000, np.int64)
    truth: dict[int, int] = {}
    pool = voxel_keys(centres(np.arange(700)), 1.0)
    free = list(range(1000))
    for _ in range(2500):
        key = int(rng.choice(pool))
        if key in truth and rng.random() < 0.6:
            drop_key(table, rows, key)
            free.append(truth.pop(key))
        elif key not in truth and len(truth) < 500:
            truth[key] = free.pop(int(rng.integers(len(free))))
            rows[truth[key]] = key
            enter_key(table, key, truth[key])
    assert [find_key(table, rows, key) for key in pool.tolist()] == [truth.get(k, -1) for k in pool.tolist()]


def test_memory_grows_and_reuses_rows() -> None:
    memory = VoxelMemory(1.0, 4)
    assert memory.find(np.zeros(0, np.int64)).tolist() == []
    keys = voxel_keys(centres(np.arange(300)), 1.0)
    rows = memory.insert(keys)
    assert sorted(rows.tolist()) == list(range(300))
    assert memory.insert(keys).tolist() == rows.tolist()
    memory.drop(rows[:100])
    assert len(memory) == 200
    assert memory.find(keys).tolist() == [-1] * 100 + rows[100:].tolist()
    assert set(memory.insert(keys[:100]).tolist()) == set(rows[:100].tolist())


@pytest.mark.parametrize("seed", range(4))
def test_evidence_equals_brute_force(seed: int) -> None:
    rng = np.random.default_rng(seed)
    memory = VoxelMemory(1.0, 8)
    truth: dict[int, dict[int, list[int]]] = {v: {} for v in range(60)}
    views = dict.fromkeys(range(60), 0)
    for view in range(1, 40):
        masks = [rng.choice(60, 15, replace=False).tolist() for _ in range(3)]
        slots = rng.integers(0, CLAIMS, 3).tolist()
        seen = rng.choice(60, 20, replace=False).tolist()
        known = {v for v in range(60) if views[v]}
        weight = int(rng.integers(1, FULL + 1))
        write(memory, masks, slots, view, seen, weight)
        for v in set(joined(masks)) | (set(seen) & known):
            views[v] += 1
            for slot in set(slots) & truth[v].keys():
                truth[v][slot][1] += FULL
        for slot in set(slots):
            for v in set(joined([m for m, s in zip(masks, slots, strict=True) if s == slot])):
                claim = truth[v].get(slot)
                if claim is None:
                    truth[v][slot] = [weight, FULL * min(views[v], view)]
                else:
                    claim[0] += weight
    rows = memory.find(voxel_keys(centres(np.arange(60)), 1.0))
    for v, row in enumerate(rows.tolist()):
        cells = memory.cells
        got = {
            int(o): [int(h), int(s)]
            for o, h, s in zip(cells.owner[row], cells.hits[row], cells.seen[row], strict=True)
            if row >= 0 and o >= 0
        }
        assert got == truth[v]


def test_a_full_voxel_forgets_its_weakest_claim() -> None:
    memory = VoxelMemory(1.0)
    view = 0
    for slot in range(CLAIMS):
        for _ in range(1 if slot == 2 else 3):
            view += 1
            write(memory, [[7]], [slot], view)
    write(memory, [[7]], [9], view + 1)
    row = memory.find(voxel_keys(centres([7]), 1.0))[0]
    assert sorted(memory.cells.owner[row].tolist()) == sorted({*range(CLAIMS), 9} - {2})


def test_long_runs_of_evidence_do_not_overflow() -> None:
    memory = VoxelMemory(1.0)
    write(memory, [[7]], [0], 1)
    row = memory.find(voxel_keys(centres([7]), 1.0))[0]
    memory.cells.hits[row, 0] = memory.cells.seen[row, 0] = MOST
    write(memory, [[7]], [0], 2)
    assert (memory.cells.hits[row, 0], memory.cells.seen[row, 0]) == (MOST // 2 + FULL, MOST // 2 + FULL)


def known(
    memory: VoxelMemory, voxels: list[int], slot: int, cosine: float, room: int = 0, things: Things | None = None
) -> Things:
    """An instance of some voxels, seen ten times, whose meaning has a cosine to (1, 0)."""
    things = new_things(64, 2) if things is None else things
    for view in range(10):
        write(memory, [voxels], [slot], 100 * slot + view + 1)
    things.id[slot], things.observations[slot], things.size[slot], things.room[slot] = slot + 1, 10, len(voxels), room
    things.mean[slot], things.length[slot], things.dim[slot] = (cosine, np.sqrt(1 - cosine**2)), 1.0, 2
    return things


def ask(memory: VoxelMemory, things: Things, masks: list[list[int]], seen: list[int], room: int = 0) -> list[int]:
    offset, view = np.cumsum([0, *map(len, masks)]).astype(np.int64), 5000 + int(memory.counts[2])
    rows, starts = memory.gather(centres(joined(masks)), offset)
    shown = memory.sight(rows, centres(seen), view)
    meanings = np.tile(np.array([[1.0, 0.0]], np.float32), (len(masks), 1))
    rooms = np.full((len(masks), 4), room, np.int32)
    found = match(
        memory.cells,
        things,
        rows,
        certain(rows),
        starts,
        shown,
        meanings,
        np.full(len(masks), 2, np.int32),
        rooms,
        RULES,
    )
    slots: list[int] = found.slots.tolist()
    return slots


@pytest.mark.parametrize(
    ("shared", "mask", "visible", "cosine", "same_room", "chosen"),
    [
        (30, 100, 100, 0.9, True, 4),  # both criteria met, exactly at tau_g
        (29, 100, 100, 0.9, True, -1),  # too little overlap
        (30, 100, 100, 0.79, True, -1),  # too different a meaning
        (20, 20, 140, 0.2, True, -1),  # a book on a desk: inside it, but another thing
        (20, 20, 140, 0.9, True, 4),  # a part of the thing itself
        (80, 100, 100, 0.1, True, 4),  # the same voxels under another name
        (80, 100, 100, 0.9, False, -1),  # another room
    ],
)
def test_criteria(shared: int, mask: int, visible: int, cosine: float, same_room: bool, chosen: int) -> None:
    memory = VoxelMemory(1.0)
    voxels = list(range(visible))
    things = known(memory, voxels, 4, cosine, 1)
    start = visible - shared
    assert ask(memory, things, [list(range(start, start + mask))], voxels, 1 if same_room else 2) == [chosen]
    assert (things.column == -1).all()


def test_the_better_of_two_and_the_older_of_equals() -> None:
    memory = VoxelMemory(1.0)
    things = known(memory, list(range(100)), 3, 0.9)
    known(memory, list(range(100, 200)), 8, 0.9, things=things)
    seen = list(range(200))
    assert ask(memory, things, [list(range(60, 160))], seen) == [8]
    assert ask(memory, things, [list(range(50, 150))], seen) == [3]


def test_nothing_to_match() -> None:
    memory = VoxelMemory(1.0)
    assert ask(memory, new_things(64, 2), [], []) == []
    assert ask(memory, new_things(64, 2), [[1, 2]], []) == [-1]


def test_several_masks_for_one_instance_part_where_that_is_the_rule() -> None:
    things = new_things(4, 2)
    things.id[0], things.mean[0], things.length[0], things.dim[0] = 1, (1, 0), 1, 2
    shared, visible, sizes = np.array([[40], [60]], np.float32), np.array([100]), np.array([40, 60], np.float32)
    meanings = np.tile(np.array([[1.0, 0.0]], np.float32), (2, 1))
    arguments = (np.zeros(1, np.int32), meanings, np.full(2, 2, np.int32), np.zeros((2, 4), np.int32), RULES)
    assert choose(things, shared, visible, sizes, *arguments).tolist() == [0, 0]
    things.parted[0], things.whole[0] = 20, 1
    assert choose(things, shared, visible, sizes, *arguments).tolist() == [-1, 0]


@pytest.mark.parametrize("seed", range(4))
def test_settling_equals_brute_force(seed: int) -> None:
    rng = np.random.default_rng(seed)
    memory, things = VoxelMemory(1.0), new_things(64, 2)
    for slot in range(3):
        things.id[slot] = slot + 1
    for view in range(1, 30):
        masks = [rng.choice(np.arange(30 * s, 30 * s + 60), 25, replace=False).tolist() for s in range(3)]
        write(memory, masks, [0, 1, 2], view, rng.choice(120, 40, replace=False).tolist())
    limits = Limits(0.2, 0.3, 1.5, 2.0, False, 0.25, 0.25)
    cells, everything = memory.cells, np.arange(len(memory), dtype=np.int32)

    def claim(row: int, slot: int) -> tuple[float, float] | None:
        at = np.flatnonzero(cells.owner[row] == slot)
        return (float(cells.hits[row, at[0]]), float(cells.seen[row, at[0]])) if len(at) else None

    def least(share: float) -> float:
        return share + min(1.5 * FULL, share)

    for slot in range(3):
        hits = np.array([c[0] for r in everything.tolist() if (c := claim(r, slot))])
        things.level[slot] = (hits**2).sum() / hits.sum()
    for slot in range(3):
        got = settle(cells, things, np.concatenate([everything, everything[::3]]), 0, slot, limits)
        worths = {}
        for row in everything.tolist():
            for s in range(3):
                c = claim(row, s)
                level = float(things.level[s])
                enough = c and c[0] >= 0.2 * (c[1] + FULL) and c[0] >= max(2.0 * FULL, least(0.3 * level))
                worths[row, s] = c[0] / (c[1] + FULL) * (c[0] / level) if c and enough else 0.0
        owned = [
            r
            for r in everything.tolist()
            if worths[r, slot] > 0 and max((worths[r, s], -s) for s in range(3))[1] == -slot
        ]
        assert got.owned.tolist() == owned
        assert got.typical == pytest.approx(float(things.level[slot]))
        assert got.rows.tolist() == [r for r in everything.tolist() if claim(r, slot)]
        assert got.good == sum(worths[r, slot] > 0 for r in everything.tolist())


def test_dot_and_rooms() -> None:
    rng = np.random.default_rng(3)
    for n in (0, 1, 7, 8, 21, 512):
        a, b = rng.normal(size=(2, n)).astype(np.float32)
        assert dot(a, b, n) == pytest.approx(float(a.astype(np.float64) @ b), abs=1e-3)
    labels = np.repeat([[1, 2]], 2, 0).astype(np.int32)
    points = np.array([[0.5, 0.5, 0]] * 36 + [[1.5, 0.5, 0]] * 4 + [[9, 9, 0]] * 8, np.float32)
    offset = np.array([0, 40, 48], np.int64)
    assert rooms_of_masks(labels, 0.0, 0.0, 1.0, points, offset, 0.1).tolist() == [[1, 2, 0, 0], [0, 0, 0, 0]]
    assert rooms_of_masks(labels, 0.0, 0.0, 1.0, points, offset, 0.2).tolist() == [[1, 0, 0, 0], [0, 0, 0, 0]]


def test_no_points_no_parts() -> None:
    assert connected_parts(NOTHING, 0.1).tolist() == []
