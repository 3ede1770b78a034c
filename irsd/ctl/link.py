"""Which irsd a command speaks to, and how to reach it."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from irsd.core.errors import TransportError
from irsd.io.endpoints import ZenohSettings, with_environment
from irsd.io.keys import RobotKeys, any_robot, robot_of
from irsd.io.session import Session, open_session


@dataclass(frozen=True, slots=True)
class Target:
    """The options every live command shares."""

    robot: str | None
    endpoint: str | None
    timeout_s: float


@contextmanager
def connected(target: Target) -> Iterator[tuple[Session, RobotKeys]]:
    """A session to irsd and the keys of the robot meant; TransportError when none, or more than one, could be meant."""
    settings = with_environment(ZenohSettings(open_timeout_s=min(target.timeout_s, 5.0)), target.endpoint)
    with open_session(settings, "client") as session:
        yield session, RobotKeys(target.robot or only_robot(session, settings.endpoint, target.timeout_s))


def only_robot(session: Session, endpoint: str, timeout_s: float) -> str:
    """Name of the one robot that is alive."""
    names = {robot_of(key) for key in session.find_alive(any_robot("alive"), timeout_s=timeout_s)} - {None}
    if len(names) == 1:
        return str(names.pop())
    if not names:
        raise TransportError(
            f"no irsd is alive at {endpoint}: start it (irsd, or systemctl start irsd), or give --endpoint"
        )
    raise TransportError(f"several robots are here, choose with --robot: {', '.join(sorted(map(str, names)))}")


def ask(session: Session, key: str, timeout_s: float, payload: bytes | None = None) -> bytes:
    """The one answer to a question; TransportError when nobody answers or the answer is an error."""
    replies = session.get(key, timeout_s=timeout_s, payload=payload)
    for reply in replies:
        if reply.ok:
            return reply.payload
    if replies:
        raise TransportError(f"{key}: {replies[0].error}")
    raise TransportError(f"nobody answers to {key} within {timeout_s:g} s")


def ask_json(session: Session, key: str, timeout_s: float, payload: dict[str, Any] | None = None) -> dict[str, Any]:
    """The one answer to a question, as a JSON object."""
    sent = None if payload is None else json.dumps(payload).encode()
    return dict(json.loads(ask(session, key, timeout_s, sent)))
