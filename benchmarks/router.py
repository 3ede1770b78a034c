"""A zenoh router killed and started again, over and over: is a delta lost, and how long until all are there again?

    python benchmarks/router.py [--times 20]

irsd's session publishes deltas with history, twenty a second; a client that knows only the router follows them. Prints per death the
seconds from the router's return until the client has everything up to then. Exit code 1 when a delta is lost, doubled or out of order.
"""

from __future__ import annotations

import argparse
import socket
import subprocess
import sys

from irsd.core.runtime import Event, Ring, Worker, monotonic_s, sleep_s
from irsd.io.session import Sample, ZenohSettings, open_session

KEY = "irs/r/graph/delta"
PATIENCE_S = 60.0
ROUTER = """
from irsd.core.runtime import sleep_s
from irsd.io.session import ZenohSettings, open_session
with open_session(ZenohSettings(endpoint={endpoint!r}, listen=(), connect=(), router=True, open_timeout_s=30.0), "hub"):
    print("up", flush=True)
    sleep_s(1e6)
"""


def free_endpoint() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


class Router:
    """A zenoh router as a process."""

    def __init__(self, endpoint: str) -> None:
        self._endpoint = endpoint
        self.start()

    def start(self) -> None:
        command = [sys.executable, "-c", ROUTER.format(endpoint=self._endpoint)]
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert self._process.stdout is not None
        if self._process.stdout.readline().strip() != "up":
            raise RuntimeError("the router did not start")

    def kill(self) -> None:
        self._process.kill()
        self._process.communicate()


def outlived(times: int) -> tuple[list[float], list[int], int]:
    """(seconds until all deltas are there, by death; numbers that arrived, in order; how many were sent)."""
    endpoint, received, sent, done = free_endpoint(), list[int](), [0], Event()
    router = Router(endpoint)
    behind_s = []
    ring: Ring[Sample] = Ring(100_000)
    hub_settings = ZenohSettings(endpoint=free_endpoint(), connect=(endpoint,))
    client_settings = ZenohSettings(endpoint=endpoint, connect=(), open_timeout_s=PATIENCE_S)
    try:
        with open_session(hub_settings, "hub") as hub, open_session(client_settings, "client") as client:
            publisher = hub.history_publisher(KEY, keep=1024)
            client.subscribe_history(KEY, ring, keep=1024)

            def publish() -> None:
                while not done.wait(0.05):
                    sent[0] += 1
                    publisher.put(str(sent[0]).encode())

            def caught_up(number: int) -> bool:
                received.extend(int(sample.payload) for sample in ring.drain())
                return bool(received) and received[-1] >= number

            worker = Worker("deltas", publish).start()
            wait_for(lambda: caught_up(5))
            for _ in range(times):
                router.kill()
                sleep_s(1.0)
                router.start()
                back_s, newest = monotonic_s(), sent[0]
                wait_for(lambda newest=newest: caught_up(newest))
                behind_s.append(monotonic_s() - back_s)
            done.set()
            worker.join(5.0)
            wait_for(lambda: caught_up(sent[0]))
    finally:
        router.kill()
    return behind_s, received, sent[0]


def wait_for(condition: object) -> None:
    end_s = monotonic_s() + PATIENCE_S
    while not condition():  # type: ignore[operator]
        if monotonic_s() > end_s:
            raise RuntimeError(f"not caught up within {PATIENCE_S:g} s")
        sleep_s(0.01)


def main() -> int:
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--times", type=int, default=20)
    behind_s, received, sent = outlived(parser.parse_args().times)
    lost = sent - len(set(received))
    print(
        f"{len(behind_s)} deaths of the router: {sent} deltas sent, {lost} lost, in order {received == sorted(set(received))}"
    )
    print(f"all there again after at most {max(behind_s):.2f} s, mean {sum(behind_s) / len(behind_s):.2f} s (bar 2 s)")
    return int(received != list(range(received[0], sent + 1)))


if __name__ == "__main__":
    sys.exit(main())
