"""Word to systemd: sd_notify(3) and its watchdog."""

from __future__ import annotations

import os
import socket


def notify(state: str) -> bool:
    """A line of sd_notify(3), such as ``READY=1``; False when no one asked for it ($NOTIFY_SOCKET is not set)."""
    address = os.environ.get("NOTIFY_SOCKET")
    if not address:
        return False
    if address.startswith("@"):  # an abstract socket
        address = "\0" + address[1:]
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as channel:
        channel.sendto(state.encode(), address)
    return True


def watchdog_period_s() -> float | None:
    """How often systemd wants to hear ``WATCHDOG=1``: half of WatchdogSec, None when it does not watch this process."""
    microseconds = os.environ.get("WATCHDOG_USEC", "")
    watched = os.environ.get("WATCHDOG_PID", str(os.getpid()))
    if not microseconds.isdigit() or int(microseconds) == 0 or watched != str(os.getpid()):
        return None
    return int(microseconds) / 2e6
