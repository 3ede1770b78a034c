"""CDR: what is written is read, in both byte orders, and no bytes at all get past DecodeError."""

from __future__ import annotations

import contextlib
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from irsd.core.errors import DecodeError
from irsd.core.types import OdomSample
from irsd.io import cdr as ros
from irsd.sensors.encode import encode_odometry

TYPES = (ros.POINT_CLOUD, ros.IMAGE, ros.COMPRESSED_IMAGE, ros.CAMERA_INFO, ros.ODOMETRY, ros.TF_MESSAGE, ros.PATH)


def sample(stamp_ns: int = 1_700_000_000_123_456_789) -> OdomSample:
    return OdomSample(stamp_ns, "odom", "base_link", np.array([1.0, -2.0, 0.5]), np.array([0.0, 0.0, 0.6, 0.8]))


@pytest.mark.parametrize("type_name", TYPES)
def test_no_bytes_are_no_message(type_name: str) -> None:
    for nothing in (b"", b"\0", b"\0\1\0\0", b"\xff" * 64):
        with pytest.raises(DecodeError, match=type_name):
            ros.read(nothing, type_name)


def test_an_unknown_type_is_named() -> None:
    with pytest.raises(DecodeError, match="no_pkg/msg/Nothing"):
        ros.read(b"\0\1\0\0", "no_pkg/msg/Nothing")


@given(st.sampled_from(TYPES), st.binary(max_size=400))
def test_random_bytes_only_raise_decode_error(type_name: str, payload: bytes) -> None:
    with contextlib.suppress(DecodeError):
        assert ros.read(b"\0\1\0\0" + payload, type_name).__msgtype__ == type_name


@given(st.data())
def test_altered_odometry_only_raises_decode_error(data: st.DataObject) -> None:
    good = bytearray(encode_odometry(sample()))
    for _ in range(data.draw(st.integers(1, 4))):
        good[data.draw(st.integers(0, len(good) - 1))] = data.draw(st.integers(0, 255))
    try:
        got = ros.decode_odometry(bytes(good[: data.draw(st.integers(0, len(good)))]))
    except DecodeError:
        return
    assert np.isfinite(got.position_m).all()
    assert np.linalg.norm(got.quat_xyzw) == pytest.approx(1.0)


def test_a_lying_length_costs_nothing() -> None:
    """Four gigabytes of points are claimed in 200 bytes."""
    header = ros.make_header(1, "lidar")
    message = ros.make(
        ros.POINT_CLOUD,
        header=header,
        height=1,
        width=0,
        fields=[],
        is_bigendian=False,
        point_step=16,
        row_step=0,
        data=np.zeros(0, np.uint8),
        is_dense=True,
    )
    good = bytearray(ros.write(message))
    at = len(good) - 5  # the length of ``data`` stands before the last byte, is_dense
    assert good[at : at + 4] == b"\0\0\0\0"
    good[at : at + 4] = struct.pack("<I", 0xFFFFFFF0)
    with pytest.raises(DecodeError, match="sequence length"):
        ros.read(bytes(good), ros.POINT_CLOUD)


def test_odometry_comes_back_exactly() -> None:
    got = ros.decode_odometry(encode_odometry(sample()))
    assert (got.stamp_ns, got.frame_id, got.child_frame_id) == (sample().stamp_ns, "odom", "base_link")
    np.testing.assert_array_equal(got.position_m, sample().position_m)
    np.testing.assert_allclose(got.quat_xyzw, sample().quat_xyzw, atol=1e-15)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"quat_xyzw": np.zeros(4)}, "not a rotation"),
        ({"quat_xyzw": np.array([np.nan, 0, 0, 1])}, "not a rotation"),
        ({"position_m": np.array([np.inf, 0, 0])}, "not a place"),
        ({"child_frame_id": ""}, "child_frame_id"),
    ],
)
def test_odometry_that_can_not_be_is_refused(change: dict[str, object], says: str) -> None:
    values = {name: getattr(sample(), name) for name in OdomSample.__dataclass_fields__} | change
    with pytest.raises(DecodeError, match=says):
        ros.decode_odometry(encode_odometry(OdomSample(**values)))


@pytest.mark.parametrize("little", [True, False])
def test_both_byte_orders_are_read(little: bool) -> None:
    message = ros.read(encode_odometry(sample()), ros.ODOMETRY)
    cdr = bytes(ros._store().serialize_cdr(message, ros.ODOMETRY, little_endian=little))
    assert cdr[1] == int(little)
    np.testing.assert_array_equal(ros.decode_odometry(cdr).position_m, sample().position_m)


def test_arrays_are_views_of_the_bytes() -> None:
    message = ros.make(
        ros.COMPRESSED_IMAGE, header=ros.make_header(5, "c"), format="png", data=np.arange(9, dtype=np.uint8)
    )
    cdr = ros.write(message)
    data = ros.read(cdr, ros.COMPRESSED_IMAGE).data
    assert not data.flags.owndata
    assert not data.flags.writeable
    assert data.tolist() == list(range(9))


def test_a_stamp_that_ros_can_not_hold_is_refused() -> None:
    for stamp_ns in (-1, 2**31 * 10**9):
        with pytest.raises(ValueError, match="stamp"):
            ros.make_header(stamp_ns, "map")
    with pytest.raises(ValueError, match="Image"):
        ros.write(ros.make(ros.IMAGE, header=ros.make_header(0, ""), height=-1, width=0, encoding="", is_bigendian=0, step=0,
                           data=np.zeros(0, np.uint8)))  # fmt: skip


def test_hashes_are_those_that_ros_shows() -> None:
    assert ros.type_hash(ros.POINT_CLOUD) == "RIHS01_9198cabf7da3796ae6fe19c4cb3bdd3525492988c70522628af5daa124bae2b5"


def test_definitions_hold_what_they_contain() -> None:
    text = ros.message_definition(ros.PATH)
    assert "geometry_msgs/PoseStamped[] poses" in text
    assert "MSG: geometry_msgs/Quaternion" in text


def test_path_and_pose_say_where_and_which_way() -> None:
    assert ros.read(ros.encode_path(7, "map", []), ros.PATH).poses == []
    path = ros.read(ros.encode_path(7, "map", [(1.0, 2.0, 0.0), (3.0, 4.0, np.pi / 2)]), ros.PATH)
    assert [p.pose.position.x for p in path.poses] == [1.0, 3.0]
    assert path.poses[1].pose.orientation.z == pytest.approx(np.sqrt(0.5))
    goal = ros.read(ros.encode_pose_stamped(7, "map", (1.0, 2.0, np.pi)), ros.POSE_STAMPED)
    assert goal.header.frame_id == "map"
    assert abs(goal.pose.orientation.z) == pytest.approx(1.0)
