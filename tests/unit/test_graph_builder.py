from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from irsd.core.grid import GridFrame
from irsd.core.types import InstanceState, InstanceUpdate, Opening, RoomFootprint, Rooms
from irsd.graph.builder import GraphBuilder, GraphSettings
from irsd.graph.codec import delta_to_json
from irsd.graph.scene_graph import SceneGraph
from irsd.perception.encoder import LabelEncoder

FRAME = GridFrame((0.0, 0.0), 0.5, 8, 20)


@pytest.fixture(scope="module")
def encoder() -> LabelEncoder:
    return LabelEncoder.load()


@pytest.fixture
def builder(encoder: LabelEncoder) -> GraphBuilder:
    return GraphBuilder(GraphSettings(), encoder, "map", "m")


def cube(x: float, y: float, side: float = 1.0) -> np.ndarray:
    corners = np.array(np.meshgrid([0, 1], [0, 1], [0, 1])).reshape(3, -1).T
    return (corners * side + [x, y, 0]).astype(np.float32)


def state(number: int, label: str = "box", room: int = 0, x: float = 1.0, **more: object) -> InstanceState:
    values = {
        "id": number,
        "points_map": cube(x, 1.0),
        "embedding": None,
        "labels": ((label, 0.9),),
        "room": room,
        "observations": 3,
        "existence": 0.9,
        "first_seen_ns": 1,
        "last_seen_ns": 2,
    }
    return InstanceState(**{**values, **more})


def update(
    *changed: InstanceState, ended: Sequence[int] = (), merged: Sequence[tuple[int, int]] = ()
) -> InstanceUpdate:
    return InstanceUpdate(5, changed, tuple(ended), tuple(merged))


def rooms_of(ids: Sequence[int], openings: Sequence[Opening] = (), lineage: Sequence[str] = ()) -> Rooms:
    """Rooms 5 m wide and 4 m deep side by side along x, at most two."""
    labels = np.zeros((8, 20), np.int32)
    footprints = []
    for k, number in enumerate(ids):
        labels[:, k * 10 : (k + 1) * 10] = number
        x = 5.0 * k
        corners = np.array([[x, 0], [x + 5, 0], [x + 5, 4], [x, 4.0]])
        footprints.append(RoomFootprint(corners, (x, 0.0, x + 5, 4.0), 20.0, 0.0, 2.5))
    return Rooms(FRAME, labels, tuple(ids), tuple(footprints), tuple(openings), tuple(lineage))


def opening(a: int, b: int, x: float, y: float) -> Opening:
    return Opening((a, b), (x, y), 0.9, np.zeros((2, 2)))


def test_nothing_gives_no_delta(builder: GraphBuilder) -> None:
    assert builder.build(None, None, 1) is None
    assert builder.build(rooms_of([]), update(), 2) is None
    assert builder.seq == 0


def test_the_first_delta_holds_everything_and_the_same_again_nothing(builder: GraphBuilder) -> None:
    rooms, change = rooms_of([1, 2], [opening(2, 1, 5.0, 2.0)]), update(state(7, "TV", room=2, x=6.0))
    delta = builder.build(rooms, change, 9)
    assert delta is not None
    assert (delta.seq, delta.stamp_ns, delta.map_id, delta.frame) == (1, 9, "m", "map")
    assert [r.id for r in delta.rooms] == ["R1", "R2"]
    assert delta.rooms[1].instances == ("I7",)
    assert delta.rooms[0].doors == delta.rooms[1].doors == ("D1",)
    assert delta.doors[0].rooms == ("R1", "R2")
    (node,) = delta.instances
    assert (node.label, node.room, node.volume_m3, node.point_count) == ("television", "R2", 1.0, 8)
    assert node.centroid_m == (6.5, 1.5, 0.5)
    assert builder.build(rooms, change, 10) is None
    assert builder.build(None, None, 11) is None
    np.testing.assert_array_equal(builder.arrays("I7").points_map, cube(6.0, 1.0))


def test_a_delta_holds_only_what_changed(builder: GraphBuilder) -> None:
    builder.build(rooms_of([1, 2]), update(state(1, room=1), state(2, room=2, x=6.0)), 1)
    delta = builder.build(None, update(state(1, room=1, observations=4)), 2)
    assert delta is not None
    assert [i.id for i in delta.instances] == ["I1"]
    assert delta.rooms == delta.doors == delta.removed == ()


def test_ended_and_absorbed_instances_go_with_their_arrays(builder: GraphBuilder) -> None:
    builder.build(rooms_of([1]), update(state(1, room=1), state(2, room=1), state(10, room=1)), 1)
    delta = builder.build(None, update(state(1, room=1, observations=9), ended=[10], merged=[(1, 2)]), 2)
    assert delta is not None
    assert delta.removed == ("I2", "I10")
    assert delta.lineage == ("I2 merged into I1",)
    assert delta.rooms[0].instances == ("I1",)
    with pytest.raises(KeyError):
        builder.arrays("I2")
    assert list(builder.all_arrays()) == ["I1"]


def test_synonyms_are_summed_under_one_name(builder: GraphBuilder) -> None:
    labels = (("armchair", 0.4), ("couch", 0.3), ("sofa", 0.2))
    delta = builder.build(None, update(state(1, labels=labels), state(2, labels=())), 1)
    assert delta is not None
    assert delta.instances[0].labels == (("sofa", 0.5), ("armchair", 0.4))
    assert delta.instances[1].label == "thing"


def test_a_door_keeps_its_id_and_a_new_one_gets_a_new_number(builder: GraphBuilder) -> None:
    far, near = opening(1, 2, 5.0, 0.5), opening(1, 2, 5.0, 3.0)
    builder.build(rooms_of([1, 2], [near]), None, 1)
    delta = builder.build(rooms_of([1, 2], [far, opening(2, 1, 5.1, 3.1)]), None, 2)
    assert delta is not None
    assert {d.id: d.position_xy for d in delta.doors} == {"D1": (5.1, 3.1), "D2": (5.0, 0.5)}
    gone = builder.build(rooms_of([1, 2], [far]), None, 3)
    assert gone is not None
    assert gone.removed == ("D1",)
    back = builder.build(rooms_of([1, 2], [near, far]), None, 4)
    assert back is not None
    assert [d.id for d in back.doors] == ["D1"]


def test_a_door_outlives_a_new_number_of_its_room(builder: GraphBuilder) -> None:
    builder.build(rooms_of([1, 2], [opening(1, 2, 5.0, 2.0)]), None, 1)
    delta = builder.build(rooms_of([1, 9], [opening(1, 9, 5.0, 2.1)], ["R2 became R9"]), None, 2)
    assert delta is not None
    assert (delta.doors[0].id, delta.doors[0].rooms) == ("D1", ("R1", "R9"))
    assert delta.removed == ("R2",)
    assert delta.lineage == ("R2 became R9",)


def test_things_of_a_room_that_ended_are_placed_by_the_plan(builder: GraphBuilder) -> None:
    builder.build(rooms_of([1, 2]), update(state(1, room=2, x=6.0), state(2, room=1)), 1)
    delta = builder.build(rooms_of([1, 9]), None, 2)
    assert delta is not None
    assert [(i.id, i.room) for i in delta.instances] == [("I1", "R9")]
    outside = builder.build(rooms_of([1]), update(state(3, room=9, x=30.0)), 3)
    assert outside is not None
    assert [(i.id, i.room) for i in outside.instances] == [("I1", None), ("I3", None)]


def test_a_state_without_points_changes_nothing(builder: GraphBuilder) -> None:
    empty = state(1, points_map=np.zeros((0, 3), np.float32))
    assert builder.build(None, update(empty), 1) is None


def test_room_types_come_from_what_stands_there_and_stay(builder: GraphBuilder) -> None:
    rooms = rooms_of([1, 2])
    kitchen = [state(k, name, room=1) for k, name in enumerate(["fridge", "stove", "range hood"], 1)]
    delta = builder.build(rooms, update(*kitchen), 1)
    assert delta is not None
    assert [r.label for r in delta.rooms] == ["kitchen", "room"]
    assert delta.rooms[0].labels[0][0] == "kitchen"
    assert delta.rooms[1].labels == ()
    more = builder.build(None, update(state(9, "picture", room=1)), 2)
    assert more is not None
    assert more.rooms[0].label == "kitchen"


def test_two_builders_with_the_same_input_write_the_same_bytes(encoder: LabelEncoder) -> None:
    payloads = []
    for _ in range(2):
        builder = GraphBuilder(GraphSettings(), encoder, "map", "m")
        delta = builder.build(rooms_of([3, 1], [opening(1, 3, 5, 1)]), update(state(2, "bed", room=3), state(1)), 1)
        assert delta is not None
        payloads.append(delta_to_json(delta))
    assert payloads[0] == payloads[1]


def test_a_restored_builder_goes_on_where_the_other_stopped(builder: GraphBuilder, encoder: LabelEncoder) -> None:
    graph = SceneGraph("m")
    rooms = rooms_of([1, 2], [opening(1, 2, 5.0, 2.0)])
    first = builder.build(rooms, update(state(1, "bed", room=1)), 1)
    assert first is not None
    snapshot = graph.apply(first)
    again = GraphBuilder(GraphSettings(), encoder, "map", "m")
    again.restore(snapshot, builder.all_arrays())
    assert again.build(None, None, 2) is None
    assert again.build(rooms, update(state(1, "bed", room=1)), 2) is None
    delta = again.build(None, update(state(2, room=2, x=6.0)), 3)
    assert delta is not None
    assert delta.seq == 2
    assert graph.apply(delta).rooms[1].instances == ("I2",)
    other = GraphBuilder(GraphSettings(), encoder, "map", "another")
    with pytest.raises(ValueError, match="stored map"):
        other.restore(snapshot, {})
