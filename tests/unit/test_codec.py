from __future__ import annotations

import json
import math

import numpy as np
import pytest
from graph_values import a_delta, a_room, an_instance, deltas, nodes, snapshots
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from irsd.core.errors import DecodeError
from irsd.graph import codec
from irsd.graph.model import BuildingNode, GraphDelta, GraphSnapshot, RoomNode

few = settings(max_examples=40, deadline=None)


@few
@given(snapshots)
def test_a_snapshot_survives_the_wire(snapshot: GraphSnapshot) -> None:
    payload = codec.snapshot_to_json(snapshot)
    back = codec.snapshot_from_json(payload)
    assert back == codec.as_published(snapshot)
    assert codec.snapshot_to_json(back) == payload


@few
@given(deltas)
def test_a_delta_survives_the_wire(delta: GraphDelta) -> None:
    payload = codec.delta_to_json(delta)
    assert codec.delta_to_json(codec.delta_from_json(payload)) == payload


@few
@given(nodes)
def test_a_node_survives_the_wire(node: codec.Node) -> None:
    payload = codec.node_to_json(node, seq=3, frame="map")
    assert codec.node_from_json(payload) == codec.as_published(node)
    document = json.loads(payload)
    assert list(document)[:3] == ["schema", "seq", "frame"]
    assert document["schema"] == codec.schema_name(type(node))


def test_an_empty_graph_is_a_document() -> None:
    empty = GraphSnapshot(0, 0, "m", "map", BuildingNode("B0", "", ()), (), (), ())
    assert codec.snapshot_from_json(codec.snapshot_to_json(empty)) == empty
    assert codec.rooms_document(empty) == []


def test_zero_has_no_sign_and_volumes_keep_a_cubic_centimetre() -> None:
    node = codec.as_published(RoomNode("R1", "room", (), ((-0.0, -0.00001),), (0, 0, 0, 0), 1.23456, 0.0, None, (), ()))
    assert math.copysign(1, node.polygon_xy[0][0]) == math.copysign(1, node.polygon_xy[0][1]) == 1
    assert node.area_m2 == 1.2346
    thing = json.loads(codec.node_to_json(an_instance(1), seq=1, frame="map"))
    assert thing["volume_m3"] == 1.0
    small = dict.fromkeys(["volume_m3"], 1.04e-6)
    values = {name: getattr(an_instance(1), name) for name in type(an_instance(1)).__slots__}
    assert codec.as_published(type(an_instance(1))(**{**values, **small})).volume_m3 == 1e-6


def test_what_is_not_a_number_has_no_document() -> None:
    with pytest.raises(ValueError, match="no place"):
        codec.as_published(RoomNode("R1", "room", (), (), (0.0, 0.0, 0.0, 0.0), float("nan"), 0.0, None, (), ()))


def test_a_room_document_is_what_rooms_json_holds() -> None:
    snapshot = GraphSnapshot(1, 0, "m", "map", BuildingNode("B0", "", ("R2",)), (a_room(2, "kitchen"),), (), ())
    (room,) = codec.rooms_document(snapshot)
    assert list(room) == ["id", "label", "polygon", "aabb", "floor_z", "ceiling_z", "floor"]
    assert room["polygon"][1] == [1.0, 0.0]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"schema": "irs/graph/delta/9"}, "schema"),
        ({"seq": "1"}, "seq"),
        ({"seq": True}, "seq"),
        ({"rooms": None}, "rooms: expected a list"),
        ({"rooms": [{}]}, r"rooms\[0\]: missing"),
        ({"extra": 1}, "unknown"),
        ({"removed": [1]}, r"removed\[0\]"),
    ],
)
def test_a_wrong_field_is_named(change: dict, message: str) -> None:
    document = json.loads(codec.delta_to_json(a_delta(1, rooms=[a_room(1)], instances=[an_instance(1)])))
    with pytest.raises(DecodeError, match=message):
        codec.delta_from_json(json.dumps({**document, **change}))


@pytest.mark.parametrize("payload", [b"", b"{", b"[]", b"\xff", b"[" * 100_000, b'{"id": 3}', b"null"])
def test_what_is_no_document_is_a_decode_error(payload: bytes) -> None:
    for read in (codec.snapshot_from_json, codec.delta_from_json, codec.node_from_json):
        with pytest.raises(DecodeError):
            read(payload)


@few
@given(st.recursive(st.none() | st.booleans() | st.floats() | st.text(max_size=3), lambda x: st.lists(x, max_size=3)))
def test_any_value_in_any_field_is_read_or_refused(value: object) -> None:
    document = json.loads(codec.node_to_json(an_instance(1), seq=1, frame="map"))
    for name in document:
        try:
            codec.node_from_json(json.dumps({**document, name: value}))
        except DecodeError:
            continue


# ---------------------------------------------------------------------------------------------------- arrays
@few
@given(
    hnp.arrays(
        st.sampled_from([np.float16, np.float32, np.float64, np.int8, np.int32, np.uint16, np.int64, np.bool_]),
        hnp.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=4),
    )
)
def test_an_array_survives_the_wire_in_any_byte_order(array: np.ndarray) -> None:
    payload, attachment = codec.array_to_bytes(array)
    back = codec.array_from_bytes(payload, attachment)
    assert back.dtype == array.dtype
    np.testing.assert_array_equal(back, array)
    assert codec.array_to_bytes(array.astype(array.dtype.newbyteorder(">"))) == (payload, attachment)


def test_points_are_little_endian_with_their_shape_beside_them() -> None:
    payload, attachment = codec.array_to_bytes(np.array([[1.0, 0.0, 0.0]], np.float32))
    assert payload == b"\x00\x00\x80\x3f" + bytes(8)
    assert json.loads(attachment) == {"dtype": "float32", "shape": [1, 3]}


@pytest.mark.parametrize(
    ("payload", "attachment"),
    [
        (b"", b""),
        (b"", b"{}"),
        (b"1234", b'{"dtype":"float32","shape":[2]}'),
        (b"1234", b'{"dtype":"object","shape":[1]}'),
        (b"1234", b'{"dtype":"float32","shape":[-1]}'),
        (b"1234", b'{"dtype":"float32","shape":[true]}'),
        (b"1234", b'{"dtype":["float32"],"shape":[1]}'),
        (b"", b'{"dtype":"float32","shape":[99999999999999999999, 0]}'),
    ],
)
def test_bytes_that_are_not_what_the_attachment_says_are_refused(payload: bytes, attachment: bytes) -> None:
    with pytest.raises(DecodeError):
        codec.array_from_bytes(payload, attachment)


def test_an_array_of_objects_has_no_wire_form() -> None:
    with pytest.raises(ValueError, match="no wire form"):
        codec.array_to_bytes(np.array([None]))


# ---------------------------------------------------------------------------------------------------- map picture
@few
@given(
    hnp.arrays(np.int8, hnp.array_shapes(min_dims=2, max_dims=2, max_side=9), elements=st.sampled_from([-1, 0, 100]))
)
def test_a_map_survives_its_picture(cells: np.ndarray) -> None:
    np.testing.assert_array_equal(codec.png_to_occupancy(codec.occupancy_to_png(cells)), cells)


def test_the_top_row_of_the_picture_has_the_largest_y() -> None:
    import cv2

    cells = np.array([[0, 0], [100, -1]], np.int8)  # row 0 = smallest y
    picture = cv2.imdecode(np.frombuffer(codec.occupancy_to_png(cells), np.uint8), cv2.IMREAD_UNCHANGED)
    assert picture.tolist() == [[0, 205], [254, 254]]


def test_a_map_without_cells_and_a_picture_that_is_none() -> None:
    with pytest.raises(ValueError, match="H, W > 0"):
        codec.occupancy_to_png(np.zeros((0, 3), np.int8))
    for payload in (b"", b"no picture"):
        with pytest.raises(DecodeError):
            codec.png_to_occupancy(payload)
