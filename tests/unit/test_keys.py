"""Keys of ours and of ROS, both ways."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from irsd.core.errors import ConfigError
from irsd.io import cdr
from irsd.io.keys import (
    RobotKeys,
    bridge_key,
    check_robot_name,
    check_ros_topic,
    parse_ros_attachment,
    parse_ros_key,
    rmw_key,
    robot_of,
    ros_attachment,
    ros_endpoint_token,
    ros_gid,
    ros_node_token,
    subscriptions,
)
from irsd.io.session import matches

POINTS = "sensor_msgs/msg/PointCloud2"
HASH = "RIHS01_9198cabf7da3796ae6fe19c4cb3bdd3525492988c70522628af5daa124bae2b5"

names = st.from_regex(r"[a-z_][a-z0-9_]{0,8}", fullmatch=True)
topics = st.lists(names, min_size=1, max_size=4).map(lambda parts: "/" + "/".join(parts))


@pytest.mark.parametrize("name", ["", "a/b", "*", "**", "a*", "$x", "a b", "robot?", "#", "@x", "ä", "x" * 64, "a\n"])
def test_names_that_would_break_a_key_are_refused(name: str) -> None:
    with pytest.raises(ConfigError, match="robot"):
        check_robot_name(name)
    with pytest.raises(ConfigError):
        RobotKeys(name)


def test_our_keys() -> None:
    keys = RobotKeys("bot-1")
    assert keys.delta == "irs/bot-1/graph/delta"
    assert keys.instance("I7") == "irs/bot-1/graph/instances/I7"
    assert keys.points("I7") == "irs/bot-1/graph/instances/I7/points"
    assert keys.nav("goto") == "irs/bot-1/nav/goto"
    assert matches("irs/*/graph/instances/**", keys.instance("I7"))
    assert matches(keys.instances, keys.instance("I7"))
    assert not matches(keys.instances, keys.points("I7"))
    assert robot_of(keys.status) == "bot-1"
    assert robot_of("lidar/points") is None


def test_forms_of_a_topic() -> None:
    assert bridge_key("/lidar/points") == "lidar/points"
    assert bridge_key("/lidar/points", "/bot1/") == "bot1/lidar/points"
    assert rmw_key("/lidar/points", POINTS, HASH) == f"0/lidar/points/sensor_msgs::msg::dds_::PointCloud2_/{HASH}"
    assert cdr.type_hash(POINTS) == HASH


@pytest.mark.parametrize("topic", ["", "/", "a//b", "/a/", "a b", "/*", "/a/**", "/a$"])
def test_names_that_are_no_topic_are_refused(topic: str) -> None:
    with pytest.raises(ConfigError, match="topic"):
        check_ros_topic(topic)


@given(topic=topics, domain=st.integers(0, 232), namespace=st.sampled_from(["", "bot1"]))
def test_subscriptions_catch_both_forms_and_parse_back(topic: str, domain: int, namespace: str) -> None:
    plain, rmw = subscriptions(topic, POINTS, namespace=namespace)
    sent = rmw_key(topic, POINTS, HASH, domain)
    assert matches(plain, bridge_key(topic, namespace))
    assert matches(rmw, sent)
    assert not matches(rmw, sent + "/_buf_cpu")
    assert not matches(plain, sent)
    assert parse_ros_key(sent) == (topic, POINTS, domain)
    assert parse_ros_key(bridge_key(topic, namespace), namespace) == (topic, None, None)


def test_subscription_of_one_domain_and_of_no_ros_topic() -> None:
    _, rmw = subscriptions("/odom", "nav_msgs/msg/Odometry", domain=7)
    assert rmw == "7/odom/nav_msgs::msg::dds_::Odometry_/*"
    assert subscriptions("/detections/info", None) == ("detections/info",)


def test_humble_has_no_type_hash() -> None:
    key = rmw_key("/odom", "nav_msgs/msg/Odometry", "TypeHashNotSupported")
    assert parse_ros_key(key) == ("/odom", "nav_msgs/msg/Odometry", 0)


@pytest.mark.parametrize("key", ["0/odom", "0/odom/nav_msgs::msg::dds_::Odometry_/xyz", "x/a/b/RIHS01_00", "1/2/3/4"])
def test_what_only_looks_like_rmw_is_a_bridge_key(key: str) -> None:
    assert parse_ros_key(key) == ("/" + key, None, None)


@given(st.integers(-(2**63), 2**63 - 1), st.integers(0, 2**63 - 1), st.binary(min_size=16, max_size=16))
def test_attachment_round_trip(sequence: int, stamp_ns: int, gid: bytes) -> None:
    packed = ros_attachment(sequence, stamp_ns, gid)
    assert len(packed) == 33
    assert parse_ros_attachment(packed) == (sequence, stamp_ns, gid)


@given(st.binary(max_size=64))
def test_foreign_attachments_are_none_or_well_formed(data: bytes) -> None:
    parsed = parse_ros_attachment(data)
    assert parsed is None or ros_attachment(*parsed) == data


def test_a_gid_has_16_bytes() -> None:
    assert len(ros_gid("token")) == 16
    with pytest.raises(ValueError, match="16"):
        ros_attachment(0, 0, b"short")


def test_tokens_have_the_parts_rmw_zenoh_reads() -> None:
    node = ros_node_token("abc", "irsd")
    assert node == "@ros2_lv/0/abc/0/0/NN/%/%/irsd"
    token = ros_endpoint_token("abc", "irsd", 3, "/lidar/points", POINTS, HASH, publishes=False)
    parts = token.split("/")
    assert len(parts) == 13
    assert parts[5] == "MS"
    assert parts[9:11] == ["%lidar%points", "sensor_msgs::msg::dds_::PointCloud2_"]
    assert parts[12] == "2::,5:,:,:,,"
    latched = ros_endpoint_token(
        "abc", "irsd", 4, "/tf_static", "tf2_msgs/msg/TFMessage", HASH, publishes=False, latched=True
    )
    assert latched.endswith("/:1:,1:,:,:,,")
