"""What a session hands out: things declared on it, publishers, and questions to answer. Wraps zenoh's objects, imports none."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from irsd.io.messages import JSON, error_document, parameters

Do = Callable[[Callable[[], Any]], Any]
"""How a session runs a call into zenoh: checks that it may, and turns zenoh's errors into ours."""


class Query:
    """A request being answered; valid until its handler returns. parameters: those behind ``?`` in the selector."""

    def __init__(self, query: Any) -> None:
        self._query = query
        self.key = str(query.key_expr)
        self.parameters: Mapping[str, str] = parameters(str(query.parameters))
        self.payload: bytes = query.payload.to_bytes() if query.payload is not None else b""
        self.attachment: bytes | None = query.attachment.to_bytes() if query.attachment is not None else None

    def matches(self, key: str) -> bool:
        """Whether ``key`` is one that was asked for (the query's key may hold wildcards)."""
        return bool(self._query.key_expr.intersects(key))

    def reply(self, key: str, payload: bytes, *, encoding: str = JSON, attachment: bytes | None = None) -> None:
        """One answer; a query over wildcards takes several, each under its own key."""
        self._query.reply(key, payload, encoding=encoding, attachment=attachment)

    def error(self, message: str) -> None:
        """The answer ``{"error": message}``."""
        self._query.reply_err(error_document(message), encoding=JSON)


class Handle:
    """Something declared on a session; lasts until ``close`` or the session's end."""

    def __init__(self, *entities: Any) -> None:
        self._entities = entities
        self._on_close: Callable[[], None] | None = None

    def on_close(self, call: Callable[[], None]) -> None:
        """What to do once after the end."""
        self._on_close = call

    def close(self) -> None:
        """Undeclares it; more than once is fine."""
        entities, self._entities = self._entities, ()
        for entity in entities:
            entity.undeclare()
        if entities and self._on_close is not None:
            self._on_close()

    def __enter__(self) -> Handle:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class Publisher(Handle):
    """A stream under one key. ``put`` raises TransportError when the session is closed or the process was forked."""

    def __init__(self, entity: Any, do: Do) -> None:
        super().__init__(entity)
        self._entity = entity
        self._do = do

    def put(self, payload: bytes, *, attachment: bytes | None = None) -> None:
        self._do(lambda: self._entity.put(payload, attachment=attachment))
