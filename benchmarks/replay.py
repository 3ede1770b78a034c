"""Replay the small house with external perception and print the table of bars: speed, rooms, instances, goto, memory.

    python benchmarks/replay.py [--data ../shared/data/small_house] [--once]

Runs ``irsctl replay`` twice (same bytes?), answers the recording's queries offline and calls the recording's own scorer.
Speed is a ratio: seconds recorded over seconds of wall time.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
SAME_BYTES = ("graph.json", "rooms.json", "instances.npz", "occupancy.png", "plan.svg")


def run(*command: str) -> str:
    """Standard output of a command; its progress goes to our standard error."""
    return subprocess.run([sys.executable, *command], check=True, stdout=subprocess.PIPE, text=True).stdout


def replay(data: Path, out: Path) -> dict[str, float]:
    detections = f"external:{data / (data.name + '.detections.mcap')}"
    run("-m", "irsd.ctl", "replay", str(data / f"{data.name}.mcap"), "--perception", detections, "--out", str(out))
    return dict(json.loads((out / "metrics.json").read_text()))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=HERE.parents[1] / "shared" / "data" / "small_house")
    parser.add_argument("--once", action="store_true", help="do not replay a second time to compare the bytes")
    arguments = parser.parse_args()
    data: Path = arguments.data
    if not data.is_dir():
        print(f"the recording is absent: {data}", file=sys.stderr)
        return 2
    with tempfile.TemporaryDirectory() as scratch:
        out = Path(scratch) / "one"
        metrics = replay(data, out)
        same = "not run"
        if not arguments.once:
            again = Path(scratch) / "two"
            replay(data, again)
            same = "yes" if all((out / n).read_bytes() == (again / n).read_bytes() for n in SAME_BYTES) else "NO"
        queries = Path(scratch) / "queries.json"
        queries.write_text(json.dumps(json.loads((data / "ground_truth.json").read_text())["queries"]))
        answers = Path(scratch) / "answers.json"
        answers.write_text(run("-m", "irsd.ctl", "goto", "--offline", str(out), "--queries", str(queries), "--json"))
        scorer = data.parents[1] / "tools" / "score_replay.py"
        score = json.loads(run(str(scorer), str(out), str(data), "--goto", str(answers), "--json"))
    goto = score["goto"]
    rows = [
        ("same input twice, same bytes", same, "yes"),
        ("replay speed, x real time", f"{metrics['speed_x']:.1f}", ">= 3"),
        ("rooms sym", score["rooms"]["sym"], ">= 0.55"),
        ("instances AP50", score["instances"]["ap50"], ">= 0.60"),
        ("instances AP25", score["instances"]["ap25"], ">= 0.80"),
        ("duplicates / wrong merges", f"{score['instances']['duplicates']} / {score['instances']['wrong_merges']}", ""),
        ("label top-1", score["labels"]["top1"], ""),
        ("right room", score["room_of"]["right"], ">= 0.85"),
        ("goto right rate", goto["right_rate"], ">= 0.60"),
        ("goto wrongly resolved", goto["wrongly_resolved"], "0"),
        ("peak RSS, MB", f"{metrics['peak_rss_mb']:.0f}", "<= 1500"),
        ("map shift left, m", score["shift"]["m"], ""),
    ]
    for name, value, bar in rows:
        print(f"{name:32s} {value!s:>12s}   {bar}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
