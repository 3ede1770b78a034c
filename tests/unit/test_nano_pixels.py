"""Our own segmenter and image encoder: what goes in, what is made of what comes out, and the shipped files."""

from __future__ import annotations

import dataclasses
import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import irsd.models
from irsd.core.errors import ModelError
from irsd.core.types import CameraModel, CameraView, Structure
from irsd.perception.job import Sight
from irsd.perception.nano_decode import MEASURES, OFFSET_CELLS, Regions, chosen, joined, regions_of, steps_between
from irsd.perception.nano_image import Geometry, NanoImageEncoder, network_inputs
from irsd.perception.nano_map import COLUMNS, ROWS, alone_cells, map_picture
from irsd.perception.nano_segmenter import PARTS, NanoSegmenter, enlarged

PACK = Path(irsd.models.__file__).parent / "nano"
HW = (480, 640)


def sight(pixel: object, depth_m: object, structural: object = None) -> Sight:
    """Map points without an owner."""
    p, d = np.array(pixel, np.float32).reshape(-1, 2), np.array(depth_m, np.float32)
    flat = np.zeros(len(d), np.bool_) if structural is None else np.array(structural, np.bool_)
    return Sight(p, d, np.full(len(d), -1, np.int32), flat)


def heads_of(numbers: np.ndarray) -> np.ndarray:
    """What a perfect network says of cells int [ROWS, COLUMNS], 0 no thing."""
    heads = np.full((5, ROWS, COLUMNS), -8.0, np.float32)
    heads[3:] = 0
    y, x = np.mgrid[:ROWS, :COLUMNS]
    for k in np.unique(numbers[numbers > 0]).tolist():
        mask = numbers == k
        cy, cx = y[mask].mean(), x[mask].mean()
        heads[0][mask] = 8.0
        heads[3][mask], heads[4][mask] = (cx - x[mask]) / OFFSET_CELLS, (cy - y[mask]) / OFFSET_CELLS
        heads[2] = np.maximum(heads[2], 6 - ((y - round(cy)) ** 2 + (x - round(cx)) ** 2) / 2)
    return heads


def parts_in(numbers: np.ndarray) -> np.ndarray:
    """What a perfect network says that cells are part of: things, the rest wall."""
    logits = np.zeros((PARTS, ROWS, COLUMNS), np.float32)
    logits[Structure.OTHER], logits[Structure.WALL] = np.where(numbers > 0, 8, 0), np.where(numbers > 0, 0, 8)
    return logits


# ------------------------------------------------------------------------------------------------ the map
def test_a_cell_shows_its_nearest_point_and_an_empty_one_that_of_the_nearest_cell() -> None:
    shown = map_picture(sight([[100, 100], [101, 101], [120, 100]], [4.0, 2.0, 1.0], [True, False, True]), HW)
    assert shown[:, 25, 25].tolist() == [0.5, 1.0, 0.0]
    assert shown[:, 25, 30].tolist() == [1.0, 1.0, 1.0]
    assert shown[0, 25, 26] == 0.5
    assert shown[1, 25, 26] == 0.5  # one cell away
    assert shown[0, 25, 29] == 1.0
    assert not shown[:, 60, 60].any()  # out of reach


def test_without_a_map_nothing_is_known() -> None:
    assert not map_picture(sight([], []), HW).any()


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000))
def test_map_picture_is_that_of_a_search_over_all_points(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 60))
    pixel, depth = rng.uniform(-20, 660, (n, 2)), rng.uniform(0.3, 8, n)
    shown = map_picture(sight(pixel, depth), HW)
    cell = np.floor((pixel.astype(np.float32) + 0.5) / 4).astype(int)[:, ::-1]
    inside = (cell >= 0).all(1) & (cell < (ROWS, COLUMNS)).all(1)
    for r, c in {tuple(rc) for rc in cell[inside].tolist()}:
        mine = depth[inside & (cell == (r, c)).all(1)]
        assert shown[0, r, c] == pytest.approx(min(1 / mine.min(), 4.0), rel=1e-5)
        assert shown[1, r, c] == 1.0
    for r, c in rng.integers(0, (ROWS, COLUMNS), (40, 2)).tolist():
        away = np.hypot(*(cell[inside] - (r, c)).T).min(initial=1e9)
        if away > 11:
            assert shown[1, r, c] == 0
        elif away < 9:
            assert 0 < shown[1, r, c] <= 1 / (1 + 0.95 * away)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000))
def test_a_part_of_the_map_lies_where_its_points_are_the_nearest(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 60))
    pixel, depth = rng.uniform(0, 640, (n, 2)) * (1, 0.75), rng.uniform(0.3, 8, n)
    part = rng.choice([0, 7, 40], n).astype(np.int32)
    shown = alone_cells(dataclasses.replace(sight(pixel, depth), part=part), HW)
    cell = np.floor((pixel.astype(np.float32) + 0.5) / 4).astype(int)[:, ::-1]
    numbers = sorted(set(part[part > 0].tolist()))
    for r, c in {tuple(rc) for rc in cell.tolist()}:
        if r < ROWS and c < COLUMNS:
            mine = np.flatnonzero((cell == (r, c)).all(1))
            nearest = int(part[mine[depth[mine].astype(np.float32).argmin()]])
            assert shown[r, c] == (numbers.index(nearest) + 1 if nearest else 0)
    for r, c in rng.integers(0, (ROWS, COLUMNS), (40, 2)).tolist():
        if np.hypot(*(cell - (r, c)).T).min() > 4:
            assert shown[r, c] == 0


def test_without_points_no_part_is_in_sight() -> None:
    assert not alone_cells(dataclasses.replace(sight([], []), part=np.zeros(0, np.int32)), HW).any()


# ------------------------------------------------------------------------------------------------ decoding
def regions_in(numbers: np.ndarray, alone: np.ndarray | None = None) -> Regions:
    empty = np.zeros((3, ROWS, COLUMNS), np.float32)
    alone = np.zeros((ROWS, COLUMNS), np.int32) if alone is None else alone
    return regions_of(heads_of(numbers), parts_in(numbers), empty, np.zeros((ROWS, COLUMNS, 3), np.float32), alone)


def test_a_region_knows_whether_it_is_of_structure() -> None:
    numbers = np.zeros((ROWS, COLUMNS), np.int32)
    numbers[10:50, 10:60] = 1
    found = regions_in(numbers)
    things = [k for k in range(len(found.cells)) if numbers[found.label[found.partition[k]] == k].all()]
    assert things
    assert (found.measures[things, 16] > 0.99).all()
    assert (found.measures[:, 17] < 0.1).all()  # nothing here is a door or a window


def test_a_part_of_the_map_is_a_region_of_its_own() -> None:
    numbers, alone = np.zeros((ROWS, COLUMNS), np.int32), np.zeros((ROWS, COLUMNS), np.int32)
    numbers[10:50, 10:60] = 1  # to the picture it is all one
    alone[10:50, 10:30], alone[80:100, 80:100] = 2, 1  # the second is where the picture shows nothing
    found = regions_in(numbers, alone)
    masks = [found.label[found.partition[k]] == k for k in range(len(found.cells))]
    assert any((mask == (alone == 2)).all() for mask in masks)
    assert not any((mask == (alone == 1)).all() for mask in masks)
    np.testing.assert_array_equal(found.cells, [mask.sum() for mask in masks])


def test_perfect_heads_give_the_things_back() -> None:
    numbers = np.zeros((ROWS, COLUMNS), np.int32)
    numbers[10:50, 10:60] = 1
    numbers[30:60, 30:45] = 2  # stands before it
    numbers[20:28, 100:108] = 3
    numbers[100:120, 120:160] = 4
    found = regions_in(numbers)
    best = np.zeros(5)
    for k in range(len(found.cells)):
        mask = found.label[found.partition[k]] == k
        assert mask.sum() == found.cells[k]
        for n in range(1, 5):
            best[n] = max(best[n], (mask & (numbers == n)).sum() / (mask | (numbers == n)).sum())
    assert (best[1:] > 0.95).all()
    touching = [k for k in range(len(found.cells)) if (found.label[found.partition[k]] == k)[119].any()]
    assert found.measures[touching, 12].all()


def test_no_things_give_no_masks() -> None:
    found = regions_in(np.zeros((ROWS, COLUMNS), np.int32))
    assert not len(found.cells)
    cells, scores = chosen(found, np.zeros(0, np.float32), 0.0, 0.5)
    assert not cells.any()
    assert not len(scores)


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 10_000))
def test_every_cell_is_joined_along_steps_and_regions_are_whole(seed: int) -> None:
    """Each region hangs together, none is too small, and raising the scale never makes more regions."""
    rng = np.random.default_rng(seed)
    colour = cv2.resize(
        rng.uniform(0, 255, (12, 16, 3)).astype(np.float32), (COLUMNS, ROWS), interpolation=cv2.INTER_NEAREST
    )
    chance, votes = np.zeros((3, ROWS, COLUMNS), np.float32), np.zeros((2, ROWS, COLUMNS), np.float32)
    weights = np.array([0, 0, 1, 0, 0], np.float32)
    first, second, step = steps_between(chance, votes, colour, np.zeros((ROWS, COLUMNS), np.float32), weights)
    assert len(step) == ROWS * (COLUMNS - 1) + (ROWS - 1) * COLUMNS
    order, counts = np.argsort(step, kind="stable").astype(np.int32), []
    for scale in (0.5, 5.0, 500.0):
        label, n = joined(first, second, step, order, scale)
        assert np.bincount(label, minlength=n).min() >= 12
        for k in rng.integers(0, n, 3).tolist():
            parts, _ = cv2.connectedComponents((label == k).reshape(ROWS, COLUMNS).astype(np.uint8), connectivity=4)
            assert parts == 2
        counts.append(n)
    assert counts == sorted(counts, reverse=True)


def test_the_surer_region_is_drawn_and_one_that_it_covers_is_not() -> None:
    label = np.full((2, ROWS, COLUMNS), -1, np.int32)
    label[0, 10:30, 10:30], label[1, 10:30, 10:34], label[1, 60:80, 60:80] = 0, 1, 2
    regions = Regions(
        label, np.zeros((3, MEASURES), np.float32), np.array([0, 1, 1], np.int32), np.array([400, 480, 400], np.int32)
    )
    cells, scores = chosen(regions, np.array([0.6, 0.9, 0.02], np.float32), 0.05, 0.3)
    assert scores.tolist() == pytest.approx([0.9])
    np.testing.assert_array_equal(cells > 0, label[1] == 1)
    cells, scores = chosen(regions, np.array([0.9, 0.6, 0.3], np.float32), 0.05, 0.3)
    assert scores.tolist() == pytest.approx([0.9, 0.3])
    np.testing.assert_array_equal(cells == 2, label[1] == 2)


def test_enlarged_masks_do_not_overlap_and_keep_their_area() -> None:
    numbers = np.zeros((ROWS, COLUMNS), np.int32)
    numbers[10:50, 10:60], numbers[50:80, 10:60] = 1, 2
    masks = enlarged(numbers, 2, HW)
    assert masks.sum(0).max() == 1
    for k in (1, 2):
        true = np.kron(numbers == k, np.ones((4, 4), bool))
        assert (masks[k - 1] & true).sum() / (masks[k - 1] | true).sum() > 0.95


# ------------------------------------------------------------------------------------------------ the shipped segmenter
def test_segmenter_gives_disjoint_masks_best_first_with_and_without_a_map() -> None:
    rng = np.random.default_rng(0)
    image = np.full((*HW, 3), 210, np.uint8)
    image[200:400, 250:400] = (150, 60, 30)
    wall = np.stack([rng.uniform(0, 640, 3000), rng.uniform(0, 480, 3000)], 1)
    model = NanoSegmenter(PACK / "segmenter.onnx")
    on = (wall[:, 0] > 250) & (wall[:, 0] < 400) & (wall[:, 1] > 200) & (wall[:, 1] < 400)
    for seen in (sight([], []), sight(wall, np.where(on, 1.5, 3.0), ~on)):
        found = model.segment_scene(image, seen)
        assert found.masks.shape[1:] == HW
        assert found.masks.sum(0).max(initial=0) <= 1
        assert (np.diff(found.scores) <= 0).all()
        assert ((found.scores >= 0) & (found.scores <= 1)).all()
        again = model.segment_scene(image, seen)
        np.testing.assert_array_equal(found.masks, again.masks)


def test_a_segmenter_without_its_settings_says_what_is_missing(tmp_path: Path) -> None:
    shutil.copy(PACK / "segmenter.onnx", tmp_path / "segmenter.onnx")
    with pytest.raises(ModelError, match=r"segmenter\.json must stand beside"):
        NanoSegmenter(tmp_path / "segmenter.onnx")
    (tmp_path / "segmenter.json").write_text(json.dumps({"layers": [{"weight": [[1.0]], "bias": [0.0]}]}))
    with pytest.raises(ModelError, match=f"must lead from {MEASURES} measures"):
        NanoSegmenter(tmp_path / "segmenter.onnx")


# ------------------------------------------------------------------------------------------------ the image encoder
def level_geometry(height_m: float = 1.0) -> Geometry:
    return Geometry(np.array([[400.0, 0, 319.5], [0, 400.0, 239.5], [0, 0, 1]]), np.array([0.0, -1.0, 0.0]), height_m)


def test_measures_are_those_of_the_thing_in_metres() -> None:
    mask = np.zeros((1, *HW), np.bool_)
    mask[0, 240:340, 220:420] = True  # 2 m away: 1 m wide, 0.5 m high, its top at the camera's height
    points = np.stack(np.meshgrid(np.arange(225, 415, 10), np.arange(245, 335, 10)), -1).reshape(-1, 2)
    image = np.zeros((*HW, 3), np.uint8)
    crops, measures = network_inputs(image, mask, sight(points, np.full(len(points), 2.0)), level_geometry())
    assert crops.shape == (1, 5, 64, 64)
    assert np.exp(measures[0, :2]) == pytest.approx([1.0, 0.5], rel=1e-3)
    assert measures[0, 2:4] == pytest.approx([0.5, 1.0], abs=0.01)
    assert np.exp(measures[0, 4]) == pytest.approx(2.0, rel=1e-3)
    assert np.exp(measures[0, 7]) == pytest.approx(2.0, rel=1e-3)
    assert measures[0, 8:].tolist() == [1.0, 0.0, 0.0, 1.0]
    half, smaller = network_inputs(
        image[::2, ::2], mask[:, ::2, ::2], sight(points / 2, np.full(len(points), 2.0)), None
    )
    assert not smaller[0, [0, 1, 2, 3, 4, 5, 11]].any()  # nothing is known in metres
    np.testing.assert_allclose(half[0, 3], crops[0, 3], atol=0.1)


def test_geometry_of_a_view_follows_its_scale_and_floor() -> None:
    pose = np.eye(4)
    pose[:3, :3] = np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])  # looks along x, level
    pose[:3, 3] = (1, 2, 1.5)
    matrix = np.array([[500.0, 0, 319.5], [0, 500.0, 239.5], [0, 0, 1]])
    view = CameraView(0, pose, CameraModel("c", 640, 480, matrix, "plumb_bob", np.zeros(0)), None, None)
    geometry = Geometry.of(view, 0.5, 0.3)
    np.testing.assert_allclose(geometry.matrix, [[250, 0, 159.5], [0, 250, 119.5], [0, 0, 1]])
    np.testing.assert_allclose(geometry.up, [0, -1, 0])
    assert geometry.height_m == pytest.approx(1.2)


def test_encoder_gives_unit_rows_that_do_not_depend_on_who_else_is_asked_for() -> None:
    rng = np.random.default_rng(0)
    image = rng.integers(0, 255, (*HW, 3)).astype(np.uint8)
    masks = np.zeros((11, *HW), np.bool_)
    for k in range(10):
        masks[k, 40 * k : 40 * k + 60, 50 * k : 50 * k + 90] = True  # the last one stays empty
    model = NanoImageEncoder(PACK / "image_encoder.onnx")
    rows = model.encode_masks(image, masks, sight([[100, 80]] * 5, [2.0] * 5), level_geometry())
    assert rows.shape == (11, model.dimension)
    np.testing.assert_allclose(np.linalg.norm(rows[:10], axis=1), 1, atol=1e-5)
    assert not rows[10].any()
    alone = model.encode_masks(image, masks[3:4], sight([[100, 80]] * 5, [2.0] * 5), level_geometry())
    np.testing.assert_allclose(alone[0], rows[3], atol=1e-4)
    assert model.encode_masks(image, masks[:0], sight([], []), None).shape == (0, model.dimension)
