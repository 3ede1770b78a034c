"""make fuzz: every target for SECONDS each (default 600), one after the other: ``run.py [SECONDS] [NAME-PART]``.

A finding is any error that is not a refusal, over 100 ms of CPU for one input, or ``MEMORY_MB`` more memory.
Findings are printed with the number that makes the input again, and the exit code is 1.
"""

from __future__ import annotations

import logging
import resource
import sys
import time
import traceback
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[1])]

from fuzz_targets import Target, one_input, refused, targets  # noqa: E402

LIMIT_S = 0.1
MEMORY_MB = 400.0


def peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def tried(target: Target, number: int) -> tuple[float, str]:
    """CPU seconds of one input, and what is wrong with it."""
    data = one_input(target, number)
    began_s = time.thread_time()
    wrong = ""
    try:
        target.run(data)
    except Exception as error:
        if not refused(error):
            wrong = "".join(traceback.format_exception(error, limit=-3))
    return time.thread_time() - began_s, wrong


def run(target: Target, seconds: float) -> list[str]:
    """The findings, each once by its last line."""
    found: dict[str, str] = {}
    slowest_s, number, end_s = 0.0, 0, time.monotonic() + seconds
    tried(target, 0)  # what loads at the first use is not the input's doing
    base_mb = peak_mb()
    while time.monotonic() < end_s and len(found) < 10:
        passed_s, wrong = tried(target, number)
        if passed_s > LIMIT_S and not wrong:
            passed_s = min(passed_s, tried(target, number)[0])  # a page fault or a collection is not the input's doing
            wrong = f"{passed_s * 1e3:.0f} ms of CPU" if passed_s > LIMIT_S else ""
        slowest_s = max(slowest_s, passed_s)
        if peak_mb() - base_mb > MEMORY_MB:
            wrong, base_mb = f"{peak_mb() - base_mb:.0f} MB more memory", peak_mb()
        if wrong:
            found.setdefault(wrong.strip().splitlines()[-1][:60], f"{target.name} input {number}: {wrong}")
        number += 1
    grown_mb = peak_mb() - base_mb
    print(
        f"{target.name:28s} {number:9d} inputs  slowest {slowest_s * 1e3:6.1f} ms  +{grown_mb:5.1f} MB  {len(found)} findings",
        flush=True,
    )
    return list(found.values())


def main() -> int:
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 600.0
    part = sys.argv[2] if len(sys.argv) > 2 else ""
    logging.disable(logging.CRITICAL)
    findings = [finding for target in targets() if part in target.name for finding in run(target, seconds)]
    print("\n".join(findings) or "no findings")
    return 1 if findings else 0


if __name__ == "__main__":
    sys.exit(main())
