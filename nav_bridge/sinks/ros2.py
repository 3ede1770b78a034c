"""Goals for ROS 2 planners: PoseStamped on a goal topic and nav_msgs/Path on a path topic, as either zenoh bridge expects them."""

from __future__ import annotations

import hashlib

from irsd.core.runtime import wall_clock_ns
from irsd.io.cdr import encode_path, encode_pose_stamped, type_hash
from irsd.io.keys import bridge_key, check_ros_topic, rmw_key, ros_attachment, ros_endpoint_token, ros_node_token
from irsd.io.session import CDR, Handle, Session
from nav_bridge.config import SinkSettings
from nav_bridge.sinks.base import Plan

_NODE = "nav_bridge"
_POSE, _PATH = "geometry_msgs/msg/PoseStamped", "nav_msgs/msg/Path"


class RosSink:
    """Publishes on the configured topics; for rmw_zenoh with attachment and tokens, so that ROS tools see us. One thread."""

    def __init__(self, session: Session, settings: SinkSettings) -> None:
        self._session = session
        self._settings = settings
        self._seq = 0
        self._gid = hashlib.sha256(f"{session.zid}/{_NODE}".encode()).digest()[:16]
        self._tokens: list[Handle] = []
        self._goal_key = self._key(settings.goal_topic, _POSE, 1)
        self._path_key = self._key(settings.path_topic, _PATH, 2)
        if self._tokens:
            self._tokens.append(session.announce(ros_node_token(session.zid, _NODE, settings.domain)))

    def _key(self, topic: str, type_name: str, entity: int) -> str:
        """The key a topic is published under, "" for no topic; declares the token that rmw_zenoh looks for."""
        if not topic:
            return ""
        name, s = check_ros_topic(topic), self._settings
        if s.form == "bridge":
            return bridge_key(name, s.namespace)
        known = type_hash(type_name)
        token = ros_endpoint_token(
            self._session.zid, _NODE, entity, name, type_name, known, publishes=True, domain=s.domain
        )
        self._tokens.append(self._session.announce(token))
        return rmw_key(name, type_name, known, s.domain)

    def send(self, plan: Plan) -> None:
        """The plan on both topics. No waypoints: an empty path; a goal topic has no word for stop."""
        stamp_ns = wall_clock_ns()
        if self._path_key:
            self._put(self._path_key, encode_path(stamp_ns, plan.frame, plan.waypoints), stamp_ns)
        if self._goal_key and plan.waypoints:
            self._put(self._goal_key, encode_pose_stamped(stamp_ns, plan.frame, plan.waypoints[-1]), stamp_ns)

    def beat(self, plan: Plan) -> None:
        """These topics know no heartbeat."""

    def trouble(self) -> str:
        """Nobody answers on a topic."""
        return ""

    def _put(self, key: str, payload: bytes, stamp_ns: int) -> None:
        self._seq += 1
        attachment = ros_attachment(self._seq, stamp_ns, self._gid) if self._settings.form == "rmw" else None
        self._session.put(key, payload, encoding=CDR, attachment=attachment)

    def close(self) -> None:
        for token in self._tokens:
            token.close()
