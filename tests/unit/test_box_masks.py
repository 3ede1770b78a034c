"""Masks of boxes from depth, against plain loops over cells and a scene made by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from irsd.perception.box_masks import (
    BoxMaskSettings,
    DepthPicture,
    draw_depth,
    main_part,
    masks_of_boxes,
    parts,
)

SETTINGS = BoxMaskSettings(cell_px=4, step_m=0.15, step_share=0.05, reach_px=12)


def flood(
    depth: NDArray[np.float32], usable: NDArray[np.bool_], settings: BoxMaskSettings
) -> list[set[tuple[int, int]]]:
    """Connected parts cell by cell, in the order of their first cells."""
    left = {(int(r), int(c)) for r, c in np.argwhere(usable)}
    out = []
    for start in sorted(left):
        if start not in left:
            continue
        left.discard(start)
        part, front = {start}, [start]
        while front:
            r, c = front.pop()
            for other in ((r + 1, c), (r - 1, c), (r, c + 1), (r, c - 1)):
                if other not in left:
                    continue
                near = min(depth[r, c], depth[other])
                if abs(depth[r, c] - depth[other]) <= max(settings.step_m, settings.step_share * near):
                    left.discard(other)
                    part.add(other)
                    front.append(other)
        out.append(part)
    return out


@pytest.mark.parametrize("seed", range(12))
def test_parts_equal_a_flood_fill(seed: int) -> None:
    rng = np.random.default_rng(seed)
    shape = tuple(rng.integers(1, 14, 2))
    depth = rng.choice([1.0, 1.1, 1.4, 6.0, 6.25, 6.5], shape).astype(np.float32)
    usable = rng.random(shape) < 0.8
    depth[~usable & (rng.random(shape) < 0.5)] = np.inf
    labels, count = parts(depth, usable, SETTINGS)
    wanted = flood(depth, usable, SETTINGS)
    assert count == len(wanted)
    found = [{(int(r), int(c)) for r, c in np.argwhere(labels == k)} for k in range(count)]
    assert sorted(map(sorted, found)) == sorted(map(sorted, wanted))
    assert (labels[~usable] == -1).all()
    part = main_part(depth, usable, SETTINGS)
    if not wanted:
        assert not part.any()
        return
    height, width = shape

    def weight(cells: set[tuple[int, int]]) -> float:
        return sum(
            math.exp(-0.5 * (((r + 0.5) / height - 0.5) ** 2 + ((c + 0.5) / width - 0.5) ** 2) / 0.25**2)
            for r, c in cells
        )

    mine = {(int(r), int(c)) for r, c in np.argwhere(part)}
    assert mine in wanted
    assert weight(mine) == pytest.approx(max(map(weight, wanted)))


@pytest.mark.parametrize("seed", range(10))
def test_cells_take_the_nearest_point_of_the_nearest_cell(seed: int) -> None:
    rng = np.random.default_rng(seed)
    hw = (int(rng.integers(20, 60)), int(rng.integers(20, 60)))
    count = int(rng.choice([1, 5, 20, 300]))
    pixel = rng.uniform(-8, 66, (count, 2)).astype(np.float32)
    depth = rng.uniform(1, 9, count).astype(np.float32)
    structural = rng.random(count) < 0.5
    picture = draw_depth(pixel, depth, structural, hw, SETTINGS)
    rows, columns = -(-hw[0] // 4), -(-hw[1] // 4)
    assert picture.depth_m.shape == picture.structural.shape == (rows, columns)
    drawn: dict[tuple[int, int], tuple[float, bool]] = {}
    for (u, v), d, s in zip(pixel.tolist(), depth.tolist(), structural.tolist(), strict=True):
        cell = (math.floor((v + 0.5) / 4), math.floor((u + 0.5) / 4))
        if 0 <= cell[0] < rows and 0 <= cell[1] < columns and d < drawn.get(cell, (math.inf, False))[0]:
            drawn[cell] = (d, s)
    for r in range(rows):
        for c in range(columns):
            away = {cell: math.dist(cell, (r, c)) for cell in drawn}
            least = min(away.values(), default=math.inf)
            got = (float(picture.depth_m[r, c]), bool(picture.structural[r, c]))
            if least * 4 > SETTINGS.reach_px:
                assert got == (math.inf, False)
            else:
                assert got in [drawn[cell] for cell, far in away.items() if far <= least + 1e-9]


def scene() -> tuple[DepthPicture, NDArray[np.bool_]]:
    """A box 2 m away on the floor before a wall 4 m away, 240 x 320 pixels, a point every four: and where the box is."""
    v, u = np.mgrid[2:240:4, 2:320:4]
    depth = np.full(u.shape, 4.0, np.float32)
    floor = v >= 160
    depth[floor] = 4.0 - 3.0 * (v[floor] - 160) / 80
    thing = (u >= 100) & (u < 180) & (v >= 100) & (v < 212)
    depth[thing] = 2.0
    structural = ~thing
    pixel = np.stack([u.ravel(), v.ravel()], 1).astype(np.float32)
    picture = draw_depth(pixel, depth.ravel(), structural.ravel(), (240, 320), SETTINGS)
    mask = np.zeros((240, 320), np.bool_)
    mask[100:212, 100:180] = True
    return picture, mask


def test_a_thing_is_cut_from_wall_and_floor() -> None:
    picture, wanted = scene()
    found = masks_of_boxes(np.array([[90, 92, 190, 220]], np.float32), picture, (240, 320), SETTINGS)
    np.testing.assert_array_equal(found.masks[0], wanted)
    assert found.scores[0] == 1


def test_depth_alone_cuts_the_wall() -> None:
    picture, _ = scene()
    blind = DepthPicture(picture.depth_m, np.zeros_like(picture.structural), picture.cell_px)
    found = masks_of_boxes(np.array([[90, 92, 190, 200]], np.float32), blind, (240, 320), SETTINGS)
    assert not found.masks[0][92:100, 90:190].any()
    assert found.masks[0][100:200, 100:180].all()


def test_a_box_of_nothing_but_structure_keeps_it() -> None:
    picture, _ = scene()
    found = masks_of_boxes(np.array([[200, 20, 260, 80]], np.float32), picture, (240, 320), SETTINGS)
    assert found.masks[0][20:80, 200:260].all()
    assert found.masks[0].sum() == 60 * 60


def test_boxes_off_the_picture_and_without_depth() -> None:
    picture, _ = scene()
    boxes = np.array([[-50, -50, 20, 20], [310, 230, 400, 300], [400, 0, 500, 10], [50, 50, 50, 80]], np.float32)
    found = masks_of_boxes(boxes, picture, (240, 320), SETTINGS)
    assert found.masks[0, :20, :20].any()
    assert not found.masks[0, 20:].any()
    assert found.masks[1].any()
    assert not found.masks[2:].any()
    nothing = draw_depth(
        np.zeros((0, 2), np.float32), np.zeros(0, np.float32), np.zeros(0, np.bool_), (240, 320), SETTINGS
    )
    dark = masks_of_boxes(np.array([[10.2, 20.4, 33.3, 40]], np.float32), nothing, (240, 320), SETTINGS)
    assert dark.scores[0] == 0
    assert dark.masks[0].sum() == 20 * 23
    assert dark.masks[0, 20:40, 10:33].all()
    assert masks_of_boxes(boxes[:0], picture, (240, 320), SETTINGS).masks.shape == (0, 240, 320)


@pytest.mark.parametrize("cell_px", [1, 3, 8])
def test_masks_never_leave_their_boxes(cell_px: int) -> None:
    rng = np.random.default_rng(cell_px)
    settings = BoxMaskSettings(cell_px=cell_px)
    pixel = rng.uniform(0, 100, (300, 2)).astype(np.float32)
    picture = draw_depth(pixel, rng.uniform(1, 2, 300).astype(np.float32), rng.random(300) < 0.3, (77, 101), settings)
    low = rng.uniform(-5, 70, (20, 2))
    boxes = np.concatenate([low, low + rng.uniform(0, 40, (20, 2))], 1).astype(np.float32)
    for mask, (x0, y0, x1, y1) in zip(masks_of_boxes(boxes, picture, (77, 101), settings).masks, boxes, strict=True):
        rows, columns = np.nonzero(mask)
        if len(rows):
            assert rows.min() >= round(float(y0))
            assert rows.max() < round(float(y1))
            assert columns.min() >= round(float(x0))
            assert columns.max() < round(float(x1))
