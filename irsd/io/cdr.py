"""ROS 2 messages as CDR bytes: reading, writing, type hashes and definitions. The only module that imports rosbags.

Bytes from the network are not trusted. A message must hold what its lengths promise, so a lying length field costs neither
time nor memory; whatever does not fit is a ``DecodeError`` that names the type. ``read`` copies nothing: arrays in a message
are read-only views of the bytes.

The few messages that both irsd and nav_bridge speak have their typed pair here (odometry in, path and goal out).
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from irsd.core.errors import DecodeError
from irsd.core.geometry import matrix_to_quat_xyzw
from irsd.core.types import OdomSample

POINT_CLOUD = "sensor_msgs/msg/PointCloud2"
POINT_FIELD = "sensor_msgs/msg/PointField"
IMAGE = "sensor_msgs/msg/Image"
COMPRESSED_IMAGE = "sensor_msgs/msg/CompressedImage"
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
ODOMETRY = "nav_msgs/msg/Odometry"
TF_MESSAGE = "tf2_msgs/msg/TFMessage"
PATH = "nav_msgs/msg/Path"
POSE_STAMPED = "geometry_msgs/msg/PoseStamped"

# The parts of ROS actions that a client speaks. A goal's fields stand in the request itself: in CDR that is the same.
SEND_GOAL_POSE = "nav2_msgs/msg/NavigateToPose_SendGoal_Request"
SEND_GOAL_PATH = "nav2_msgs/msg/FollowPath_SendGoal_Request"
SEND_GOAL_PATH_HUMBLE = "nav2_msgs/msg/HumbleFollowPath_SendGoal_Request"
SEND_GOAL_RESPONSE = "nav2_msgs/msg/SendGoal_Response"
GET_RESULT_REQUEST = "nav2_msgs/msg/GetResult_Request"
NAVIGATE_FEEDBACK = "nav2_msgs/msg/NavigateToPose_FeedbackMessage"
CANCEL_REQUEST, CANCEL_RESPONSE = "action_msgs/msg/CancelGoal_Request", "action_msgs/msg/CancelGoal_Response"
UUID, GOAL_INFO, TIME = "unique_identifier_msgs/msg/UUID", "action_msgs/msg/GoalInfo", "builtin_interfaces/msg/Time"
_GOAL_ID = "unique_identifier_msgs/UUID goal_id\n"
_ACTION_TYPES = {
    SEND_GOAL_POSE: _GOAL_ID + "geometry_msgs/PoseStamped pose\nstring behavior_tree",
    SEND_GOAL_PATH: _GOAL_ID
    + "nav_msgs/Path path\nstring controller_id\nstring goal_checker_id\nstring progress_checker_id",
    SEND_GOAL_PATH_HUMBLE: _GOAL_ID + "nav_msgs/Path path\nstring controller_id\nstring goal_checker_id",
    SEND_GOAL_RESPONSE: "bool accepted\nbuiltin_interfaces/Time stamp",
    GET_RESULT_REQUEST: _GOAL_ID.strip(),
    NAVIGATE_FEEDBACK: _GOAL_ID
    + "geometry_msgs/PoseStamped current_pose\nbuiltin_interfaces/Duration navigation_time\n"
    + "builtin_interfaces/Duration estimated_time_remaining\nint16 number_of_recoveries\nfloat32 distance_remaining",
    CANCEL_REQUEST: "action_msgs/GoalInfo goal_info",
    CANCEL_RESPONSE: "int8 return_code\naction_msgs/GoalInfo[] goals_canceling",
}

_BULK = frozenset({POINT_CLOUD, IMAGE, COMPRESSED_IMAGE})
_MAX_SMALL_BYTES = 256 * 1024
"""Of all other messages: a sequence of messages becomes an object for each, some 2 us and 300 bytes for every 24 bytes received."""

_MAX_STAMP_S = 2**31 - 1  # builtin_interfaces/msg/Time has int32 seconds


@cache
def _store() -> Typestore:
    """The message types of ROS 2 Humble; those used here are the same in every later release, hashes included."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    for name, text in _ACTION_TYPES.items():
        store.register(get_types_from_msg(text, name))
    return store


# ------------------------------------------------------------------------------------------------------ any message
def read(cdr: bytes | memoryview, type_name: str) -> Any:
    """The rosbags message of type ``type_name`` (``pkg/msg/Type``) in CDR bytes, either byte order.

    Sequences of numbers become numpy arrays that view ``cdr``. Raises DecodeError when the bytes can't be such a message:
    no CDR header, a length beyond the end, text that is not UTF-8, bytes left over.
    """
    if type_name not in _store().fielddefs:
        raise DecodeError(f"{type_name}: unknown message type")
    if len(cdr) > _MAX_SMALL_BYTES and type_name not in _BULK:
        raise DecodeError(f"{type_name}: {len(cdr)} bytes, at most {_MAX_SMALL_BYTES} are read")
    try:
        return _store().deserialize_cdr(memoryview(cdr), type_name)
    except (SerdeError, TypesysError, struct.error, ValueError, IndexError, TypeError, OverflowError) as error:
        raise DecodeError(f"{type_name}, {len(cdr)} bytes: {error}") from error


def write(message: Any) -> bytes:
    """CDR bytes (little endian, with the 4-byte header) of a rosbags message. Raises ValueError for values out of range."""
    try:
        return bytes(_store().serialize_cdr(message, message.__msgtype__, little_endian=True))
    except (SerdeError, struct.error, TypeError) as error:
        raise ValueError(f"{message.__msgtype__}: {error}") from error


def make(type_name: str, **fields: Any) -> Any:
    """A rosbags message of type ``type_name``. Every field must be given."""
    return _store().types[type_name](**fields)


def type_hash(type_name: str) -> str:
    """``RIHS01_...`` of a message type, as rmw_zenoh puts it into its keys."""
    return str(_store().hash_rihs01(type_name))


def message_definition(type_name: str) -> str:
    """The text of a message type with all it contains, as MCAP's ``ros2msg`` schemas hold it."""
    return str(_store().generate_msgdef(type_name, ros_version=2)[0])


# ------------------------------------------------------------------------------------------------------ common parts
def stamp_of(header: Any) -> int:
    """A header's stamp in nanoseconds. Raises DecodeError for a stamp before the epoch or with a full second of nanoseconds."""
    sec, nanosec = int(header.stamp.sec), int(header.stamp.nanosec)
    if sec < 0 or nanosec >= 1_000_000_000:
        raise DecodeError(f"stamp {sec} s + {nanosec} ns is not a time")
    return sec * 1_000_000_000 + nanosec


def frame_of(frame_id: str) -> str:
    """A frame name as tf2 wants it: without the leading slash that old drivers still send."""
    return frame_id.lstrip("/")


def make_header(stamp_ns: int, frame_id: str) -> Any:
    """std_msgs/msg/Header. Raises ValueError for a stamp that its 32-bit seconds can't hold."""
    if not 0 <= stamp_ns <= _MAX_STAMP_S * 1_000_000_000:
        raise ValueError(f"stamp {stamp_ns} ns does not fit a ROS header")
    sec, nanosec = divmod(int(stamp_ns), 1_000_000_000)
    stamp = make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)
    return make("std_msgs/msg/Header", stamp=stamp, frame_id=frame_id)


def make_pose_message(position_m: Sequence[float] | np.ndarray, quat_xyzw: Sequence[float] | np.ndarray) -> Any:
    """geometry_msgs/msg/Pose."""
    x, y, z = map(float, position_m)
    qx, qy, qz, qw = map(float, quat_xyzw)
    return make(
        "geometry_msgs/msg/Pose",
        position=make("geometry_msgs/msg/Point", x=x, y=y, z=z),
        orientation=make("geometry_msgs/msg/Quaternion", x=qx, y=qy, z=qz, w=qw),
    )


def make_transform(stamp_ns: int, parent: str, child: str, parent_T_child: np.ndarray) -> Any:
    """geometry_msgs/msg/TransformStamped of a pose [4, 4]."""
    x, y, z = map(float, parent_T_child[:3, 3])
    qx, qy, qz, qw = map(float, matrix_to_quat_xyzw(parent_T_child[:3, :3]))
    return make(
        "geometry_msgs/msg/TransformStamped",
        header=make_header(stamp_ns, parent),
        child_frame_id=child,
        transform=make(
            "geometry_msgs/msg/Transform",
            translation=make("geometry_msgs/msg/Vector3", x=x, y=y, z=z),
            rotation=make("geometry_msgs/msg/Quaternion", x=qx, y=qy, z=qz, w=qw),
        ),
    )


@np.errstate(invalid="ignore", over="ignore")
def quat_of(message: Any, what: str) -> np.ndarray:
    """Unit quat_xyzw float64 [4] of a geometry_msgs quaternion. Raises DecodeError when it has no direction."""
    quat = np.array([message.x, message.y, message.z, message.w], np.float64)
    norm = float(np.linalg.norm(quat))
    if not 0.5 < norm < 2.0:  # also false for NaN; a rotation that far from unit length is not rounding
        raise DecodeError(f"{what}: quaternion {quat.tolist()} is not a rotation")
    return quat / norm


@np.errstate(invalid="ignore", over="ignore")
def vector_of(message: Any, what: str) -> np.ndarray:
    """float64 [3] of a geometry_msgs point or vector. Raises DecodeError when it is not finite or farther than Earth is wide."""
    vector = np.array([message.x, message.y, message.z], np.float64)
    if not (np.abs(vector) < 1e8).all():
        raise DecodeError(f"{what}: position {vector.tolist()} is not a place")
    return vector


# ------------------------------------------------------------------------------------------------------ typed pairs
def decode_odometry(cdr: bytes | memoryview) -> OdomSample:
    """nav_msgs/msg/Odometry. Raises DecodeError for bytes, pose or frames that can't be."""
    message = read(cdr, ODOMETRY)
    pose = message.pose.pose
    child = frame_of(message.child_frame_id)
    if not child:
        raise DecodeError("odometry: child_frame_id is empty, so it is unknown what moved")
    return OdomSample(
        stamp_ns=stamp_of(message.header),
        frame_id=frame_of(message.header.frame_id),
        child_frame_id=child,
        position_m=vector_of(pose.position, "odometry"),
        quat_xyzw=quat_of(pose.orientation, "odometry"),
    )


def _pose_stamped(stamp_ns: int, frame_id: str, xy_yaw: tuple[float, float, float]) -> Any:
    x, y, yaw = xy_yaw
    pose = make_pose_message((x, y, 0.0), (0.0, 0.0, np.sin(yaw / 2), np.cos(yaw / 2)))
    return make(POSE_STAMPED, header=make_header(stamp_ns, frame_id), pose=pose)


def encode_pose_stamped(stamp_ns: int, frame_id: str, xy_yaw: tuple[float, float, float]) -> bytes:
    """geometry_msgs/msg/PoseStamped on the floor: (x, y) metres, yaw radians."""
    return write(_pose_stamped(stamp_ns, frame_id, xy_yaw))


def encode_path(stamp_ns: int, frame_id: str, waypoints: Sequence[tuple[float, float, float]]) -> bytes:
    """nav_msgs/msg/Path of (x, y, yaw) waypoints; no waypoints is a path too (it means stop)."""
    poses = [_pose_stamped(stamp_ns, frame_id, waypoint) for waypoint in waypoints]
    return write(make(PATH, header=make_header(stamp_ns, frame_id), poses=poses))


def make_uuid(goal_id: bytes) -> Any:
    """unique_identifier_msgs/msg/UUID of 16 bytes."""
    return make(UUID, uuid=np.frombuffer(goal_id, np.uint8))


def encode_goal_pose(goal_id: bytes, stamp_ns: int, frame_id: str, xy_yaw: tuple[float, float, float]) -> bytes:
    """The request of NavigateToPose's send_goal: a pose on the floor, Nav2's own behaviour tree."""
    pose = _pose_stamped(stamp_ns, frame_id, xy_yaw)
    return write(make(SEND_GOAL_POSE, goal_id=make_uuid(goal_id), pose=pose, behavior_tree=""))


def encode_goal_path(
    goal_id: bytes, stamp_ns: int, frame_id: str, waypoints: Sequence[tuple[float, float, float]], checker: bool
) -> bytes:
    """The request of FollowPath's send_goal, Nav2's own controller and goal checker.

    checker: with the field progress_checker_id, which Nav2 has since Iron.
    """
    poses = [_pose_stamped(stamp_ns, frame_id, waypoint) for waypoint in waypoints]
    path = make(PATH, header=make_header(stamp_ns, frame_id), poses=poses)
    kind = SEND_GOAL_PATH if checker else SEND_GOAL_PATH_HUMBLE
    more = {"progress_checker_id": ""} if checker else {}
    return write(make(kind, goal_id=make_uuid(goal_id), path=path, controller_id="", goal_checker_id="", **more))


def encode_cancel(goal_id: bytes) -> bytes:
    """The request of cancel_goal for one goal, whenever it was accepted."""
    info = make(GOAL_INFO, goal_id=make_uuid(goal_id), stamp=make(TIME, sec=0, nanosec=0))
    return write(make(CANCEL_REQUEST, goal_info=info))


def decode_result_status(cdr: bytes) -> int:
    """The status in a get_result response: 4 succeeded, 5 canceled, 6 aborted. What follows it differs between releases."""
    if len(cdr) < 5:
        raise DecodeError(f"get_result: {len(cdr)} bytes hold no status")
    return cdr[4]
