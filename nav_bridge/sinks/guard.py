"""A process of its own that outlives nav_bridge for one act: Nav2 knows no heartbeat, so a goal of a killed bridge must be cancelled.

It reads one line per goal on its standard input: the goal's id in hex, or an empty line when none is under way. At the end of the
input (the bridge has ended, however) it cancels the goal it read last, and ends.
"""

from __future__ import annotations

import json
import logging
import signal
import subprocess
import sys
from dataclasses import asdict

from irsd.core.errors import IrsdError
from irsd.core.settings import build
from irsd.io.endpoints import ZenohSettings
from irsd.io.session import open_session
from nav_bridge.config import SinkSettings
from nav_bridge.sinks.action import ActionClient

_log = logging.getLogger(__name__)

_ASK_S = 5.0


class Guard:
    """The bridge's side: starts the process and tells it which goal is under way. One thread."""

    def __init__(self, settings: SinkSettings, zenoh: ZenohSettings) -> None:
        self._task = json.dumps({"sinks": asdict(settings), "zenoh": asdict(zenoh)})
        self._process: subprocess.Popen[str] | None = None
        self._line = ""
        self.watch(None)

    def watch(self, goal_id: bytes | None) -> None:
        """The goal under way from now on; None: none is. A guard that has died is replaced."""
        self._line = "" if goal_id is None else goal_id.hex()
        if self._process is None or self._process.poll() is not None:
            if self._process is not None:
                _log.warning(
                    "the guard of Nav2's goals had ended (%s); another one stands in", self._process.returncode
                )
            command = [sys.executable, "-m", "nav_bridge.sinks.guard", self._task]
            self._process = subprocess.Popen(command, stdin=subprocess.PIPE, text=True)
        try:
            if self._process.stdin is not None:
                self._process.stdin.write(f"{self._line}\n")
                self._process.stdin.flush()
        except OSError as error:
            _log.warning("the guard of Nav2's goals does not listen: %s", error)

    def check(self) -> None:
        """Call now and then: a dead guard is noticed, and replaced."""
        if self._process is not None and self._process.poll() is not None:
            self.watch(bytes.fromhex(self._line) or None)

    def close(self) -> None:
        """No goal is under way; the process ends."""
        if self._process is None or self._process.stdin is None:
            return
        self.watch(None)
        self._process.stdin.close()
        self._process.wait(2 * _ASK_S)


def _settings(task: str) -> tuple[SinkSettings, ZenohSettings]:
    document = json.loads(task)
    sinks, problems = build(SinkSettings, document["sinks"])
    zenoh, more = build(ZenohSettings, document["zenoh"])
    if sinks is None or zenoh is None:
        raise ValueError("; ".join([*problems, *more]))
    return sinks, zenoh


def main() -> int:
    """Until the input ends."""
    for number in (signal.SIGINT, signal.SIGTERM):  # a service that is stopped gets it too, and must still cancel
        signal.signal(number, signal.SIG_IGN)
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(levelname)s %(name)s: %(message)s")
    sinks, zenoh = _settings(sys.argv[1])
    goal = ""
    try:
        with open_session(zenoh, "peer") as session:
            client = ActionClient(session, sinks)
            for line in sys.stdin:
                goal = line.strip()
            if goal:
                code = client.cancel(bytes.fromhex(goal), _ASK_S)
                _log.warning("nav_bridge has died: its goal is cancelled, return code %d", code)
    except IrsdError as error:
        _log.error("the goal of a dead nav_bridge could not be cancelled: %s", error)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
