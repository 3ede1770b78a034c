"""The embedded building: valid for every seed, real in size, and the same for the same seed."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from irsd.sim.building import Building, make_building, truth_document
from irsd.sim.parts import box, cylinder
from irsd.sim.raycast import RayScene, embreex_caster, open3d_caster
from irsd.sim.space import ROBOT_RADIUS_M, Obstacles

SEEDS = (0, 1, 2, 3, 4, 5, 6, 7)


@pytest.fixture(scope="module", params=SEEDS)
def building(request: pytest.FixtureRequest) -> Building:
    return make_building(request.param)


def solids(building: Building, number: int) -> list[tuple[np.ndarray, float, float]]:
    """Convex parts of a thing, read back from its mesh: (plan hull [K, 2] float32, lowest z, highest z)."""
    triangles = building.triangles[building.thing == number]
    found, at = [], 0
    while at < len(triangles):
        twelve = triangles[at : at + 12].reshape(-1, 3)
        count = 12 if len(np.unique(twelve, axis=0)) == 8 else 56
        points = triangles[at : at + count].reshape(-1, 3)
        found.append(
            (
                cv2.convexHull(np.ascontiguousarray(points[:, :2]))[:, 0],
                float(points[:, 2].min()),
                float(points[:, 2].max()),
            )
        )
        at += count
    return found


def gap_between(a: tuple[np.ndarray, float, float], b: tuple[np.ndarray, float, float]) -> float:
    """Separating axis test of two upright prisms: how far they are apart, negative when one is in the other."""
    best = max(b[1] - a[2], a[1] - b[2])
    for hull in (a[0], b[0]):
        edge = np.roll(hull, -1, 0) - hull
        normal = np.stack([edge[:, 1], -edge[:, 0]], 1) / np.maximum(np.linalg.norm(edge, axis=1), 1e-9)[:, None]
        pa, pb = a[0] @ normal.T, b[0] @ normal.T
        best = max(best, float((pb.min(0) - pa.max(0)).max()), float((pa.min(0) - pb.max(0)).max()))
    return best


def test_things_do_not_run_into_each_other(building: Building) -> None:
    things = [t for t in building.things if not t.structural or t.label in ("wall", "window")]
    parts = {t.id: solids(building, t.id) for t in things}
    for k, a in enumerate(things):
        for b in things[k + 1 :]:
            if a.structural and b.structural:
                continue
            if (a.aabb_min_m > b.aabb_max_m - 1e-3).any() or (b.aabb_min_m > a.aabb_max_m - 1e-3).any():
                continue
            worst = min(gap_between(p, q) for p in parts[a.id] for q in parts[b.id])
            assert worst > -2e-3, f"{a.label} {a.id} and {b.label} {b.id} overlap by {-worst:.3f} m"


def test_every_thing_stands_in_its_room(building: Building) -> None:
    for thing in building.things:
        if thing.room >= 0:
            outline = building.rooms[thing.room].polygon_xy
            assert (thing.aabb_min_m[:2] >= outline.min(0) - 1e-4).all(), thing.label
            assert (thing.aabb_max_m[:2] <= outline.max(0) + 1e-4).all(), thing.label
            assert -1e-6 <= thing.aabb_min_m[2] <= 2.3


def test_rooms_are_what_a_small_building_has(building: Building) -> None:
    kinds = [room.label for room in building.rooms]
    assert len(kinds) == 7
    assert {"laboratory", "office", "kitchen", "bathroom", "corridor"} <= set(kinds)
    assert {"bedroom", "lounge"} & set(kinds)
    size = building.triangles.reshape(-1, 3).max(0) - building.triangles.reshape(-1, 3).min(0)
    assert 12.5 < size[0] < 15
    assert 8 < size[1] < 10.5


def test_robot_reaches_every_room_and_passes_every_door(building: Building) -> None:
    for room in building.rooms:
        stand = building.space.viewpoint(room.polygon_xy)
        assert building.space.reachable(stand[None])[0]
    middles = np.array([door.position_xy for door in building.doors])
    assert (building.obstacles.distance(middles) > ROBOT_RADIUS_M + 0.1).all()
    assert building.space.reachable(middles).all()


def test_laboratory_has_a_tv_that_a_robot_can_stand_before(building: Building) -> None:
    lab = [room.label for room in building.rooms].index("laboratory")
    (tv,) = [t for t in building.things if t.label == "tv" and t.room == lab]
    frame = building.space.frame
    rows, cols = np.mgrid[: frame.height, : frame.width]
    points = frame.centres_of(np.stack([rows.ravel(), cols.ravel()], 1))
    outside = np.maximum(np.maximum(tv.aabb_min_m[:2] - points, points - tv.aabb_max_m[:2]), 0)
    near = np.linalg.norm(outside, axis=1) <= 0.45
    assert building.space.reachable(points[near]).any()


def test_truth_names_every_thing_once(building: Building) -> None:
    document = truth_document(building)
    assert [i["id"] for i in document["instances"]] == list(range(1, len(building.things) + 1))
    assert set(np.unique(building.thing).tolist()) == {thing.id for thing in building.things}


def test_same_seed_same_building_and_other_seed_another() -> None:
    a, b, c = make_building(11), make_building(11), make_building(12)
    assert a.triangles.tobytes() == b.triangles.tobytes()
    assert a.colour.tobytes() == b.colour.tobytes()
    assert truth_document(a) == truth_document(b)
    assert a.triangles.shape != c.triangles.shape or not np.array_equal(a.triangles, c.triangles)


def test_turned_building_is_the_same_building_turned() -> None:
    straight, turned = make_building(3), make_building(3, yaw_rad=0.4)
    c, s = np.cos(0.4), np.sin(0.4)
    expected = straight.triangles.astype(np.float64) @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T
    np.testing.assert_allclose(turned.triangles, expected, atol=1e-4)
    points = np.random.default_rng(0).uniform(-3, 3, (50, 2))
    np.testing.assert_allclose(
        turned.obstacles.distance(points @ np.array([[c, -s], [s, c]]).T),
        straight.obstacles.distance(points),
        atol=1e-6,
    )


def test_obstacle_distance_is_the_geometric_one() -> None:
    shapes = Obstacles(np.array([[0, 0, 1.0, 0.5, 0.0], [5.0, 0, 0.3, -1.0, 0.0]]))
    points = np.array([[2.0, 0.0], [0.0, 0.0], [2.0, 1.5], [5.0, 1.0]])
    np.testing.assert_allclose(shapes.distance(points), [1.0, -0.5, np.sqrt(2), 0.7], atol=1e-12)


def test_part_meshes_are_closed_and_face_outwards() -> None:
    for part in (box(0, 1, 0, 2, 0, 3, (1, 2, 3)), cylinder(0.5, 1.0, 0.4, 0.0, 3.0, (1, 2, 3))):
        triangles = part.triangles()
        middle = (np.array(part.lo) + np.array(part.hi)) / 2
        normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        assert (np.einsum("ij,ij->i", normal, triangles.mean(1) - middle) > 0).all()
        volume = np.einsum("ij,ij->i", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2])).sum() / 6
        assert volume == pytest.approx(6.0 if not part.round else np.pi * 0.16 * 3, rel=0.04)


def test_rays_against_analytic_planes() -> None:
    scene = RayScene(box(-2, 3, -1, 4, 0, 2.5, (0, 0, 0)).triangles().astype(np.float32))
    none = scene.cast(np.empty((0, 3), np.float32), np.empty((0, 3), np.float32))
    assert none.range_m.shape == (0,)
    rng = np.random.default_rng(5)
    origins = rng.uniform((-1.9, -0.9, 0.1), (2.9, 3.9, 2.4), (2000, 3))
    directions = rng.normal(size=(2000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    walls = np.where(directions > 0, [3, 4, 2.5], [-2, -1, 0])
    expected = ((walls - origins) / directions).min(1)
    hits = scene.cast(origins.astype(np.float32), directions.astype(np.float32))
    assert (hits.triangle >= 0).all()
    np.testing.assert_allclose(hits.range_m, expected, atol=2e-5, rtol=2e-5)
    away = scene.cast(np.array([[9, 0, 1]], np.float32), np.array([[1, 0, 0]], np.float32))
    assert np.isinf(away.range_m[0])
    assert away.triangle[0] == -1
    with pytest.raises(ValueError, match="triangles"):
        RayScene(np.empty((0, 3, 3), np.float32))


def test_both_ray_casters_agree() -> None:
    try:
        import open3d  # noqa: F401
    except (ImportError, OSError) as error:
        pytest.skip(f"Open3D can't be imported: {error}")
    triangles = box(-2, 3, -1, 4, 0, 2.5, (0, 0, 0)).triangles().astype(np.float32)
    rng = np.random.default_rng(3)
    directions = rng.normal(size=(500, 3)).astype(np.float32)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    origins = np.tile(np.float32([[0.5, 0.5, 5.0]]), (500, 1))
    (ours, ours_hit), (theirs, theirs_hit) = (
        c(triangles)(origins, directions) for c in (embreex_caster, open3d_caster)
    )
    hit = ours_hit >= 0
    assert hit.any()
    assert not hit.all()
    assert (hit == (theirs_hit >= 0)).all()
    np.testing.assert_allclose(ours[hit], theirs[hit], atol=1e-4)
