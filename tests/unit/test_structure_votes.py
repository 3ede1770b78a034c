"""The slot for a structure network: block around the robot, votes per voxel, geometry where votes are few."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from irsd.core.types import DeskewedScan, Structure, SyncedFrame
from irsd.mapping.mapper import Mapper, MappingSettings
from irsd.mapping.network import NetworkSettings, StructureVotes

HERE = np.zeros(3)


class Says:
    """A network with one opinion, which remembers what it was asked."""

    def __init__(self, kind: int) -> None:
        self.kind = kind
        self.asked: list[NDArray[np.float32]] = []

    def classify(self, points: NDArray[np.float32]) -> NDArray[np.uint8]:
        self.asked.append(points)
        return np.full(len(points), self.kind, np.uint8)


def points(count: int = 40, seed: int = 1) -> NDArray[np.float32]:
    return np.random.default_rng(seed).uniform(-6, 6, (count, 3)).astype(np.float32)


def test_no_points_no_votes() -> None:
    votes = StructureVotes(NetworkSettings(), Says(1))
    assert len(votes.look(np.zeros((0, 3), np.float32), np.zeros(0, np.float32), HERE)) == 0


def test_the_network_sees_the_block_around_the_robot_and_only_when_due() -> None:
    model, mean, base = Says(Structure.DOOR), points(), np.array([1.0, 0.5, 0.0])
    votes = StructureVotes(NetworkSettings(block_m=6.0, every_scans=3), model)
    hits = np.ones(len(mean), np.float32)
    hits[::5] = 0
    found = [votes.look(mean, hits, base) for _ in range(4)]
    expected = np.flatnonzero((np.abs(mean - base) <= 3.0).all(1) & (hits > 0))
    assert [len(f) for f in found] == [len(expected), 0, 0, len(expected)]
    np.testing.assert_array_equal(np.sort(found[0]), expected)
    np.testing.assert_allclose(model.asked[0], mean[found[0]] - base, atol=1e-6)


def test_votes_outweigh_geometry_once_there_are_enough_and_end_with_their_voxel() -> None:
    mean = np.zeros((3, 3), np.float32)
    votes = StructureVotes(NetworkSettings(every_scans=1, votes=2), Says(Structure.WINDOW))
    rows, geometry = np.arange(3), np.full(3, Structure.WALL, np.uint8)
    votes.look(mean, np.ones(3, np.float32), HERE)
    assert (votes.labels(rows, mean, geometry) == Structure.WALL).all()
    votes.look(mean, np.ones(3, np.float32), HERE)
    assert (votes.labels(rows, mean, geometry) == Structure.WINDOW).all()
    elsewhere = mean + np.float32(5.0)
    assert (votes.labels(rows, elsewhere, geometry) == Structure.WALL).all()


def test_a_network_that_gives_nonsense_is_refused() -> None:
    votes = StructureVotes(NetworkSettings(every_scans=1), Says(17))
    with pytest.raises(ValueError, match="structure network"):
        votes.look(points(), np.ones(40, np.float32), HERE)


def test_the_mapper_takes_the_networks_labels() -> None:
    model = Says(Structure.WINDOW)
    mapper = Mapper(MappingSettings(network=NetworkSettings(every_scans=1, votes=1, block_m=20.0)), model)
    cloud = points(300)
    pose = np.eye(4)
    for k in range(2):
        mapper.integrate(SyncedFrame(k, k, pose, DeskewedScan(k, cloud, np.array([0.0, 0.0, 0.5])), ()))
    used = mapper.voxels.hits[: mapper.voxels.row_count] > 0
    assert (mapper.voxels.structure[: mapper.voxels.row_count][used] == Structure.WINDOW).all()
