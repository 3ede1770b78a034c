"""Clouds with names for the shape encoder, out of furnished buildings as the map holds them (``scene``) and single things (``shape_data``).

python -m training.shape_set --scenes DIR --singles A.npz --seed 1 --out rows.npz

Of every thing several clouds: whole; and as masks and clusters in the product are: cut off, thinned, with bled edges, with a part of a
neighbour, with what stands on it or is pushed under it. All stand on the floor as ``shape.grounded`` has it. Beside them clouds that nobody can name: pieces of walls, halves of two things. Those are called ``object``.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from irsd.core.types import Structure
from irsd.perception.shape import UNKNOWN, features, grounded

LEAST, MOST = 6, 6000
Cloud = NDArray[np.float32]
Rng = np.random.Generator
_OF_SHELL = {int(Structure.DOOR): "door", int(Structure.WINDOW): "window"}


def clouds_of(path: Path, rng: Rng, variants: int) -> Iterator[tuple[Cloud, str]]:
    """(points, name) of one building's file."""
    with np.load(path) as data:
        names = data["names"]
        shot = f"_{int(data['shots']) - 1}"
        points, instance, truth, geometry = (data[k + shot] for k in ("points", "instance", "truth", "geometry"))
    loose = geometry == Structure.OTHER
    tree = cKDTree(points[loose])
    own_of = _groups(instance)
    for number, own in own_of.items():
        kept = own[loose[own]] if rng.random() < 0.75 and loose[own].sum() >= LEAST else own
        if len(kept) < LEAST:
            continue
        name = str(names[number - 1])
        yield points[kept], name
        for _ in range(variants):
            cloud = _worn(points[kept], rng)
            if rng.random() < 0.4:
                cloud = _swallowed(cloud, points[loose], instance[loose], number, rng)
            if rng.random() < 0.6:
                cloud = _bled(cloud, points[loose], tree, rng)
            if LEAST <= len(cloud) <= MOST:
                yield _coarser(cloud, rng), name
    yield from _unknown(points, truth, loose, own_of, rng)


def _groups(instance: NDArray[np.int16]) -> dict[int, NDArray[np.int64]]:
    order = np.argsort(instance, kind="stable")
    numbers, first = np.unique(instance[order], return_index=True)
    return {int(k): part for k, part in zip(numbers, np.split(order, first[1:]), strict=True) if k > 0}


def _worn(cloud: Cloud, rng: Rng) -> Cloud:
    """Cut off at a plane, thinned, or as it is."""
    if rng.random() < 0.45:
        depth = cloud @ rng.normal(size=3)
        cloud = cloud[depth > np.quantile(depth, rng.uniform(0, 0.5))]
    if rng.random() < 0.4:
        cloud = cloud[rng.random(len(cloud)) < rng.uniform(0.25, 1)]
    return cloud


def _bled(cloud: Cloud, around: Cloud, tree: cKDTree, rng: Rng) -> Cloud:
    """With points of what is near: a rim, or up to a third of its size on one side."""
    if len(cloud) < LEAST:
        return cloud
    some = cloud[rng.integers(0, len(cloud), min(len(cloud), 200))]
    if rng.random() < 0.5:  # on one side only
        some = some[some @ (direction := rng.normal(size=3)) > np.quantile(some @ direction, 0.6)]
    if not len(some):
        return cloud
    near = np.unique(
        np.concatenate([np.asarray(n, np.int64) for n in tree.query_ball_point(some, float(rng.uniform(0.05, 0.12)))])
    )
    near = (
        near[: max(len(cloud) // 2, 1)]
        if len(near) <= len(cloud) // 2
        else rng.choice(near, max(len(cloud) // 2, 1), replace=False)
    )
    return np.unique(np.concatenate([cloud, around[near]]), axis=0)


def _swallowed(cloud: Cloud, around: Cloud, owner: NDArray[np.int16], own: int, rng: Rng) -> Cloud:
    """With other things that stand on it or under it: chairs and their table, dishes, pillows. It stays most of the cloud."""
    if len(cloud) < 30:
        return cloud
    low, high = cloud.min(0) - np.float32([0.08, 0.08, 0.05]), cloud.max(0) + np.float32([0.08, 0.08, 0.3])
    inside = ((around > low) & (around < high)).all(1) & (owner != own) & (owner > 0)
    others = np.unique(owner[inside])
    taken = inside & np.isin(owner, others[rng.random(len(others)) < 0.7])
    rows = np.flatnonzero(taken)
    most = int(0.8 * len(cloud))
    rows = rows if len(rows) <= most else rng.choice(rows, most, replace=False)
    return np.concatenate([cloud, around[rows]])


def _coarser(cloud: Cloud, rng: Rng) -> Cloud:
    """As in a map of larger voxels, sometimes."""
    if rng.random() < 0.6:
        return cloud
    _, first = np.unique(np.floor(cloud / rng.uniform(0.04, 0.07)).astype(np.int64), axis=0, return_index=True)
    return cloud[first] if len(first) >= LEAST else cloud


def _unknown(
    points: Cloud, truth: NDArray[np.uint8], loose: NDArray[np.bool_], own_of: dict[int, NDArray[np.int64]], rng: Rng
) -> Iterator[tuple[Cloud, str]]:
    """Pieces of the shell, named where they are most of a door or window; and halves of two things side by side."""
    for kind in Structure:
        if kind == Structure.OTHER:
            continue
        rows = np.flatnonzero((truth == kind) & loose)
        rows = rows if len(rows) > 30 else np.flatnonzero(truth == kind)
        for _ in range(4 if len(rows) > 30 else 0):
            centre = points[rng.choice(rows)]
            mine = rows[np.linalg.norm((points[rows] - centre) * (1, 1, 0.5), axis=1) < rng.uniform(0.15, 2.0)]
            if len(mine) >= LEAST:
                cloud = _worn(points[mine], rng)[:MOST]
                name = _OF_SHELL.get(int(kind), UNKNOWN) if len(cloud) and np.ptp(cloud[:, 2]) > 0.8 else UNKNOWN
                if len(cloud) >= LEAST:
                    yield cloud, name
    numbers = list(own_of)
    middles = np.array([points[own].mean(0) for own in own_of.values()])
    for _ in range(min(6, len(numbers) // 3)):
        a = int(rng.integers(len(numbers)))
        b = int(np.argsort(np.linalg.norm(middles - middles[a], axis=1))[1])
        first, second = points[own_of[numbers[a]]], points[own_of[numbers[b]]]
        if min(len(first), len(second)) > 20 and 0.4 < len(first) / len(second) < 2.5:
            yield _coarser(np.concatenate([_worn(first, rng), _worn(second, rng)])[:MOST], rng), UNKNOWN


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=Path)
    parser.add_argument("--singles", type=Path, nargs="*", default=[])
    parser.add_argument("--variants", type=int, default=2)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, required=True)
    arguments = parser.parse_args()
    rng = np.random.default_rng(arguments.seed)
    points, measures, names = [], [], []
    for path in arguments.singles:
        with np.load(path) as data:
            for cloud, count, name in zip(data["points"], data["size"], data["name"], strict=True):
                a, b = features(grounded(cloud, 0.0), 0.0)
                b[5] = np.log(count) / 3  # 256 of them were kept
                points.append(a), measures.append(b), names.append(str(name))
    for path in sorted(arguments.scenes.glob("scene_*.npz")) if arguments.scenes else ():
        for cloud, name in clouds_of(path, rng, arguments.variants):
            a, b = features(grounded(cloud[rng.permutation(len(cloud))], 0.0), 0.0)
            points.append(a), measures.append(b), names.append(name)
    np.savez(
        arguments.out, points=np.stack(points).astype(np.float16), measures=np.stack(measures), name=np.array(names)
    )
    print(len(names), "clouds of", len(set(names)), "names")


if __name__ == "__main__":
    main()
