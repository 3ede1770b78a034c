"""What goes over zenoh, as plain values: samples, replies, encodings and error documents."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Literal

JSON = "application/json"
CDR = "application/cdr"
BINARY = "application/octet-stream"
PNG = "image/png"

Priority = Literal["real_time", "interactive_high", "interactive_low", "data_high", "data", "data_low", "background"]


@dataclass(frozen=True, slots=True)
class Sample:
    """One message. deleted: the key was removed, payload is empty. received_ns: monotonic clock of this process."""

    key: str
    payload: bytes
    encoding: str
    attachment: bytes | None
    deleted: bool
    received_ns: int


@dataclass(frozen=True, slots=True)
class Reply:
    """One answer to a ``get``. ok: False when the other side answered with an error, whose text is then in ``error``."""

    key: str
    payload: bytes
    encoding: str
    attachment: bytes | None
    ok: bool
    error: str


def error_text(payload: bytes) -> str:
    """What an error reply says: ours are ``{"error": text}``, zenoh's own are plain text."""
    try:
        document = json.loads(payload)
    except ValueError:
        return payload.decode(errors="replace")
    return str(document.get("error", document)) if isinstance(document, dict) else str(document)


def parameters(text: str) -> dict[str, str]:
    """``a=1;b=2``, the part of a selector behind ``?``, as a mapping."""
    pairs = (part.partition("=") for part in text.split(";") if part)
    return {name: value for name, _, value in pairs}


def error_document(message: str) -> bytes:
    """The payload of an error reply."""
    return json.dumps({"error": message}).encode()
