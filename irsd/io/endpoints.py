"""Where the processes of irsd meet on zenoh: the settings, their environment variables and zenoh's configuration from them.

irsd is the *hub* and listens on the endpoint; all others connect to it, and learn from it of each other (gossip), so that they
keep talking when irsd is down. A router on 7447 (rmw_zenohd, zenoh-bridge-ros2dds) is joined when there is one.
``IRSD_ENDPOINT`` moves the meeting point; ``IRSD_CONNECT`` replaces the list of routers (comma between; empty: none).
``IRSD_TLS`` names a folder with ca.pem, cert.pem and key.pem: how irsctl shows who is asking.
"""

from __future__ import annotations

import dataclasses
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from irsd.core.settings import setting
from irsd.io.access import AccessSettings, TlsSettings, check_security, security_config

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7448"

Role = Literal["hub", "peer", "client"]


@dataclass(frozen=True)
class ZenohSettings:
    """Where irsd, nav_bridge, the world and irsctl meet, and which routers they join."""

    endpoint: str = setting(
        DEFAULT_ENDPOINT,
        "Meeting point: irsd listens here, the others connect here. tcp/0.0.0.0:7448 on irsd lets other computers in.",
    )
    listen: tuple[str, ...] = setting(
        ("tcp/127.0.0.1:0",), "Where every process listens besides, for direct links (port 0: any free one)."
    )
    connect: tuple[str, ...] = setting(
        ("tcp/127.0.0.1:7447",), "Routers to join when they are there: rmw_zenohd, zenoh-bridge-ros2dds, zenohd."
    )
    multicast: bool = setting(
        False, "Also look for others by UDP multicast; off, so that two robots on one network do not mix unasked."
    )
    router: bool = setting(
        False, "irsd relays for those who reach only its endpoint (a laptop) as a zenoh router would. Needs no zenohd."
    )
    shared_memory: bool = setting(
        False, "Pass large messages through /dev/shm between processes of one user; saves little at sensor rates."
    )
    tls: TlsSettings = field(default_factory=TlsSettings)
    access: AccessSettings = field(default_factory=AccessSettings)
    open_timeout_s: float = setting(5.0, "How long opening is retried before giving up.", lo=0.0, hi=600.0)


def with_environment(settings: ZenohSettings, endpoint: str | None = None) -> ZenohSettings:
    """The settings with the endpoint of the command line, else ``IRSD_ENDPOINT``, and with ``IRSD_CONNECT`` where set."""
    chosen = endpoint or os.environ.get("IRSD_ENDPOINT") or settings.endpoint
    connect = os.environ.get("IRSD_CONNECT")
    others = settings.connect if connect is None else tuple(part.strip() for part in connect.split(",") if part.strip())
    folder = os.environ.get("IRSD_TLS")
    if not folder:
        return dataclasses.replace(settings, endpoint=chosen, connect=others)
    ca, certificate, key = (str(Path(folder) / name) for name in ("ca.pem", "cert.pem", "key.pem"))
    tls = TlsSettings(ca, certificate, key)
    bare = settings.listen == ZenohSettings().listen
    listen = ("tls/127.0.0.1:0",) if bare else settings.listen
    others = () if connect is None and others == ZenohSettings().connect else others
    return dataclasses.replace(settings, endpoint=chosen, connect=others, listen=listen, tls=tls)


def session_config(settings: ZenohSettings, role: Role) -> dict[str, Any]:
    """zenoh's configuration as a plain mapping (see the texts of this module and of session for why it is so).

    Raises ConfigError for settings that leave a door open beside a locked one.
    """
    hub, client = role == "hub", role == "client"
    listen = [] if client else ([settings.endpoint] if hub else []) + list(settings.listen)
    connect = ([] if hub else [settings.endpoint]) + list(settings.connect)
    mode = "client" if client else "router" if hub and settings.router else "peer"
    check_security(settings.tls, settings.access, tuple(listen + connect))
    security = security_config(settings.tls, settings.access)
    retry = {"period_init_ms": 100, "period_max_ms": 400, "period_increase_factor": 2}
    return {
        "mode": mode,
        "listen": {"endpoints": listen},
        # -1: a peer never stops trying, so that processes may start and restart in any order
        "connect": {
            "endpoints": connect,
            "exit_on_failure": client,
            "timeout_ms": int(min(settings.open_timeout_s, 1.0) * 1000) if client else -1,
            "retry": retry,
        },
        "scouting": {"multicast": {"enabled": settings.multicast}, "gossip": {"enabled": True}},
        "timestamping": {"enabled": {"router": True, "peer": True, "client": True}},  # history_publisher needs it
        "transport": {
            "shared_memory": {"enabled": settings.shared_memory},
            "link": {"tls": security["tls"]} if "tls" in security else {},
        },
        **({"access_control": security["access_control"]} if "access_control" in security else {}),
    }


def opening_failed(settings: ZenohSettings, role: Role, reason: str) -> str:
    """What the operator should read when zenoh could not be opened for ``reason``."""
    text = reason.split(" at /", maxsplit=1)[0]
    if "already in use" in text:
        return (
            f"can't listen on {settings.endpoint}: another irsd has it; stop it, or choose one with --endpoint: {text}"
        )
    if "Endpoints must be" in text or "nable to parse" in text:
        return f"{text}; such as tcp/127.0.0.1:7448"
    if role == "client":
        return f"nobody answers at {', '.join((settings.endpoint, *settings.connect))}: is irsd running? ({text})"
    return f"can't open zenoh with endpoint {settings.endpoint}: {text}"
