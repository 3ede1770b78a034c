"""The only threads, queues and locks of irsd: bounded rings, a mailbox, workers, a pool, counters and clocks.

Everything here is bounded, every item that is thrown away is counted, and nobody else may import ``threading``, ``queue`` or
``concurrent.futures``. Lock order: none; what is called under a ring's lock (``drop_while``) only looks at an item.
"""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Generic, TypeVar

T = TypeVar("T")

Event = threading.Event

_log = logging.getLogger(__name__)

_EXIT_POLL_S = 0.5


# ------------------------------------------------------------------------------------------------------------- clocks
_clock: Callable[[], int] = time.monotonic_ns


def use_clock(now_ns: Callable[[], int] | None) -> None:
    """Simulated time: what ``monotonic_ns`` and ``monotonic_s`` say from now on in this process; None: real time again.

    Whoever waits for another thread or process still waits in real time.
    """
    global _clock  # noqa: PLW0603  a process has one time
    _clock = now_ns or time.monotonic_ns


def monotonic_ns() -> int:
    """For durations and deadlines; has no meaning outside this process."""
    return _clock()


def monotonic_s() -> float:
    """For durations and deadlines, in seconds."""
    return _clock() * 1e-9


def wall_clock_ns() -> int:
    """Nanoseconds since 1970, for stamps that other computers read; it may jump, so never for a duration."""
    return time.time_ns()


def thread_cpu_s() -> float:
    """CPU seconds the calling thread has used."""
    return time.thread_time()


def sleep_s(seconds: float) -> None:
    """Pause of the calling thread; a thread that must stop promptly waits on its ``Stopper`` instead."""
    time.sleep(seconds)


# ------------------------------------------------------------------------------------------------------------- queues
class Ring(Generic[T]):
    """A bounded queue that drops its oldest item when full and counts it. One or many writers, one or many readers.

    wake: an event that several rings may share, so that one thread can sleep on all of them; set at every ``put``.
    """

    def __init__(self, capacity: int, wake: Event | None = None) -> None:
        if capacity < 1:
            raise ValueError(f"a ring of {capacity} items can't hold anything")
        self._items: deque[T] = deque()
        self._capacity = capacity
        self._condition = threading.Condition()
        self._wake = wake
        self._received = 0
        self._dropped = 0

    def put(self, item: T) -> None:
        """Appends; never blocks. Drops the oldest item when full."""
        with self._condition:
            self._received += 1
            if len(self._items) == self._capacity:
                self._items.popleft()
                self._dropped += 1
            self._items.append(item)
            self._condition.notify()
        if self._wake is not None:
            self._wake.set()

    def get(self, timeout_s: float | None = None) -> T | None:
        """The oldest item, or None when none came in time. timeout_s: None waits for ever, 0 does not wait."""
        with self._condition:
            return self._items.popleft() if self._condition.wait_for(lambda: bool(self._items), timeout_s) else None

    def drain(self, most: int | None = None) -> list[T]:
        """All items, or the oldest ``most`` of them, oldest first, at once."""
        with self._condition:
            return [self._items.popleft() for _ in range(min(len(self._items), most or len(self._items)))]

    def drop_while(self, condition: Callable[[T], bool]) -> int:
        """Takes the oldest items away for as long as they fulfil a condition, but never the newest; how many."""
        dropped = 0
        with self._condition:
            while len(self._items) > 1 and condition(self._items[0]):
                self._items.popleft()
                dropped += 1
        return dropped

    def __len__(self) -> int:
        return len(self._items)

    @property
    def received(self) -> int:
        """How many items were ever put."""
        return self._received

    @property
    def dropped(self) -> int:
        """How many items were overwritten before anyone took them."""
        return self._dropped


class Mailbox(Ring[T]):
    """A place for one item: the latest wins, whoever it replaced is counted as dropped."""

    def __init__(self, wake: Event | None = None) -> None:
        super().__init__(1, wake)


# ------------------------------------------------------------------------------------------------------------ threads
class Stopper:
    """The wish to stop, shared by all threads of a process. The first reason given is kept."""

    def __init__(self) -> None:
        self._event = threading.Event()
        self._reason = ""

    def request(self, reason: str) -> None:
        """Asks all to stop. Safe from a signal handler."""
        if not self._event.is_set():
            self._reason = reason
            self._event.set()

    @property
    def requested(self) -> bool:
        return self._event.is_set()

    @property
    def reason(self) -> str:
        return self._reason

    def wait(self, timeout_s: float) -> bool:
        """Sleeps until the stop is requested (True) or the time is up (False)."""
        return self._event.wait(timeout_s)


class Worker:
    """A named thread that reports what killed it instead of dying in silence.

    loop: runs until it returns. on_failure: called on that thread with the exception that ended it, after it was logged.
    """

    def __init__(
        self, name: str, loop: Callable[[], None], on_failure: Callable[[BaseException], None] | None = None
    ) -> None:
        self.name = name
        self._loop = loop
        self._on_failure = on_failure
        self._failure: BaseException | None = None
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def start(self) -> Worker:
        self._thread.start()
        return self

    def join(self, timeout_s: float) -> bool:
        """True when the thread has ended within the time (or was never started)."""
        if self._thread.ident is None:
            return True
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    @property
    def alive(self) -> bool:
        return self._thread.is_alive()

    @property
    def failure(self) -> BaseException | None:
        """What ended the thread, when it did not end by itself."""
        return self._failure

    def _run(self) -> None:
        try:
            self._loop()
        except BaseException as error:  # the top of a thread: nobody above could report it
            self._failure = error
            _log.critical("thread %s died: %s", self.name, error, exc_info=True)
            if self._on_failure is not None:
                self._on_failure(error)


class ExitGuard:
    """Runs ``close`` when the main thread ends without anyone having cancelled the guard.

    For libraries whose own non-daemon threads would keep such a process alive for ever; ``atexit`` runs too late for them.
    """

    def __init__(self, close: Callable[[], None]) -> None:
        self._close = close
        self._cancelled = Event()
        # not a daemon thread: the interpreter waits for it, so that it is not torn down in the middle of ``close``
        threading.Thread(target=self._watch, name="exit-guard").start()

    def cancel(self) -> None:
        """All is closed in good order."""
        self._cancelled.set()

    def _watch(self) -> None:
        while not self._cancelled.wait(_EXIT_POLL_S):
            if not threading.main_thread().is_alive():
                self._close()
                return


class Pool:
    """A few threads for independent pieces of work, such as answers to queries.

    backlog: how many submitted pieces may wait before more are refused.
    """

    def __init__(self, name: str, workers: int, backlog: int = 64) -> None:
        self._executor = ThreadPoolExecutor(max(workers, 1), thread_name_prefix=name)
        self._room = threading.BoundedSemaphore(max(workers, 1) + backlog)

    def submit(self, work: Callable[[], None]) -> bool:
        """Hands work over; False when too much of it is waiting already. The work reports its own errors."""
        if not self._room.acquire(blocking=False):
            return False
        try:
            future = self._executor.submit(work)
        except RuntimeError:  # the pool is closed
            self._room.release()
            return False
        future.add_done_callback(self._finished)
        return True

    def close(self) -> None:
        """Forgets what waits and returns when what runs has ended."""
        self._executor.shutdown(wait=True, cancel_futures=True)

    def __enter__(self) -> Pool:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _finished(self, future: Any) -> None:
        self._room.release()
        error = None if future.cancelled() else future.exception()
        if error is not None:
            _log.error("work on a pool failed: %s", error, exc_info=error)


class Dispatcher(Generic[T]):
    """Callbacks of many sources on one thread of ours, each source behind its own bounded ring.

    So that a slow or failing callback costs its own messages (dropped oldest, counted), never the source's thread.
    The thread starts with the first callback.
    """

    def __init__(self, name: str, backlog: int) -> None:
        self._backlog = backlog
        self._wake = Event()
        self._stopper = Stopper()
        self._calls: Guarded[dict[int, tuple[Ring[T], Callable[[T], None]]]] = Guarded({})
        self._worker = Worker(name, self._run)
        self._started = False
        self._dropped = 0
        self.errors = 0

    def ring(self, callback: Callable[[T], None]) -> Ring[T]:
        """A new ring whose items are given to ``callback``, in order, on the dispatcher's thread."""
        ring: Ring[T] = Ring(self._backlog, self._wake)
        with self._calls.locked() as calls:
            calls[id(ring)] = (ring, callback)
            first, self._started = not self._started, True
        if first:
            self._worker.start()
        return ring

    def forget(self, ring: Ring[T]) -> None:
        """No more calls for this ring; rings of others are ignored."""
        with self._calls.locked() as calls:
            if calls.pop(id(ring), None) is not None:
                self._dropped += ring.dropped

    @property
    def dropped(self) -> int:
        """Items that were overwritten before their callback could run."""
        with self._calls.locked() as calls:
            return self._dropped + sum(ring.dropped for ring, _ in calls.values())

    def close(self) -> None:
        """Ends the thread after the callback that runs now."""
        self._stopper.request("closed")
        self._wake.set()
        self._worker.join(2.0)

    def _run(self) -> None:
        while not self._stopper.requested:
            self._wake.wait()
            self._wake.clear()
            with self._calls.locked() as calls:
                todo = list(calls.values())
            for ring, callback in todo:
                while (item := ring.get(0)) is not None and not self._stopper.requested:
                    self._call(callback, item)

    def _call(self, callback: Callable[[T], None], item: T) -> None:
        try:
            callback(item)
        except Exception:  # the top of this thread: one bad callback must not silence the others
            self.errors += 1
            _log.exception("a callback failed")


# ------------------------------------------------------------------------------------------------------- shared state
class Counters:
    """Named whole numbers that only grow; any thread may add."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._counts: dict[str, int] = {}

    def add(self, name: str, amount: int = 1) -> None:
        with self._lock:
            self._counts[name] = self._counts.get(name, 0) + amount

    def snapshot(self) -> Mapping[str, int]:
        """A copy, sorted by name."""
        with self._lock:
            return dict(sorted(self._counts.items()))


class Guarded(Generic[T]):
    """A value that is touched only inside ``with guarded.locked() as value``; keep that block short and free of foreign calls."""

    def __init__(self, value: T) -> None:
        self._lock = threading.Lock()
        self._value = value

    @contextlib.contextmanager
    def locked(self) -> Iterator[T]:
        with self._lock:
            yield self._value


class Cell(Generic[T]):
    """One frozen value that one thread replaces and others read: a reference swap, atomic without a lock."""

    def __init__(self, value: T) -> None:
        self._value = value

    def get(self) -> T:
        return self._value

    def set(self, value: T) -> None:
        self._value = value


class Rate:
    """How often something happened lately: the mean frequency over the last ``window`` events. One writer, any readers."""

    def __init__(self, window: int = 50) -> None:
        self._stamps_s: deque[float] = deque(maxlen=max(window, 2))

    def tick(self, now_s: float) -> None:
        self._stamps_s.append(now_s)

    def hz(self, now_s: float) -> float:
        """0 before the second event; falls towards 0 when the events stop."""
        if len(self._stamps_s) < 2:
            return 0.0
        return 1.0 / max(self.period_s, (self.age_s(now_s) or 0.0) / 2.0, 1e-6)

    @property
    def period_s(self) -> float:
        """Mean time between the last events; 0 before the second."""
        stamps = tuple(self._stamps_s)
        return (stamps[-1] - stamps[0]) / (len(stamps) - 1) if len(stamps) > 1 else 0.0

    def age_s(self, now_s: float) -> float | None:
        """Seconds since the last event, None when there was none."""
        stamps = tuple(self._stamps_s)
        return now_s - stamps[-1] if stamps else None
