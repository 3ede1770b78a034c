"""The only import of zenoh: sessions that find each other, and wrappers that keep clear of its traps.

The traps, measured with zenoh 1.10, and what is done about each:

* A handler that is not read (FIFO, the default) or a callback that is slow stops *every* key of the session. zenoh's threads
  only ever append to a ``Ring`` here; callbacks run on this session's own dispatcher thread, query handlers on its pool.
* A forked child that touches the session hangs. Every call checks the process id and raises; start children with *spawn*.
* Peers without a listener do not talk to each other through a router: every peer listens, at least on a free port.
* A client can't open before somebody listens; a peer can: peers retry in the background for as long as they live.
* Exceptions in callbacks vanish on stderr: ours are logged and counted (``callback_errors`` in
  ``counters``).
* A process whose main thread ends without closing the session hangs on zenoh's callback threads: an ``ExitGuard`` closes it.
* zenoh's enums have no ``name``: they are read with ``str``.

How processes find each other stands in ``io/endpoints.py``.
"""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Callable, Mapping
from typing import Any

import zenoh
import zenoh.ext as zenoh_ext

from irsd.core.errors import IrsdError, TransportError
from irsd.core.runtime import (
    Counters,
    Dispatcher,
    Event,
    ExitGuard,
    Guarded,
    Pool,
    Ring,
    monotonic_ns,
    monotonic_s,
    sleep_s,
)
from irsd.io.endpoints import DEFAULT_ENDPOINT, Role, ZenohSettings, opening_failed, session_config, with_environment
from irsd.io.handles import Handle, Publisher, Query
from irsd.io.messages import (
    BINARY,
    CDR,
    JSON,
    PNG,
    Priority,
    Reply,
    Sample,
    error_text,
)

__all__ = [
    "BINARY",
    "CDR",
    "DEFAULT_ENDPOINT",
    "JSON",
    "PNG",
    "Handle",
    "Priority",
    "Publisher",
    "Query",
    "Reply",
    "Role",
    "Sample",
    "Session",
    "Sink",
    "ZenohSettings",
    "matches",
    "open_session",
    "session_config",
    "with_environment",
]

_log = logging.getLogger(__name__)

_CALLBACK_BACKLOG = 256
_QUERY_WORKERS = 2
_QUERY_BACKLOG = 64


Sink = Ring[Sample] | Callable[[Sample], None]


def matches(expression: str, key: str) -> bool:
    """Whether two key expressions have a key in common."""
    return bool(zenoh.KeyExpr(expression).intersects(zenoh.KeyExpr(key)))


class Session:
    """An open zenoh session. All methods may be called from any thread; raises TransportError in a forked child."""

    def __init__(self, session: Any) -> None:
        self._session = session
        self._pid = os.getpid()
        self._counters = Counters()
        self._queries = Pool("zenoh-query", _QUERY_WORKERS, _QUERY_BACKLOG)
        self._closed = Event()
        self._callbacks: Dispatcher[Sample] = Dispatcher("zenoh-dispatch", _CALLBACK_BACKLOG)
        self._held: Guarded[dict[int, Handle]] = Guarded({})
        self.zid = str(session.zid())
        self._exit_guard = ExitGuard(self.close)

    # ------------------------------------------------------------------------------------------------- publishing
    def put(
        self,
        key: str,
        payload: bytes,
        *,
        encoding: str = JSON,
        attachment: bytes | None = None,
        priority: Priority = "data",
        express: bool = False,
        block: bool = True,
    ) -> None:
        """Sends one message. block: wait for room when a link is congested (else the message may be dropped there)."""
        self._do(
            lambda: self._session.put(
                key, payload, encoding=encoding, attachment=attachment, express=express, **_quality(priority, block)
            )
        )

    def delete(self, key: str) -> None:
        """Tells subscribers that the resource is gone."""
        self._do(lambda: self._session.delete(key, congestion_control=zenoh.CongestionControl.BLOCK))

    def publisher(
        self, key: str, *, encoding: str = JSON, priority: Priority = "data", express: bool = False, block: bool = True
    ) -> Publisher:
        """For a stream under one key. block=False for sensors: an old scan is worth nothing."""
        quality = _quality(priority, block)
        return Publisher(
            self._do(lambda: self._session.declare_publisher(key, encoding=encoding, express=express, **quality)),
            self._do,
        )

    def history_publisher(
        self, key: str, *, encoding: str = JSON, keep: int = 256, heartbeat_s: float = 0.5
    ) -> Publisher:
        """A publisher that keeps its last messages for late or interrupted ``subscribe_history`` subscribers."""
        return Publisher(
            self._do(
                lambda: zenoh_ext.declare_advanced_publisher(
                    self._session,
                    key,
                    encoding=encoding,
                    cache=zenoh_ext.CacheConfig(max_samples=keep),
                    sample_miss_detection=zenoh_ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=heartbeat_s),
                    publisher_detection=True,
                    **_quality("data", True),
                )
            ),
            self._do,
        )

    # ------------------------------------------------------------------------------------------------ subscribing
    def subscribe(self, key: str, sink: Sink) -> Handle:
        """Messages of a key expression into a ring, or to a callback on the dispatcher thread (bounded, drops counted)."""
        ring = self._ring_of(sink)
        subscriber = self._do(lambda: self._session.declare_subscriber(key, self._receiver(ring)))
        return self._hold(Handle(subscriber), ring)

    def subscribe_history(
        self, key: str, sink: Sink, *, keep: int = 256, on_miss: Callable[[int], None] | None = None
    ) -> Handle:
        """Like ``subscribe``, and the messages that ``history_publisher`` or a TRANSIENT_LOCAL ROS topic still holds.

        Plain publishers are heard as well. on_miss(n): called (on a zenoh thread: be quick) when n messages are lost for good.
        """
        ring = self._ring_of(sink)
        subscriber = self._do(
            lambda: zenoh_ext.declare_advanced_subscriber(
                self._session,
                key,
                self._receiver(ring),
                history=zenoh_ext.HistoryConfig(detect_late_publishers=True, max_samples=keep),
                recovery=zenoh_ext.RecoveryConfig(periodic_queries=None, heartbeat=True),
                subscriber_detection=True,
            )
        )
        misses = subscriber.sample_miss_listener(lambda miss: self._missed(key, int(miss.nb), on_miss))
        return self._hold(Handle(misses, subscriber), ring)

    # ---------------------------------------------------------------------------------------- questions and answers
    def queryable(self, key: str, handler: Callable[[Query], None], *, complete: bool = True) -> Handle:
        """Answers ``get`` on a key expression. The handler runs on the session's pool, so it may take its time.

        Its IrsdError becomes an error reply with the message; any other exception is logged and answered "internal error".
        """

        def receive(query: Any) -> None:
            if not self._queries.submit(lambda: self._answer(query, handler)):
                self._counters.add("queries_refused")
                with query:
                    Query(query).error("busy: too many questions are waiting")

        return self._hold(Handle(self._do(lambda: self._session.declare_queryable(key, receive, complete=complete))))

    def get(
        self, selector: str, *, timeout_s: float = 2.0, payload: bytes | None = None, attachment: bytes | None = None
    ) -> list[Reply]:
        """All answers to a question, in the order they came; an empty list when nobody answers to that key.

        selector: a key expression, with ``?name=value;...`` behind it if parameters are wanted.
        """
        return self._collect(
            lambda handler: self._session.get(
                selector,
                handler,
                target=zenoh.QueryTarget.ALL,
                timeout=timeout_s,
                payload=payload,
                attachment=attachment,
            ),
            timeout_s,
        )

    # --------------------------------------------------------------------------------------------------- liveliness
    def announce(self, key: str) -> Handle:
        """A token that exists for as long as this process is reachable."""
        return self._hold(Handle(self._do(lambda: self._session.liveliness().declare_token(key))))

    def watch_alive(self, key: str, sink: Sink) -> Handle:
        """Tokens that are there, come, and go (``deleted``): at once for a killed process, after about 10 s for a cut cable."""
        ring = self._ring_of(sink)
        receive = self._receiver(ring)
        watcher = self._do(lambda: self._session.liveliness().declare_subscriber(key, receive, history=True))
        return self._hold(Handle(watcher), ring)

    def find_alive(self, key: str, *, timeout_s: float = 1.0) -> list[str]:
        """The tokens there are now, sorted."""
        replies = self._collect(
            lambda handler: self._session.liveliness().get(key, handler, timeout=timeout_s), timeout_s
        )
        return sorted(reply.key for reply in replies if reply.ok)

    # -------------------------------------------------------------------------------------------------------- itself
    def neighbours(self) -> int:
        """How many other processes (peers, clients' hub, routers) this one is linked to now."""
        return sum(len(ids) for ids in self.neighbour_ids())

    def neighbour_ids(self) -> tuple[list[str], list[str]]:
        """The zenoh ids of the (peers, routers) that this process is linked to now."""
        info = self._session.info
        found = self._do(lambda: (info.peers_zid(), info.routers_zid()))
        return sorted(map(str, found[0])), sorted(map(str, found[1]))

    def counters(self) -> Mapping[str, int]:
        """callback_errors, callback_drops, query_errors, queries_refused, missed, unreadable: each only where it happened."""
        return {
            **self._counters.snapshot(),
            "callback_drops": self._callbacks.dropped,
            "callback_errors": self._callbacks.errors,
        }

    def close(self) -> None:
        """Ends the session and its threads; more than once is fine. In a forked child it does nothing."""
        if os.getpid() != self._pid or self._closed.is_set():
            return
        self._closed.set()
        with self._held.locked() as held:
            held.clear()
        self._exit_guard.cancel()
        self._session.close()
        self._callbacks.close()
        self._queries.close()

    def __enter__(self) -> Session:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _do(self, call: Callable[[], Any]) -> Any:
        """Runs a call into zenoh where that is possible, its errors (a bad key expression) as ours."""
        if os.getpid() != self._pid:
            raise TransportError(
                "this zenoh session was opened before the process forked and can't be used in the child: "
                "start child processes with the 'spawn' method, or open a session of their own in them"
            )
        if self._closed.is_set():
            raise TransportError("the zenoh session is closed")
        try:
            return call()
        except zenoh.ZError as error:
            raise TransportError(str(error).split(" at /")[0]) from error

    def _hold(self, handle: Handle, ring: Ring[Sample] | None = None) -> Handle:
        """Keeps what was declared: zenoh undeclares what Python forgets (tokens, but not subscribers)."""

        def forget() -> None:
            with self._held.locked() as held:
                held.pop(id(handle), None)
            if ring is not None:
                self._callbacks.forget(ring)

        handle.on_close(forget)
        with self._held.locked() as held:
            held[id(handle)] = handle
        return handle

    def _ring_of(self, sink: Sink) -> Ring[Sample]:
        return sink if isinstance(sink, Ring) else self._callbacks.ring(sink)

    def _receiver(self, ring: Ring[Sample]) -> Callable[[Any], None]:
        """What zenoh's thread runs: turn the sample into ours and append it, nothing else."""

        def receive(sample: Any) -> None:
            try:
                ring.put(_sample(sample))
            except Exception:  # the top of zenoh's thread, which would swallow it
                self._counters.add("unreadable")
                _log.exception("a sample could not be read")

        return receive

    def _answer(self, raw: Any, handler: Callable[[Query], None]) -> None:
        with raw:
            query = Query(raw)
            try:
                handler(query)
            except IrsdError as error:
                self._counters.add("query_errors")
                query.error(str(error))
            except Exception:  # the top of the pool's thread: the asker must get an answer
                self._counters.add("query_errors")
                _log.exception("query %s failed", query.key)
                query.error("internal error; see the log of the process that answers")

    def _missed(self, key: str, count: int, on_miss: Callable[[int], None] | None) -> None:
        self._counters.add("missed", count)
        _log.warning("%d messages of %s are lost", count, key)
        if on_miss is not None:
            on_miss(count)

    def _collect(self, ask: Callable[[Any], None], timeout_s: float) -> list[Reply]:
        """Replies by callback, never by zenoh's FIFO: a large answer must not hold up the session's other keys."""
        replies: list[Reply] = []
        done = Event()
        self._do(lambda: ask(zenoh.handlers.Callback(lambda reply: replies.append(_reply(reply)), done.set)))
        done.wait(timeout_s + 1.0)
        return list(replies)


def open_session(settings: ZenohSettings, role: Role = "peer") -> Session:
    """Opens a session, retrying for ``open_timeout_s``. Raises TransportError with what to do about it.

    hub: irsd, listens on the endpoint. peer: connects to it, now or whenever it appears. client: connects to the first of
    endpoint and ``connect`` that answers, at once or not at all (irsctl: opens in milliseconds, sees all the hub sees).
    """
    deadline = monotonic_s() + settings.open_timeout_s
    try:
        config = zenoh.Config.from_json5(json.dumps(session_config(settings, role)))
    except zenoh.ZError as error:
        raise TransportError(opening_failed(settings, role, str(error))) from error
    while True:
        try:
            return Session(zenoh.open(config))
        except zenoh.ZError as error:
            if monotonic_s() >= deadline:
                raise TransportError(opening_failed(settings, role, str(error))) from error
        sleep_s(0.2)


def _quality(priority: Priority, block: bool) -> dict[str, Any]:
    control = zenoh.CongestionControl
    return {
        "priority": getattr(zenoh.Priority, priority.upper()),
        "congestion_control": control.BLOCK if block else control.DROP,
    }


def _sample(sample: Any) -> Sample:
    return Sample(
        key=str(sample.key_expr),
        payload=sample.payload.to_bytes(),
        encoding=str(sample.encoding),
        attachment=sample.attachment.to_bytes() if sample.attachment is not None else None,
        deleted=str(sample.kind).upper().endswith("DELETE"),
        received_ns=monotonic_ns(),
    )


def _reply(reply: Any) -> Reply:
    if reply.ok is not None:
        sample = _sample(reply.ok)
        return Reply(sample.key, sample.payload, sample.encoding, sample.attachment, True, "")
    payload = reply.err.payload.to_bytes()
    return Reply("", payload, str(reply.err.encoding), None, False, error_text(payload))
