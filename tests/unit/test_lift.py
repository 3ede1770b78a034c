"""Lifting masks: projection, occlusion, uncertain edges, structure and floating points."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from numpy.typing import NDArray

from irsd.core.geometry import make_pose
from irsd.core.types import CameraModel, CameraView, Detections, Structure
from irsd.instances.lift import (
    LiftSettings,
    edge_distance,
    lift,
    main_parts,
    project,
    unoccluded,
    without_structure,
)
from irsd.instances.settle import connected_parts

CAMERA = CameraModel(
    "camera", 320, 240, np.array([[200.0, 0, 159.5], [0, 200.0, 119.5], [0, 0, 1]]), "plumb_bob", np.zeros(5)
)
AHEAD = np.eye(4)  # the map frame is the optical frame: z ahead, x right, y down
SETTINGS = LiftSettings()


def wall(depth: float, half_x: float, half_y: float, step: float = 0.04, x: float = 0.0) -> NDArray[np.float32]:
    """A dense square of points that faces the camera."""
    xs, ys = np.meshgrid(np.arange(-half_x, half_x, step) + x, np.arange(-half_y, half_y, step))
    return np.stack([xs.ravel(), ys.ravel(), np.full(xs.size, depth)], -1).astype(np.float32)


def view(ids_px: NDArray[np.uint16], labels: dict[int, str]) -> CameraView:
    numbers = sorted(labels)
    detections = Detections(
        1,
        "camera",
        ids_px,
        np.array(numbers, np.int32),
        np.full(len(numbers), 0.8, np.float32),
        tuple(labels[n] for n in numbers),
        tuple(((labels[n], 0.8),) for n in numbers),
        None,
    )
    return CameraView(1, AHEAD, CAMERA, detections, None)


def other(points: NDArray[np.float32]) -> NDArray[np.uint8]:
    return np.zeros(len(points), np.uint8)


def test_nothing_to_lift() -> None:
    nothing = np.zeros((0, 3), np.float32)
    blank = np.zeros((240, 320), np.uint16)
    assert len(lift(view(blank, {}), nothing, other(nothing), SETTINGS)) == 0
    assert len(lift(CameraView(1, AHEAD, CAMERA, None, None), wall(2, 1, 1), other(wall(2, 1, 1)), SETTINGS)) == 0
    got = lift(view(blank, {}), wall(2, 1, 1), other(wall(2, 1, 1)), SETTINGS)
    assert len(got) == 0
    assert len(got.seen_map) > 100  # what is seen outside of masks is evidence too
    behind = wall(-2, 1, 1)
    assert len(lift(view(blank, {}), behind, other(behind), SETTINGS).seen_map) == 0


def test_a_mask_without_pixels_gives_no_points() -> None:
    points = wall(2, 1, 1)
    assert len(lift(view(np.zeros((240, 320), np.uint16), {5: "ghost"}), points, other(points), SETTINGS)) == 0


def test_project_equals_the_pinhole_formula_and_cuts_at_the_picture() -> None:
    rng = np.random.default_rng(1)
    points = rng.uniform(-4, 4, (500, 3)).astype(np.float32)
    pose = make_pose(np.array([0.3, -0.2, 0.1]), np.array([0.1, 0.2, -0.1, 0.9]))
    index, pixel, depth = project(points, pose, CAMERA, 5.0)
    expected = []
    for k, point in enumerate(points.astype(np.float64)):
        local = pose[:3, :3].T @ (point - pose[:3, 3])
        if local[2] <= 0.15 or np.linalg.norm(local) >= 5.0:
            continue
        u, v = 200 * local[0] / local[2] + 159.5, 200 * local[1] / local[2] + 119.5
        if -0.5 < u < 319.5 and -0.5 < v < 239.5:
            expected.append((k, u, v, local[2]))
    assert index.tolist() == [k for k, *_ in expected]
    np.testing.assert_allclose(np.c_[pixel, depth], [e[1:] for e in expected], rtol=1e-4, atol=1e-2)


@pytest.mark.parametrize(
    ("model", "distortion"), [("plumb_bob", [-0.3, 0.1, 0.001, 0.001, 0.0]), ("equidistant", [0.01, 0.0, 0.0, 0.0])]
)
def test_distorted_rays_from_outside_do_not_fold_in(model: str, distortion: list[float]) -> None:
    camera = CameraModel("camera", 320, 240, CAMERA.matrix, model, np.array(distortion))
    aside = np.array([[40.0, 0.0, 1.0], [0.0, 0.0, 2.0]], np.float32)
    index, pixel, _ = project(aside, AHEAD, camera, 100.0)
    assert index.tolist() == [1]
    np.testing.assert_allclose(pixel, [[159.5, 119.5]], atol=1e-6)


def test_what_stands_behind_is_not_seen() -> None:
    front, back = wall(2.0, 0.4, 0.4), wall(4.0, 3.0, 2.0, 0.08)
    points = np.concatenate([front, back])
    ids = np.zeros((240, 320), np.uint16)
    ids[82:158, 122:198] = 3
    got = lift(view(ids, {3: "box"}), points, other(points), SETTINGS)
    (mask,) = got.masks
    assert set(np.unique(mask.points_map[:, 2])) == {2.0}
    assert not mask.flat
    shadow = np.abs(back[:, :2]).max(1) < 0.7
    seen_back = got.seen_map[got.seen_map[:, 2] == 4.0]
    assert not (np.abs(seen_back[:, :2]).max(1) < 0.7).any()
    assert shadow.any()
    assert len(seen_back) > 100


def test_occlusion_equals_brute_force_where_points_are_dense() -> None:
    rng = np.random.default_rng(2)
    points = np.concatenate(
        [wall(z, h, h, 0.03, x) for z, h, x in ((1.5, 0.2, 0.4), (2.5, 0.5, -0.3), (4.0, 2.0, 0.0))]
    )
    points = points[rng.permutation(len(points))]
    _, pixel, depth = project(points, AHEAD, CAMERA, 8.0)
    got = unoccluded(pixel, depth, (240, 320), 200.0, SETTINGS)
    size_px = 200.0 * SETTINGS.splat_m / depth  # each point as the square it covers
    gap = np.abs(pixel[:, None] - pixel[None]).max(-1)
    hidden = ((depth[None] < depth[:, None] - 0.2) & (gap < size_px[None] / 2)).any(1)
    near_rim = ((np.abs(depth[None] - depth[:, None]) > 0.2) & (gap < size_px[None] / 2 + 9)).any(1) & ~hidden
    assert (got[hidden] == False).mean() > 0.97  # noqa: E712  (cells are coarser than pixels: a rim may differ)
    assert got[~hidden & ~near_rim].all()


def test_edge_distance() -> None:
    ids = np.zeros((40, 60), np.uint16)
    assert (edge_distance(ids) >= 60).all()  # the picture's border is not an edge
    ids[10:30, 20:50] = 7
    distance = edge_distance(ids)
    assert distance[10, 35] == pytest.approx(0.5)
    assert distance[9, 35] == pytest.approx(0.5)
    assert distance[15, 35] == pytest.approx(5.5, abs=0.3)
    assert distance[20, 35] == distance[10:30, 20:50].max()


def test_points_at_the_edge_are_neither_object_nor_background() -> None:
    points = wall(2.0, 1.4, 1.0, 0.02)
    ids = np.zeros((240, 320), np.uint16)
    ids[80:160, 100:220] = 1
    got = lift(view(ids, {1: "poster"}), points, other(points), SETTINGS)
    u = got.masks[0].points_map[:, 0] / 2.0 * 200 + 159.5
    assert u.min() >= 100 + 3
    assert u.max() <= 219 - 3
    band = (np.abs(got.seen_map[:, 0] / 2.0 * 200 + 159.5 - 99.5) < 3) & (np.abs(got.seen_map[:, 1]) < 0.3)
    assert not band.any()
    thin = np.zeros((240, 320), np.uint16)
    thin[80:160, 150:156] = 1  # six pixels wide: an edge of four would leave nothing
    assert len(lift(view(thin, {1: "pole"}), points, other(points), SETTINGS)) == 1


@pytest.mark.parametrize(
    ("labels", "kept", "flat"),
    [
        ([], 0, False),
        ([0, 0, 0, 1, 2], 3, False),
        ([1, 1, 1, 1], 4, True),
        ([1, 1, 1, 1, 1, 1, 1, 0, 0, 0], 10, True),
        ([4, 5, 0], 1, False),
    ],
)
def test_structure_joins_only_flat_things(labels: list[int], kept: int, flat: bool) -> None:
    keep, is_flat = without_structure(np.array(labels, np.uint8), 0.7)
    assert (int(keep.sum()), is_flat) == (kept, flat)


def test_a_wall_behind_never_joins_and_a_picture_on_it_does() -> None:
    chair, back = wall(2.0, 0.3, 0.3, 0.04, -0.5), wall(2.3, 1.5, 1.0)
    points = np.concatenate([chair, back])
    structure = np.r_[np.full(len(chair), Structure.OTHER), np.full(len(back), Structure.WALL)].astype(np.uint8)
    ids = np.zeros((240, 320), np.uint16)
    ids[80:160, 70:150] = 1  # wider than the chair: spills onto the wall
    ids[80:160, 200:280] = 2
    got = lift(view(ids, {1: "chair", 2: "picture"}), points, structure, SETTINGS)
    assert [m.flat for m in got] == [False, True]
    assert set(np.unique(got.masks[0].points_map[:, 2]).round(3)) == {2.0}
    assert set(np.unique(got.masks[1].points_map[:, 2]).round(3)) == {np.float32(2.3).round(3)}


def test_a_mask_that_its_points_cannot_account_for_is_not_lifted() -> None:
    points = wall(2.0, 0.05, 0.05)
    ids = np.zeros((240, 320), np.uint16)
    ids[20:220, 20:300] = 1  # a large thing out of the map's sight; a few points of another thing lie in its mask
    assert len(lift(view(ids, {1: "refrigerator"}), points, other(points), SETTINGS)) == 0


def brute_parts(points: NDArray[np.float32], link: float) -> list[frozenset[int]]:
    cells = [tuple(int(v) for v in np.floor(p.astype(np.float64) / link)) for p in points]
    left, parts = set(range(len(points))), []
    while left:
        todo, part = [left.pop()], set()
        while todo:
            k = todo.pop()
            part.add(k)
            near = {j for j in left if max(abs(a - b) for a, b in zip(cells[j], cells[k], strict=True)) <= 1}
            left -= near
            todo += near
        parts.append(frozenset(part))
    return sorted(parts, key=min)


@pytest.mark.parametrize("seed", range(5))
def test_connected_parts_equal_flood_fill(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.uniform(-1, 1, (150, 3)).astype(np.float32)
    part = connected_parts(points, 0.15)
    got = sorted((frozenset(np.flatnonzero(part == k).tolist()) for k in np.unique(part)), key=min)
    assert got == brute_parts(points, 0.15)


def test_floating_points_are_removed() -> None:
    assert len(main_parts(np.zeros((0, 3), np.float32), 0.1, 0.2)) == 0
    thing, floating = wall(2.0, 0.3, 0.3), wall(3.0, 0.06, 0.06)
    keep = main_parts(np.concatenate([floating, thing]), 0.1, 0.2)
    assert keep.tolist() == list(range(len(floating), len(floating) + len(thing)))


def test_same_input_same_bytes_and_order_of_points_does_not_matter() -> None:
    points = np.concatenate([wall(2.0, 0.4, 0.4), wall(4.0, 3.0, 2.0, 0.08)])
    ids = np.zeros((240, 320), np.uint16)
    ids[60:180, 100:220] = 9
    ids[100:140, 20:60] = 2
    one = lift(view(ids, {9: "box", 2: "bag"}), points, other(points), SETTINGS)
    two = lift(view(ids, {9: "box", 2: "bag"}), points, other(points), SETTINGS)
    assert [m.number for m in one] == [2, 9]
    for a, b in zip(one, two, strict=True):
        assert a.points_map.tobytes() == b.points_map.tobytes()
    order = np.random.default_rng(3).permutation(len(points))
    mixed = lift(view(ids, {9: "box", 2: "bag"}), points[order], other(points), SETTINGS)
    for a, b in zip(one, mixed, strict=True):
        assert sorted(map(tuple, a.points_map.tolist())) == sorted(map(tuple, b.points_map.tolist()))


def test_nothing_follows_from_where_a_detector_found_something_and_did_not_look_into_it() -> None:
    points = wall(2, 1, 1)
    ids = np.zeros((240, 320), np.uint16)
    ids[100:140, 100:140] = 1
    unsure = np.zeros((240, 320), np.bool_)
    unsure[:, :160] = True
    seen = view(ids, {1: "chair"})
    assert seen.detections is not None
    all_sure = lift(seen, points, other(points), SETTINGS)
    half_sure = lift(
        dataclasses.replace(seen, detections=dataclasses.replace(seen.detections, unsure_px=unsure)),
        points,
        other(points),
        SETTINGS,
    )
    np.testing.assert_array_equal(half_sure.masks[0].points_map, all_sure.masks[0].points_map)
    outside = half_sure.seen_map[half_sure.seen_map[:, 0] < -0.62]  # left of the mask, where it is unsure
    assert len(outside) == 0
    assert (all_sure.seen_map[:, 0] < -0.62).sum() > 100
    assert (half_sure.seen_map[:, 0] > 0.1).sum() > 100
