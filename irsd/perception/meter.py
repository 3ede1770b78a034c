"""What this process uses, from the operating system: CPU by process and by thread, memory and its peak. Linux."""

from __future__ import annotations

import ctypes
import os
import time
from collections.abc import Iterable
from pathlib import Path

import psutil

_CLEAR, _STATUS, _TASKS = Path("/proc/self/clear_refs"), Path("/proc/self/status"), Path("/proc/self/task")


def process_cpu_s() -> float:
    """CPU seconds of all threads since the start."""
    return time.process_time()


def thread_ids() -> frozenset[int]:
    """The kernel's numbers of this process's threads."""
    return frozenset(int(entry.name) for entry in _TASKS.iterdir())


def threads_cpu_s(threads: Iterable[int]) -> float:
    """CPU seconds of some threads of this process; those that have ended count for nothing."""
    total = 0.0
    for thread in threads:
        try:
            total += time.clock_gettime(
                (~thread << 3) | 6
            )  # the clock id of a thread: CPUCLOCK_PERTHREAD | CPUCLOCK_SCHED
        except OSError:
            continue
    return total


def own_thread_id() -> int:
    """The kernel's number of the calling thread."""
    return int(os.readlink("/proc/thread-self").rpartition("/")[2])


class MemoryMeter:
    """Resident memory in MB, and how high it rose during a run. One caller."""

    def __init__(self) -> None:
        self._process = psutil.Process(os.getpid())
        self._libc = ctypes.CDLL(None)

    def rss_mb(self) -> float:
        return float(self._process.memory_info().rss) / 1e6

    def mark(self) -> None:
        """The peak is counted from here."""
        try:
            _CLEAR.write_text("5")
        except OSError:  # not allowed here: the peak since the start is what is known then
            return

    def peak_mb(self) -> float:
        """Highest resident memory since ``mark``."""
        for line in _STATUS.read_text().splitlines():
            if line.startswith("VmHWM:"):
                return float(line.split()[1]) * 1024 / 1e6
        return self.rss_mb()

    def trim(self) -> None:
        """Give back to the system what the allocator holds and nobody uses."""
        if hasattr(self._libc, "malloc_trim"):
            self._libc.malloc_trim(0)
