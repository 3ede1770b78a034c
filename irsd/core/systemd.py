"""Word to systemd: sd_notify(3) and its watchdog."""

from __future__ import annotations

import os
import socket

_PATIENCE_S = 0.2


def notify(state: str) -> bool:
    """A line of sd_notify(3), such as ``READY=1``; False when no one asked for it (no $NOTIFY_SOCKET) or takes it in."""
    address = os.environ.get("NOTIFY_SOCKET")
    if not address:
        return False
    if address.startswith("@"):  # an abstract socket
        address = "\0" + address[1:]
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as channel:
        channel.settimeout(_PATIENCE_S)  # who listens may be busy; a robot must not wait for it
        try:
            channel.sendto(state.encode(), address)
        except TimeoutError:
            return False
    return True


def watchdog_period_s() -> float | None:
    """How often systemd wants to hear ``WATCHDOG=1``: half of WatchdogSec, None when it does not watch this process."""
    microseconds = os.environ.get("WATCHDOG_USEC", "")
    watched = os.environ.get("WATCHDOG_PID", str(os.getpid()))
    if not microseconds.isdigit() or int(microseconds) == 0 or watched != str(os.getpid()):
        return None
    return int(microseconds) / 2e6


class Watchdog:
    """Tells systemd that the process lives, as often as it wants to hear it and no oftener. One thread feeds it."""

    def __init__(self) -> None:
        self.period_s = watchdog_period_s()
        self._due_s = 0.0

    def feed(self, now_s: float) -> None:
        """To be called only after everything that must move has moved."""
        if self.period_s is not None and now_s >= self._due_s:
            self._due_s = now_s + self.period_s
            notify("WATCHDOG=1")
