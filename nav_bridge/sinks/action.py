"""The services of one ROS 2 action, asked over zenoh-bridge-ros2dds or rmw_zenoh: requests and responses are CDR."""

from __future__ import annotations

import hashlib

from irsd.core.errors import TransportError
from irsd.core.runtime import wall_clock_ns
from irsd.io.cdr import CANCEL_RESPONSE, encode_cancel, read
from irsd.io.keys import bridge_key, ros_attachment, ros_service_tokens, service_key_of
from irsd.io.session import Session
from nav_bridge.config import SinkSettings


class ActionClient:
    """Asks the server of the action that the settings name."""

    def __init__(self, session: Session, settings: SinkSettings) -> None:
        self._session = session
        self._settings = settings
        self._gid = hashlib.sha256(f"{session.zid}/nav2".encode()).digest()[:16]  # who asks, on rmw_zenoh
        self._seq = 0
        self.name = (settings.action_name or settings.action).strip("/")

    @property
    def feedback_key(self) -> str:
        """Where the server's feedback comes."""
        s, name = self._settings, f"{self.name}/_action/feedback"
        return bridge_key(name, s.namespace) if s.form == "bridge" else f"{s.domain}/{name}/*/*"

    def ask(self, service: str, request: bytes, timeout_s: float) -> bytes:
        """The response of send_goal, get_result or cancel_goal. TransportError when nobody answers."""
        key, attachment = self._key(f"{self.name}/_action/{service}"), None
        if self._settings.form == "rmw":
            self._seq += 1
            attachment = ros_attachment(self._seq, wall_clock_ns(), self._gid)
        replies = self._session.get(key, timeout_s=timeout_s, payload=request, attachment=attachment)
        for reply in replies:
            if reply.ok:
                return reply.payload
        raise TransportError(replies[0].error if replies else f"nobody answers to {key}")

    def cancel(self, goal_id: bytes, timeout_s: float) -> int:
        """Asks for a goal's end; the server's return code, 0 for done. Raises as ``ask``, DecodeError for nonsense."""
        return int(read(self.ask("cancel_goal", encode_cancel(goal_id), timeout_s), CANCEL_RESPONSE).return_code)

    def _key(self, service: str) -> str:
        s = self._settings
        if s.form == "bridge":
            return bridge_key(service, s.namespace)
        for token in self._session.find_alive(ros_service_tokens(s.domain)):
            if (key := service_key_of(token, service)) is not None:
                return key
        raise TransportError(f"no node of ROS domain {s.domain} serves /{service}")
