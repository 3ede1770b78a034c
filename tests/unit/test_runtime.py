"""Bounded queues that count what they lose, threads that report what killed them."""

from __future__ import annotations

import subprocess
import sys

import pytest

from irsd.core.runtime import (
    Counters,
    Dispatcher,
    Event,
    Guarded,
    Mailbox,
    Pool,
    Rate,
    Ring,
    Stopper,
    Worker,
    monotonic_ns,
    monotonic_s,
    use_clock,
)

WAIT_S = 20.0


def test_empty_ring_gives_nothing() -> None:
    ring: Ring[int] = Ring(3)
    assert ring.get(0) is None
    assert ring.drain() == []
    assert (len(ring), ring.received, ring.dropped) == (0, 0, 0)


def test_ring_drops_the_oldest_and_counts() -> None:
    ring: Ring[int] = Ring(3)
    for number in range(10):
        ring.put(number)
    assert (ring.received, ring.dropped, len(ring)) == (10, 7, 3)
    assert ring.get() == 7
    assert ring.drain() == [8, 9]
    for item in (1, 2, 3):
        ring.put(item)
    assert ring.drain(2) == [1, 2]
    assert ring.drain(2) == [3]
    for item in (1, 2, 3):
        ring.put(item)
    assert ring.drop_while(lambda item: item < 3) == 2
    assert ring.drop_while(lambda item: item < 9) == 0  # the newest stays
    assert ring.drain() == [3]


def test_ring_needs_room() -> None:
    with pytest.raises(ValueError, match="0 items"):
        Ring(0)


def test_rings_share_a_wake_event() -> None:
    wake = Event()
    a: Ring[int] = Ring(1, wake)
    b: Ring[int] = Ring(1, wake)
    assert not wake.is_set()
    b.put(1)
    assert wake.wait(WAIT_S)
    assert a.get(0) is None
    assert b.get(0) == 1


def test_mailbox_keeps_the_latest() -> None:
    box: Mailbox[str] = Mailbox()
    box.put("old")
    box.put("new")
    assert box.get(0) == "new"
    assert box.dropped == 1


@pytest.mark.parametrize("writers", [1, 4])
def test_ring_loses_nothing_uncounted_between_threads(writers: int) -> None:
    ring: Ring[tuple[int, int]] = Ring(64)
    each = 2000

    def write(writer: int) -> None:
        for number in range(each):
            ring.put((writer, number))

    workers = [Worker(f"w{w}", lambda w=w: write(w)).start() for w in range(writers)]  # type: ignore[misc]
    taken: list[tuple[int, int]] = []
    while any(worker.alive for worker in workers):
        taken += ring.drain()
    taken += ring.drain()
    assert len(taken) + ring.dropped == writers * each == ring.received
    for writer in range(writers):
        numbers = [number for who, number in taken if who == writer]
        assert numbers == sorted(numbers)


def test_reader_is_woken_by_a_writer() -> None:
    ring: Ring[int] = Ring(1)
    got: Ring[int | None] = Ring(1)
    worker = Worker("reader", lambda: got.put(ring.get(WAIT_S))).start()
    ring.put(5)
    assert worker.join(WAIT_S)
    assert got.get(0) == 5


def test_stopper_keeps_the_first_reason() -> None:
    stopper = Stopper()
    assert not stopper.wait(0)
    stopper.request("SIGTERM")
    stopper.request("later")
    assert stopper.requested
    assert stopper.wait(0)
    assert stopper.reason == "SIGTERM"


def test_worker_reports_what_killed_it(caplog: pytest.LogCaptureFixture) -> None:
    seen: Ring[BaseException] = Ring(1)

    def fail() -> None:
        raise RuntimeError("broken stage")

    worker = Worker("map", fail, seen.put).start()
    assert worker.join(WAIT_S)
    assert str(worker.failure) == "broken stage"
    assert seen.get(WAIT_S) is worker.failure
    assert "thread map died" in caplog.text


def test_worker_that_was_never_started_has_ended() -> None:
    assert Worker("idle", lambda: None).join(0)


def test_pool_refuses_work_beyond_its_backlog() -> None:
    gate: Event = Event()
    ran: Ring[bool] = Ring(4)
    pool = Pool("answers", 1, backlog=1)

    def work() -> None:
        ran.put(gate.wait(WAIT_S))

    assert [pool.submit(work) for _ in range(3)] == [True, True, False]
    gate.set()
    assert [ran.get(WAIT_S), ran.get(WAIT_S)] == [True, True]
    pool.close()
    assert not pool.submit(work)


def test_pool_reports_work_that_fails(caplog: pytest.LogCaptureFixture) -> None:
    started = Event()

    def fail() -> None:
        started.set()
        raise RuntimeError("no answer")

    pool = Pool("answers", 1)
    assert pool.submit(fail)
    assert started.wait(WAIT_S)
    pool.close()
    assert "work on a pool failed: no answer" in caplog.text


def test_dispatcher_isolates_a_failing_callback(caplog: pytest.LogCaptureFixture) -> None:
    dispatcher: Dispatcher[int] = Dispatcher("calls", 8)
    got: Ring[int] = Ring(8)

    def fail(_: int) -> None:
        raise ValueError("bad callback")

    bad, good = dispatcher.ring(fail), dispatcher.ring(got.put)
    bad.put(1)
    good.put(2)
    assert got.get(WAIT_S) == 2
    dispatcher.forget(good)
    good.put(3)
    bad.put(4)
    dispatcher.close()
    assert got.get(0) is None
    assert dispatcher.errors >= 1
    assert "a callback failed" in caplog.text


def test_dispatcher_counts_what_a_slow_callback_loses() -> None:
    gate, entered = Event(), Event()
    dispatcher: Dispatcher[int] = Dispatcher("calls", 2)

    def slow(_: int) -> None:
        entered.set()
        gate.wait(WAIT_S)

    ring = dispatcher.ring(slow)
    ring.put(0)
    assert entered.wait(WAIT_S)
    for number in range(5):
        ring.put(number)
    assert dispatcher.dropped == 3
    gate.set()
    dispatcher.close()


def test_guarded_and_counters_lose_no_update() -> None:
    counters, total = Counters(), Guarded({"n": 0})

    def work() -> None:
        for _ in range(1000):
            counters.add("n")
            with total.locked() as value:
                value["n"] += 1

    workers = [Worker(f"w{i}", work).start() for i in range(4)]
    assert all(worker.join(WAIT_S) for worker in workers)
    with total.locked() as value:
        assert counters.snapshot()["n"] == value["n"] == 4000


def test_rate_is_zero_until_it_is_known_and_falls_in_silence() -> None:
    rate = Rate()
    assert rate.hz(0.0) == 0.0
    assert rate.age_s(0.0) is None
    for n in range(11):
        rate.tick(n * 0.1)
    assert rate.hz(1.0) == pytest.approx(10.0)
    assert rate.hz(11.0) == pytest.approx(0.2)
    assert rate.age_s(11.0) == pytest.approx(10.0)


def test_exit_guard_closes_what_would_hold_the_process() -> None:
    """A library's thread that is not a daemon keeps a process alive after main; the guard ends it."""
    program = """
import threading
from irsd.core.runtime import Event, ExitGuard
gate = Event()
threading.Thread(target=gate.wait).start()
ExitGuard(gate.set)
raise SystemExit(3)
"""
    assert subprocess.run([sys.executable, "-c", program], timeout=60, check=False).returncode == 3


def test_time_can_be_simulated() -> None:
    use_clock(lambda: 2_500_000_000)
    try:
        assert (monotonic_ns(), monotonic_s()) == (2_500_000_000, 2.5)
    finally:
        use_clock(None)
    assert abs(monotonic_s() - monotonic_ns() * 1e-9) < 5.0
