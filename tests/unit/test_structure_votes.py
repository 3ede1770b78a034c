"""The slot for a structure network: block around the robot, votes per voxel, geometry where votes are few."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from irsd.core.types import DeskewedScan, MapBlock, Structure, SyncedFrame
from irsd.mapping.mapper import Mapper, MappingSettings
from irsd.mapping.network import NetworkSettings, StructureVotes

HERE = np.zeros(3)


class Says:
    """A network with one opinion, which remembers what it was asked."""

    def __init__(self, kind: int) -> None:
        self.kind = kind
        self.asked: list[MapBlock] = []

    def classify(self, block: MapBlock) -> NDArray[np.uint8]:
        self.asked.append(block)
        return np.full(len(block.points), self.kind, np.uint8)


def points(count: int = 40, seed: int = 1) -> NDArray[np.float32]:
    return np.random.default_rng(seed).uniform(-6, 6, (count, 3)).astype(np.float32)


def block(at: NDArray[np.float32]) -> MapBlock:
    n = len(at)
    flat = np.zeros((n, 3), np.float32)
    return MapBlock(at, flat, at.copy(), np.zeros((n, 4), np.float32), np.zeros(n, np.uint8))


def frame(k: int, cloud: NDArray[np.float32], base: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> SyncedFrame:
    pose = np.eye(4)
    pose[:3, 3] = base
    return SyncedFrame(k, k, pose, DeskewedScan(k, cloud, np.array([0.0, 0.0, 0.5])), ())


def test_no_points_no_votes() -> None:
    votes, none = StructureVotes(NetworkSettings(), Says(1)), np.zeros((0, 3), np.float32)
    votes.vote(np.zeros(0, np.int32), block(none), HERE, 0)
    labels = votes.labels(np.arange(2), np.zeros((2, 3), np.float32), np.full(2, 3, np.uint8))
    assert labels.tolist() == [3, 3]


def test_the_network_sees_the_block_around_the_robot_and_only_when_due() -> None:
    model, cloud, base = Says(Structure.DOOR), points(), (1.0, 0.5, 0.25)
    mapper = Mapper(MappingSettings(network=NetworkSettings(block_m=6.0, every_scans=3)), model)
    asked = []
    for k in range(4):
        mapper.integrate(frame(k, cloud, base))
        asked.append(len(model.asked))
    assert asked == [1, 1, 1, 2]
    inside = cloud[(np.abs(cloud - base) <= 3.0).all(1)] - np.float32(base)
    seen = model.asked[0].points
    np.testing.assert_allclose(seen[np.lexsort(seen.T)], inside[np.lexsort(inside.T)], atol=1e-6)


def test_of_too_many_voxels_every_one_gets_its_turn() -> None:
    votes = StructureVotes(NetworkSettings(max_points=100), Says(1))
    rows = np.arange(250, dtype=np.int32)
    runs = [votes.chosen(rows) for _ in range(3)]
    assert max(map(len, runs)) <= 100
    assert sorted(np.concatenate(runs).tolist()) == rows.tolist()


def test_votes_outweigh_geometry_once_there_are_enough_and_end_with_their_voxel() -> None:
    mean, rows = np.zeros((3, 3), np.float32), np.arange(3, dtype=np.int32)
    votes = StructureVotes(NetworkSettings(votes=2), Says(Structure.WINDOW))
    geometry = np.full(3, Structure.WALL, np.uint8)
    votes.vote(rows, block(mean), HERE, 3)
    assert (votes.labels(rows, mean, geometry) == Structure.WALL).all()
    votes.vote(rows, block(mean), HERE, 3)
    assert (votes.labels(rows, mean, geometry) == Structure.WINDOW).all()
    elsewhere = mean + np.float32(5.0)
    assert (votes.labels(rows, elsewhere, geometry) == Structure.WALL).all()


def test_a_network_that_gives_nonsense_is_refused() -> None:
    votes = StructureVotes(NetworkSettings(), Says(17))
    with pytest.raises(ValueError, match="structure network"):
        votes.vote(np.arange(40, dtype=np.int32), block(points()), HERE, 40)


def test_the_mapper_takes_the_networks_labels() -> None:
    model = Says(Structure.WINDOW)
    mapper = Mapper(MappingSettings(network=NetworkSettings(every_scans=1, votes=1, block_m=20.0)), model)
    cloud = points(300)
    for k in range(2):
        mapper.integrate(frame(k, cloud))
    used = mapper.voxels.hits[: mapper.voxels.row_count] > 0
    assert (mapper.voxels.structure[: mapper.voxels.row_count][used] == Structure.WINDOW).all()
