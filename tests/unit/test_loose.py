"""Components of loose voxels, brought up to date piece by piece, are those of the whole map found at once."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from irsd.mapping.loose import LooseSettings, LooseVoxels
from irsd.mapping.structure import LevelMap, Levels, StructureSettings, WallLines
from irsd.mapping.voxels import VoxelMap, VoxelSettings

STRUCTURE = StructureSettings()


def test_components_grow_split_and_vanish_as_in_the_whole_map() -> None:
    rng = np.random.default_rng(5)
    voxels = VoxelMap(VoxelSettings(max_voxels=60_000))
    loose = LooseVoxels(LooseSettings(min_hits=1.0, cells=100, sweep_rows=0), STRUCTURE, voxels)
    levels, level_map, walls = Levels(STRUCTURE), LevelMap(STRUCTURE, 100.0), WallLines(STRUCTURE, 100.0)
    levels.floor_z_m = -5.0
    part_of: dict[int, int] = {}
    next_part = 0
    for scan in range(12):
        points = (rng.integers(0, 40, (300, 3)) * 0.08 + 0.02).astype(np.float32)
        touched = voxels.insert(points, np.array([0.0, 0.0, 1.0]), scan).rows
        loose.follow(touched, level_map, levels, walls)
        if scan % 3 == 2:
            some = rng.choice(voxels.live_rows(), 40, replace=False).astype(np.int32)
            loose.forget(some)
            voxels.remove(voxels.mean[some])
        while True:  # what a bounded call leaves waits for the next
            change = loose.changed()
            for row in change.gone.tolist():
                part_of.pop(row, None)
            for a, b in zip(change.offset[:-1].tolist(), change.offset[1:].tolist(), strict=True):
                part_of.update(dict.fromkeys(change.rows[a:b].tolist(), next_part))
                next_part += 1
            if not len(change.rows):
                break
    rows = voxels.live_rows()
    cells = np.floor(voxels.mean[rows] / 0.08).astype(int)
    filled = np.zeros((41, 41, 41), bool)
    filled[tuple(cells.T)] = True
    truth, _ = ndimage.label(filled, np.ones((3, 3, 3)))
    assert set(part_of) == set(rows.tolist())
    pairs = {(part_of[row], int(truth[tuple(cell)])) for row, cell in zip(rows.tolist(), cells.tolist(), strict=True)}
    assert len(pairs) == len({mine for mine, _ in pairs}) == len({true for _, true in pairs})
