"""The voxel index and the matching of masks to instances, against plain dictionaries and loops."""

from __future__ import annotations

import numpy as np
import pytest

from irsd.instances.associate import SLOTS, Shared, VoxelIndex, choose, shared_voxels, voxel_keys


def keys_of(*numbers: int) -> np.ndarray:
    return np.array(numbers, np.int64)


def test_empty_index() -> None:
    index = VoxelIndex(4)
    assert index.find(keys_of()).tolist() == []
    assert index.find(keys_of(3, -1)).tolist() == [-1, -1]
    assert index.insert(keys_of()).tolist() == []
    assert len(index) == 0
    none = np.zeros(0, np.int64)
    shared = shared_voxels(index, none, none, 0, none, 0.25)
    assert choose(shared, np.zeros((0, 0)), np.ones((0, 0), bool), 0.3, 0.8, 0.5).tolist() == []
    shared = shared_voxels(index, np.zeros(2, np.int64), np.full(2, -1), 1, none, 0.25)
    assert choose(shared, np.zeros((1, 0)), np.ones((1, 0), bool), 0.3, 0.8, 0.5).tolist() == [0]


def test_voxel_keys_are_the_cells() -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform(-50, 50, (2000, 3)).astype(np.float32)
    keys = voxel_keys(points, 0.04)
    cells = [tuple(np.floor(p.astype(np.float64) / 0.04).astype(int)) for p in points]
    assert len(set(keys.tolist())) == len(set(cells))
    assert len({(k, c) for k, c in zip(keys.tolist(), cells, strict=True)}) == len(set(cells))


@pytest.mark.parametrize("seed", range(3))
def test_index_equals_a_dictionary_while_it_grows(seed: int) -> None:
    rng = np.random.default_rng(seed)
    index, expected = VoxelIndex(4), {}
    for _ in range(30):
        keys = np.unique(rng.integers(0, 4000, 150))
        rng.shuffle(keys)
        rows = index.insert(keys)
        for key, row in zip(keys.tolist(), rows.tolist(), strict=True):
            assert expected.setdefault(key, len(expected)) == row
        asked = rng.integers(-10, 4010, 300)
        assert index.find(asked).tolist() == [expected.get(k, -1) for k in asked.tolist()]
    assert len(index) == len(expected)


def test_colliding_keys_are_kept_apart() -> None:
    index = VoxelIndex(64)
    keys = np.arange(60, dtype=np.int64) << 40  # equal in all low bits
    assert index.insert(keys).tolist() == list(range(60))
    assert index.find(keys).tolist() == list(range(60))


@pytest.mark.parametrize("seed", range(4))
def test_claims_and_owners_equal_brute_force(seed: int) -> None:
    rng = np.random.default_rng(seed)
    index, truth = VoxelIndex(8), [{} for _ in range(40)]
    index.insert(np.arange(40))
    for _ in range(60):
        pairs = {(int(r), int(i)) for r, i in zip(rng.integers(0, 40, 25), rng.integers(1, SLOTS + 1, 25), strict=True)}
        rows, ids = np.array(sorted(pairs)).T
        index.claim(rows, ids, np.full(len(rows), 2.0, np.float32))
        for row, instance in sorted(pairs):
            hits, seen = truth[row].get(instance, (0, 2))
            truth[row][instance] = (hits + 1, seen + 1)
    expected = []
    for claims in truth:
        weights = {i: h * h / (s + 1) for i, (h, s) in claims.items() if h / (s + 1) >= 0.3}
        expected.append(min(weights, key=lambda i: (-weights[i], i)) if weights else 0)
    assert index.owners(np.arange(40), 0.3).tolist() == expected
    index.release(np.arange(40), 1)
    assert not (index.owner == 1).any()


def test_a_full_voxel_forgets_its_weakest_claim() -> None:
    index = VoxelIndex(4)
    row = index.insert(keys_of(7))
    for instance in range(1, SLOTS + 1):
        for _ in range(1 if instance == 2 else 3):
            index.claim(row, keys_of(instance), np.zeros(1, np.float32))
    index.claim(row, keys_of(9), np.zeros(1, np.float32))
    assert sorted(index.owner[0].tolist()) == sorted({*range(1, SLOTS + 1), 9} - {2})


def test_two_new_claims_on_one_voxel_in_one_picture() -> None:
    index = VoxelIndex(4)
    rows = np.repeat(index.insert(keys_of(1, 2)), 2)
    index.claim(rows, keys_of(5, 6, 5, 6), np.zeros(4, np.float32))
    assert np.sort(index.owner[:2], axis=1)[:, -2:].tolist() == [[5, 6], [5, 6]]


@pytest.mark.parametrize("seed", range(4))
def test_shared_voxels_equal_sets(seed: int) -> None:
    rng = np.random.default_rng(seed)
    instances = {i: set(rng.choice(300, 60, replace=False).tolist()) for i in (2, 5, 11)}
    index = VoxelIndex(16)
    for i, voxels in instances.items():
        rows = index.insert(np.array(sorted(voxels)))
        index.claim(rows, np.full(len(rows), i), np.zeros(len(rows), np.float32))
    masks = [set(rng.choice(400, n, replace=False).tolist()) for n in (50, 5, 120)]
    seen = set.union(*masks) | set(rng.choice(300, 100, replace=False).tolist())
    mask = np.concatenate([np.full(len(m), k) for k, m in enumerate(masks)])
    rows = index.find(np.concatenate([np.array(sorted(m)) for m in masks]))
    seen_rows = index.find(np.array(sorted(seen)))
    got = shared_voxels(index, mask, rows, len(masks), np.sort(seen_rows[seen_rows >= 0]), 0.25)
    met = [i for i in instances if any(m & instances[i] for m in masks)]
    assert got.ids.tolist() == met
    assert got.mask_voxels.tolist() == [len(m) for m in masks]
    for c, i in enumerate(met):
        visible = instances[i] & seen
        assert got.visible[c] == len(visible)
        for k, m in enumerate(masks):
            both = len(m & instances[i])
            assert got.voxels[k, c] == both
            assert got.overlap()[k, c] == pytest.approx(both / max(1, min(len(m), len(visible))))
            assert got.union()[k, c] == pytest.approx(both / max(1, len(m | visible)))


@pytest.mark.parametrize(
    ("shared", "mask", "visible", "cosine", "allowed", "chosen"),
    [
        (30, 100, 100, 0.9, True, 4),  # both criteria met, exactly at tau_g
        (29, 100, 100, 0.9, True, 0),  # too little overlap
        (30, 100, 100, 0.79, True, 0),  # too different a meaning
        (20, 20, 400, 0.2, True, 0),  # a book on a desk: inside it, but another thing
        (20, 20, 400, 0.9, True, 4),  # a part of the thing itself
        (80, 100, 100, 0.1, True, 4),  # the same voxels under another name
        (80, 100, 100, 0.9, False, 0),  # another room
    ],
)
def test_criteria(shared: int, mask: int, visible: int, cosine: float, allowed: bool, chosen: int) -> None:
    one = Shared(keys_of(4), np.array([[float(shared)]]), np.array([float(mask)]), np.array([float(visible)]))
    assert choose(one, np.array([[cosine]]), np.array([[allowed]]), 0.3, 0.8, 0.5).tolist() == [chosen]


def test_the_better_of_two_and_the_older_of_equals() -> None:
    shared = Shared(
        keys_of(3, 8), np.array([[40.0, 60.0], [50.0, 50.0]]), np.array([100.0, 100.0]), np.array([100.0, 100.0])
    )
    both = np.ones((2, 2), bool)
    assert choose(shared, np.full((2, 2), 0.9), both, 0.3, 0.8, 0.9).tolist() == [8, 3]
