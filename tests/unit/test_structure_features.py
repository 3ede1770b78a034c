"""What the structure network is told does not depend on where the block lies; and what is told of a recess is right."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from irsd.core.types import MapBlock
from irsd.perception.structure_features import FEATURES, smoothed, structure_features

FLOOR_M, CEILING_M, RECESS_M = 0.4, 3.0, 0.13


def wall_with_a_niche() -> MapBlock:
    """A wall along x that faces +y, 4 m long; between x = 1.6 and 2.4 its surface lies RECESS_M deeper up to 2 m: a closed door."""
    x, z = (v.ravel() for v in np.meshgrid(np.arange(0.02, 4, 0.0413), np.arange(0.02, 2.6, 0.0417)))
    deep = (np.abs(x - 2) < 0.4) & (z < 2.0)
    points = np.stack([x, np.where(deep, -RECESS_M, 0.0), z + FLOOR_M], axis=1).astype(np.float32)
    n = len(points)
    levels = np.tile(np.float32([FLOOR_M, CEILING_M, 0, 0]), (n, 1))
    levels[:, 2:] = points[:, 1:2]
    normals = np.tile(np.float32([0, 1, 0]), (n, 1))
    return MapBlock(points, normals, points.copy(), levels, np.where(deep, 0, 1).astype(np.uint8))


def test_shapes_and_no_voxels() -> None:
    block = wall_with_a_niche()
    found = structure_features(block)
    assert found.shape == (len(block.points), FEATURES)
    assert np.isfinite(found).all()
    none = MapBlock(*(part[:0] for part in (block.points, block.normals, block.surface, block.levels, block.geometry)))
    assert structure_features(none).shape == (0, FEATURES)


def test_where_the_block_lies_and_how_its_voxels_are_ordered_does_not_matter() -> None:
    block = wall_with_a_niche()
    shift = np.float32([16.0, -8.0, 1.25])
    levels = block.levels + np.float32([1.25, 1.25, 0, 0])
    order = np.random.default_rng(1).permutation(len(block.points))
    moved = MapBlock(
        (block.points + shift)[order], block.normals[order], (block.surface + shift)[order], levels[order], block.geometry[order]
    )  # fmt: skip
    # Means over cells and float32 sums in another order: a voxel at a cell's edge may fall on its other side.
    near = np.isclose(structure_features(moved), structure_features(block)[order], atol=2e-3)
    assert near.mean() > 0.99


def test_the_stretch_of_wall_tells_how_deep_the_niche_is_and_up_to_where() -> None:
    block = wall_with_a_niche()
    within = np.flatnonzero((np.abs(block.points[:, 0] - 2) < 0.05) & (block.points[:, 2] < FLOOR_M + 2))
    means = structure_features(block)[within, -24:-18]  # by height, in the short stretch
    np.testing.assert_allclose(means[:, :4], -RECESS_M, atol=1e-4)  # up to 1.75 m: the niche
    np.testing.assert_allclose(means[:, 5], 0, atol=1e-4)  # above 2.15 m: the lintel


def test_unknown_ceiling_and_no_wall_line_are_values_not_accidents() -> None:
    block = wall_with_a_niche()
    unknown = block.levels.copy()
    unknown[:, 1], unknown[:, 2:] = np.inf, np.nan
    assert np.isfinite(structure_features(replace(block, levels=unknown))).all()


def test_smoothing_joins_what_faces_alike_and_keeps_what_does_not() -> None:
    block = wall_with_a_niche()
    facing = block.normals.copy()
    facing[1::2] = (0, 0, 1)
    shares = np.zeros((len(facing), 6), np.float32)
    shares[0::2, 1], shares[1::2, 2] = 1, 1
    found = smoothed(replace(block, normals=facing), shares)
    np.testing.assert_allclose(found, shares, atol=1e-6)
    stray = shares.copy()
    stray[0] = np.float32([0.45, 0.55, 0, 0, 0, 0])[::-1]
    assert smoothed(replace(block, normals=facing), stray)[0].argmax() == 1
    np.testing.assert_allclose(found.sum(1), 1, atol=1e-5)
