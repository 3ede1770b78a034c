"""What is asked of the bridge over zenoh: requests on their way to its loop, and the check of what they hold."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from irsd.core.errors import DecodeError
from irsd.core.runtime import Event
from irsd.io.session import Query
from nav_bridge.goal import GoalSpec
from nav_bridge.planner import XyYaw

MAX_BYTES = 64 * 1024
MAX_WORDS_LENGTH = 1000
"""A goal is a sentence. What is longer is not read: the work on a sentence grows faster than its length."""


@dataclass(slots=True)
class Request:
    """A query on its way through the loop. read: what its sentence says. answer or error is set before done."""

    name: str
    document: Mapping[str, Any]
    read: GoalSpec | None = None
    done: Event = field(default_factory=Event)
    answer: dict[str, Any] = field(default_factory=dict)
    error: str = ""


@dataclass(frozen=True, slots=True)
class Goto:
    """A goal as asked for. within_m: farthest distance to the target; start: where to plan from, None = where the robot is.

    priority: a goal preempts one of the same or lower priority, and is refused while one of higher priority is driven.
    """

    query: str
    within_m: float | None
    start: XyYaw | None
    priority: int = 0


def request_of(name: str, query: Query) -> Request:
    """The request in a query: a JSON object as payload, or parameters. DecodeError when it is neither."""
    if len(query.payload) > MAX_BYTES:
        raise DecodeError(f"nav/{name}: {len(query.payload)} bytes, at most {MAX_BYTES} are read")
    try:
        document = json.loads(query.payload) if query.payload else dict(query.parameters)
    except (ValueError, RecursionError) as error:
        raise DecodeError(f"nav/{name}: the payload is no JSON ({error})") from error
    if not isinstance(document, dict):
        raise DecodeError(f"nav/{name}: expected a JSON object")
    if len(str(document.get("query", ""))) > MAX_WORDS_LENGTH:
        raise DecodeError(f"nav/{name}: the query is longer than {MAX_WORDS_LENGTH} characters")
    return Request(name, document)


def checked_goto(document: Mapping[str, Any], name: str = "goto") -> Goto:
    """A goto or why request. DecodeError says what is wrong with it."""
    query, within, start = document.get("query"), document.get("within_m"), document.get("from")
    if not isinstance(query, str) or not query.strip():
        raise DecodeError(f"nav/{name}: query must be text")
    if within is not None and not (isinstance(within, (int, float)) and 0.05 <= within <= 10.0):
        raise DecodeError(f"nav/{name}: within_m = {within!r}: must be in 0.05 .. 10")
    priority = document.get("priority", 0)
    if not isinstance(priority, int) or not 0 <= priority <= 100:
        raise DecodeError(f"nav/{name}: priority = {priority!r}: must be a whole number in 0 .. 100")
    pose: XyYaw | None = None
    if start is not None:
        numbers = list(start) if isinstance(start, (list, tuple)) else []
        if len(numbers) not in (2, 3) or not all(isinstance(v, (int, float)) and math.isfinite(v) for v in numbers):
            raise DecodeError(f"nav/{name}: from = {start!r}: must be [x, y] or [x, y, yaw]")
        pose = (float(numbers[0]), float(numbers[1]), float(numbers[2]) if len(numbers) == 3 else 0.0)
    return Goto(query, None if within is None else float(within), pose, priority)
