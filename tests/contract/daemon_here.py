"""The whole daemon inside the test process: real session, store, threads and commands, without the seconds of a start of Python."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import contextmanager

from irsd.config import IrsdConfig
from irsd.core.runtime import Worker
from irsd.daemon import Daemon, prepared
from irsd.io.session import Session, ZenohSettings, open_session
from irsd.perception.encoder import LabelEncoder
from irsd.stored import open_store


def free_endpoint() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


@contextmanager
def running(config: IrsdConfig, labels: LabelEncoder, endpoint: str | None = None) -> Iterator[tuple[Daemon, Session]]:
    """A daemon between start and a clean stop, and a session of another process's kind."""
    settings = ZenohSettings(endpoint=endpoint or free_endpoint(), connect=())
    store = open_store(config)
    try:
        begin = prepared(config, store, labels)
        with open_session(settings, "hub") as hub, open_session(settings, "peer") as other:
            daemon = begin(hub)
            daemon.start()
            main = Worker("test-main", daemon.main_loop).start()
            try:
                yield daemon, other
            finally:
                assert daemon.stop()
                assert main.join(20.0)
    finally:
        if store is not None:
            store.close()
