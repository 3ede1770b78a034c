"""make soak: a recording played in a loop at real time; does memory, files or threads grow?  soak.py [--minutes 20] [--files MCAP...]

The first quarter is warm-up; slopes are least squares over the rest. Exit code 1 when memory grows by 1 MB a minute or more, or files
or threads grow at all between the means of the second and the last quarter (by more than half of one).
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np
from live_irsd import Reading, play, recordings, running_irsd


def main() -> int:
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--minutes", type=float, default=20.0)
    parser.add_argument("--files", type=Path, nargs="+")
    given = parser.parse_args()
    readings: list[Reading] = []
    with tempfile.TemporaryDirectory() as name, running_irsd(Path(name)) as live:
        for _ in play(live.session, given.files or recordings(), given.minutes * 60.0):
            readings.append(live.read())
            if len(readings) % 60 == 0:
                last = readings[-1]
                print(
                    f"{len(readings) // 60:3d} min  {last.rss_mb:6.1f} MB  {last.files} files  {last.threads} threads",
                    flush=True,
                )
    return report(readings)


def report(readings: list[Reading]) -> int:
    """Prints the table; the exit code."""
    at_min = np.array([r.at_s for r in readings]) / 60.0
    at_min -= at_min[0]
    late = at_min >= at_min[-1] / 4.0
    rss_mb = np.array([r.rss_mb for r in readings])
    slope = float(np.polyfit(at_min[late], rss_mb[late], 1)[0])
    cores = (readings[-1].cpu_s - readings[0].cpu_s) / (readings[-1].at_s - readings[0].at_s)
    quarter = max(1, len(readings) // 4)
    grown = {
        kind: float(
            np.mean([getattr(r, kind) for r in readings[-quarter:]])
            - np.mean([getattr(r, kind) for r in readings[quarter : 2 * quarter]])
        )
        for kind in ("files", "threads")
    }
    status = readings[-1].status
    print(f"played          {at_min[-1]:8.1f} min")
    print(f"memory          {rss_mb[late].max():8.1f} MB at most, slope {slope:+.2f} MB/min (bar < 1)")
    print(f"files, threads  {grown['files']:+8.1f} {grown['threads']:+.1f} (bar 0)")
    print(f"CPU             {cores:8.2f} cores")
    print(f"lag             {status.get('lag_s')} s, drops {status.get('drops')}")
    print(f"faults          {[fault['code'] for fault in status.get('faults', [])]}")
    return int(slope >= 1.0 or max(grown.values()) > 0.5)


if __name__ == "__main__":
    sys.exit(main())
