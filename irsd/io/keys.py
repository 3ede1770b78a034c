"""Every zenoh key irsd speaks or hears, as text: our own under ``irs/<robot>/``, and ROS 2 topics as the two bridges put them.

zenoh-bridge-ros2dds: the ROS name without its first slash, ``lidar/points``, behind the bridge's namespace if it has one.
rmw_zenoh: ``<domain>/lidar/points/sensor_msgs::msg::dds_::PointCloud2_/RIHS01_<hash>``, with an attachment on each sample.
"""

from __future__ import annotations

import hashlib
import re
import struct
from dataclasses import dataclass
from typing import NamedTuple

from irsd.core.errors import ConfigError

ROOT = "irs"

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,62}")
_ROS_TOPIC = re.compile(r"/?[A-Za-z0-9_~]+(/[A-Za-z0-9_~]+)*")
_RMW_TYPE = re.compile(r"([A-Za-z0-9_]+)::(msg|srv|action)::dds_::([A-Za-z0-9_]+)_")
_RMW_HASH = re.compile(r"RIHS01_[0-9a-f]+|TypeHashNotSupported")
_ATTACHMENT = struct.Struct("<qqB16s")
_GID_BYTES = 16


def check_robot_name(name: str) -> str:
    """The name itself, when it can stand in a key. Raises ConfigError for slashes, wildcards, blanks and the like."""
    if not _NAME.fullmatch(name):
        raise ConfigError(
            f"robot = {name!r}: a robot's name is one part of a zenoh key: letters, digits, '_', '-' and '.', "
            "at most 63, the first a letter or digit (no '/', '*', '$', '#', '?')"
        )
    return name


@dataclass(frozen=True)
class RobotKeys:
    """The keys of one robot. ``RobotKeys("*")`` is not possible: see ``any_robot``."""

    robot: str

    def __post_init__(self) -> None:
        check_robot_name(self.robot)

    def key(self, path: str) -> str:
        """``irs/<robot>/<path>``."""
        return f"{ROOT}/{self.robot}/{path}"

    @property
    def delta(self) -> str:
        return self.key("graph/delta")

    @property
    def snapshot(self) -> str:
        return self.key("graph/snapshot")

    @property
    def building(self) -> str:
        return self.key("graph/building")

    @property
    def rooms(self) -> str:
        """All rooms (a key expression)."""
        return self.key("graph/rooms/*")

    @property
    def instances(self) -> str:
        """All instances (a key expression)."""
        return self.key("graph/instances/*")

    def room(self, room_id: str) -> str:
        return self.key(f"graph/rooms/{room_id}")

    def instance(self, instance_id: str) -> str:
        return self.key(f"graph/instances/{instance_id}")

    def points(self, instance_id: str) -> str:
        return self.key(f"graph/instances/{instance_id}/points")

    def embedding(self, instance_id: str) -> str:
        return self.key(f"graph/instances/{instance_id}/embedding")

    @property
    def status(self) -> str:
        return self.key("status")

    @property
    def alive(self) -> str:
        return self.key("alive")

    @property
    def occupancy(self) -> str:
        return self.key("map/occupancy")

    @property
    def map_odom(self) -> str:
        """Where the odometry's frame lies in the map."""
        return self.key("map/odom")

    def command(self, name: str) -> str:
        return self.key(f"cmd/{name}")

    def nav(self, name: str) -> str:
        """goto, cancel, state, waypoints, path or goal_pose."""
        return self.key(f"nav/{name}")


def any_robot(path: str) -> str:
    """``irs/*/<path>``: the same thing of every robot."""
    return f"{ROOT}/*/{path}"


def robot_of(key: str) -> str | None:
    """The robot a key of ours belongs to, None for any other key."""
    parts = key.split("/", 2)
    return parts[1] if len(parts) == 3 and parts[0] == ROOT else None


# -------------------------------------------------------------------------------------------------------------- ROS 2
class RosKey(NamedTuple):
    """topic with its first slash; type_name ``sensor_msgs/msg/PointCloud2`` and domain only where the key tells them."""

    topic: str
    type_name: str | None
    domain: int | None


def check_ros_topic(topic: str) -> str:
    """The topic itself, with a leading slash. Raises ConfigError for names ROS does not allow."""
    if not _ROS_TOPIC.fullmatch(topic):
        raise ConfigError(f"topic = {topic!r}: must be a ROS topic such as /lidar/points")
    return "/" + topic.strip("/")


def bridge_key(topic: str, namespace: str = "") -> str:
    """The key of a ROS topic behind zenoh-bridge-ros2dds: ``/lidar/points`` -> ``lidar/points`` or ``bot1/lidar/points``."""
    prefix = namespace.strip("/")
    return f"{prefix}/{topic.strip('/')}" if prefix else topic.strip("/")


def rmw_key(topic: str, type_name: str, type_hash: str, domain: int = 0) -> str:
    """The key rmw_zenoh uses. type_name: ``sensor_msgs/msg/PointCloud2``; type_hash: ``RIHS01_...``."""
    return f"{domain}/{topic.strip('/')}/{rmw_type(type_name)}/{type_hash}"


def rmw_type(type_name: str) -> str:
    """``sensor_msgs/msg/PointCloud2`` -> ``sensor_msgs::msg::dds_::PointCloud2_``."""
    package, kind, name = type_name.split("/")
    return f"{package}::{kind}::dds_::{name}_"


def subscriptions(
    topic: str, type_name: str | None, *, namespace: str = "", domain: int | None = None
) -> tuple[str, ...]:
    """The key expressions under which a topic can arrive, first from a bridge, then from rmw_zenoh.

    domain: only that ROS domain, None = any. The type is part of the rmw expression (any hash: hashes differ between
    distributions); exactly two parts follow the topic, so that rmw's private ``_buf`` keys are not received twice.
    A topic that is not ROS (type_name None) has only the bridge form.
    """
    plain = bridge_key(topic, namespace)
    if type_name is None:
        return (plain,)
    prefix = "*" if domain is None else str(domain)
    return (plain, f"{prefix}/{topic.strip('/')}/{rmw_type(type_name)}/*")


def parse_ros_key(key: str, namespace: str = "") -> RosKey:
    """Which ROS topic a key is. Anything that is not of rmw_zenoh's form is read as a bridge key.

    namespace: the bridge's prefix, taken off where it stands.
    """
    parts = key.split("/")
    if len(parts) >= 4 and parts[0].isdigit() and _RMW_HASH.fullmatch(parts[-1]):
        match = _RMW_TYPE.fullmatch(parts[-2])
        if match:
            return RosKey("/" + "/".join(parts[1:-2]), "/".join(match.groups()), int(parts[0]))
    prefix = namespace.strip("/")
    if prefix and key.startswith(prefix + "/"):
        key = key[len(prefix) + 1 :]
    return RosKey("/" + key, None, None)


def ros_attachment(sequence: int, stamp_ns: int, gid: bytes) -> bytes:
    """The 33 bytes without which a ROS node drops a sample of rmw_zenoh: sequence, source time, 16-byte sender id."""
    if len(gid) != _GID_BYTES:
        raise ValueError(f"a gid has {_GID_BYTES} bytes, got {len(gid)}")
    return _ATTACHMENT.pack(sequence, stamp_ns, _GID_BYTES, gid)


def parse_ros_attachment(attachment: bytes) -> tuple[int, int, bytes] | None:
    """(sequence, source stamp_ns, gid) of rmw_zenoh's attachment, None when it is something else."""
    if len(attachment) != _ATTACHMENT.size:
        return None
    sequence, stamp_ns, length, gid = _ATTACHMENT.unpack(attachment)
    return (sequence, stamp_ns, gid) if length == _GID_BYTES else None


def ros_node_token(zid: str, node: str, domain: int = 0) -> str:
    """Liveliness key that shows this process as a node in ``ros2 node list``."""
    return f"@ros2_lv/{domain}/{zid}/0/0/NN/%/%/{node}"


def ros_endpoint_token(  # one argument per part of the key
    zid: str,
    node: str,
    entity: int,
    topic: str,
    type_name: str,
    type_hash: str,
    *,
    publishes: bool,
    latched: bool = False,
    domain: int = 0,
) -> str:
    """Liveliness key that shows a publisher or subscriber in ``ros2 topic info``.

    Newer rmw_zenoh publishers of point clouds and images stay silent until they see such a token of a plain subscriber.
    latched: TRANSIENT_LOCAL (tf_static, map). Otherwise sensor QoS for subscribers, ROS defaults for publishers.
    """
    kind = "MP" if publishes else "MS"
    name = topic.strip("/").replace("/", "%")
    quality = ":1:,1:,:,:,," if latched else ("::,:,:,:,," if publishes else "2::,5:,:,:,,")
    return f"@ros2_lv/{domain}/{zid}/0/{entity}/{kind}/%/%/{node}/%{name}/{rmw_type(type_name)}/{type_hash}/{quality}"


def ros_gid(token: str) -> bytes:
    """A sender id for ``ros_attachment``: any 16 bytes that stay the same for one publisher; here a digest of its token."""
    return hashlib.blake2b(token.encode(), digest_size=_GID_BYTES).digest()


def ros_service_token(
    zid: str, node: str, entity: int, service: str, rmw_type_name: str, known: str, domain: int = 0
) -> str:
    """Liveliness key of a service server. rmw_type_name: as it stands in keys, ``nav2_msgs::action::dds_::..._SendGoal_``."""
    name = service.strip("/").replace("/", "%")
    return f"@ros2_lv/{domain}/{zid}/0/{entity}/SS/%/%/{node}/%{name}/{rmw_type_name}/{known}/::,:,:,:,,"


def ros_service_tokens(domain: int = 0) -> str:
    """All service servers of a domain (a key expression)."""
    return f"@ros2_lv/{domain}/*/*/*/SS/**"


def service_key_of(token: str, service: str) -> str | None:
    """The key under which a service answers, from its server's token: type and hash are not guessed. None for another service."""
    parts = token.split("/")
    if len(parts) < 12 or parts[0] != "@ros2_lv" or parts[9] != "%" + service.strip("/").replace("/", "%"):
        return None
    return f"{parts[1]}/{service.strip('/')}/{parts[10]}/{parts[11]}"
