"""A network's opinion of what voxels are part of: a slot for a point network with the role that OneFormer3D has in the paper.

Every few scans the voxels of the block of side N around the robot go through the network; its class per voxel is a vote. Many votes
outweigh one bad look, and where nothing was voted geometry decides alone.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from irsd.core.settings import setting
from irsd.core.types import MapBlock, Structure

_CLASSES = len(Structure)
_MOVED_M = 0.1  # a row whose point is farther than this from where it was voted on is another voxel by now


class StructureModel(Protocol):
    """Voxels in, what each is part of out."""

    def classify(self, block: MapBlock) -> NDArray[np.uint8]:
        """``Structure`` values uint8 [N] of a block's N voxels, positions relative to the robot."""


@dataclass(frozen=True)
class NetworkSettings:
    """When and on what the network runs."""

    model: str = setting(
        "", "what labels voxels: nano (our network), the path of an ONNX point network; empty: geometry alone"
    )
    block_m: float = setting(8.0, "side N of the block of points around the robot", lo=1.0, hi=100.0)
    every_scans: int = setting(30, "the network runs once in this many scans", lo=1, hi=10_000)
    max_points: int = setting(
        20_000, "voxels per run; of more, every n-th is taken, others each time", lo=100, hi=10_000_000
    )
    votes: int = setting(1, "votes from which a voxel's label is the network's", lo=1, hi=100)


class StructureVotes:
    """Votes per voxel row, uint8 [rows, classes]. The single writer."""

    def __init__(self, settings: NetworkSettings, model: StructureModel) -> None:
        self._settings, self._model = settings, model
        self._votes = np.zeros((0, _CLASSES), np.uint8)
        self._at = np.zeros((0, 3), np.float32)
        self._scans = 0
        self._turn = 0

    def due(self) -> bool:
        """One scan later: whether the network is to run."""
        self._scans += 1
        return (self._scans - 1) % self._settings.every_scans == 0

    def box(self, base: NDArray[np.float64]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Lowest and highest corner [3] of the block around the robot at base [3]."""
        half = self._settings.block_m / 2
        return (base - half).astype(np.float32), (base + half).astype(np.float32)

    def chosen(self, rows: NDArray[np.int32]) -> NDArray[np.int32]:
        """Of the block's rows those for this run: every n-th where there are too many, others each time."""
        step = max(-(-len(rows) // self._settings.max_points), 1)
        self._turn += 1
        return rows[self._turn % step :: step]

    def vote(self, rows: NDArray[np.int32], block: MapBlock, base: NDArray[np.float64], row_count: int) -> None:
        """Ask the network about voxel rows [M], which block describes (map frame), and count its votes. base [3]: the robot."""
        if not len(rows):
            return
        shift = base.astype(np.float32)
        levels = block.levels - np.array([shift[2], shift[2], 0, 0], np.float32)
        near = replace(block, points=block.points - shift, surface=block.surface - shift, levels=levels)
        classes = self._model.classify(near)
        if classes.shape != (len(rows),) or classes.max(initial=0) >= _CLASSES:
            raise ValueError(
                f"the structure network gave {classes.shape} up to {classes.max(initial=0)} for {len(rows)} points"
            )
        self._reserve(row_count)
        self._forget_moved(rows, block.points)
        self._at[rows] = block.points
        votes = self._votes[rows, classes]
        self._votes[rows, classes] = votes + (votes < 255)

    def labels(
        self, rows: NDArray[np.integer], points: NDArray[np.float32], geometry: NDArray[np.uint8]
    ) -> NDArray[np.uint8]:
        """Labels uint8 [M] of rows [M] at points [M, 3]: the class with most votes, geometry's where there are too few, and where it
        is among the best."""
        known = rows < len(self._votes)
        out = geometry.copy()
        self._forget_moved(rows[known], points[known])
        votes = self._votes[rows[known]]
        best = votes.max(1, initial=0)
        agrees = votes[np.arange(len(votes)), geometry[known]] == best
        out[known] = np.where((best >= self._settings.votes) & ~agrees, votes.argmax(1), geometry[known])
        return out

    def _reserve(self, rows: int) -> None:
        more = rows - len(self._votes)
        if more > 0:
            self._votes = np.pad(self._votes, ((0, more), (0, 0)))
            self._at = np.pad(self._at, ((0, more), (0, 0)), constant_values=np.nan)

    def _forget_moved(self, rows: NDArray[np.integer], points: NDArray[np.float32]) -> None:
        """Rows are used again for other voxels once theirs is forgotten."""
        moved = ~(np.abs(self._at[rows] - points).max(1, initial=0.0) <= _MOVED_M)
        self._votes[rows[moved]] = 0
