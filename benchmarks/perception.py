"""Speed and memory of the networks of irsd's own eyes, int8 against fp32, and print the table.

    python benchmarks/perception.py [NAME...] [--dir FOLDER] [--threads 1 2]

FOLDER: a folder of models as 'irsctl models' keeps it (default: the configured one); each model is measured in the precisions that are
there. Random weights of the true size give true times and memory; what they answer is noise, so that the agreement with fp32
(measured by 'irsctl models quantise' on this machine) only shows that the plumbing holds.

Each row is a process of its own that opens what one role needs: medians of 5 calls after one to warm up. CPU ms are of all threads,
about the wall ms of one thread on an idle core; wall ms depend on what else runs. RSS and peak are over a process without model.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from irsd.core.errors import ModelError
from irsd.perception.assemble import ModelOpener, ModelSettings
from irsd.perception.catalogue import Model
from irsd.perception.shelf import FLOAT, INT8
from irsd.perception.supply.check import Report, check

HEAD = ("model", "part", "file", "MB", "CPU ms", "wall ms", "RSS MB", "peak MB", "open s", "int8 vs fp32", "agreement")


def precisions_here(opener: ModelOpener, model: Model) -> list[str]:
    """fp32 and int8 as far as all networks that come in them are there."""
    out = []
    for precision in (FLOAT, INT8):
        parts = [[f for f in opener.shelf.files_of(model, p) if f.precision == precision] for p in model.contracts]
        if any(parts) and all(opener.shelf.present(model, files[0]) for files in parts if files):
            out.append(precision)
    return out


def rows_of(settings: ModelSettings, opener: ModelOpener, name: str, role: str, threads: Sequence[int]) -> list[tuple]:
    """The table's rows of one role of one model."""
    model = opener.model(name)
    reports: dict[tuple[str, int], Report] = {}
    for precision in precisions_here(opener, model):
        for count in threads:
            report = check(settings, f"{name}@{precision}", count, role)
            if report.problems:
                raise ModelError(f"{name}@{precision}: {'; '.join(report.problems)}")
            reports[precision, count] = report
    rows = []
    for part in dict.fromkeys(cost.part for report in reports.values() for cost in report.costs):
        for (precision, count), report in reports.items():
            (cost,) = (c for c in report.costs if c.part == part)
            if report.precisions[part] != precision:
                continue  # the other parts are int8, this one has none
            file = opener.shelf.choose(model, part, precision)
            record = opener.shelf.record(model, file)
            judged = record.judged if record else {}
            agreement = ", ".join(f"{key} {value:.3f}" for key, value in judged.items() if key != "pictures")
            against = ""
            if precision == INT8 and (FLOAT, count) in reports:
                (base,) = (c for c in reports[FLOAT, count].costs if c.part == part)
                against = f"{base.cpu_ms / max(cost.cpu_ms, 1e-3):.2f}x"
            size = f"{opener.shelf.path(model, file).stat().st_size / 1e6:.1f}"
            times = (f"{cost.cpu_ms:.0f}", f"{cost.wall_ms:.0f}", f"{report.rss_mb:.0f}", f"{report.peak_mb:.0f}")
            rows.append(
                (name, part, f"{precision}, {count} thr", size, *times, f"{report.open_s:.1f}", against, agreement)
            )
    return rows


def main() -> None:
    """Print the table, row by row."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*")
    parser.add_argument("--dir", type=Path, default=None)
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    arguments = parser.parse_args()
    settings = ModelSettings(directory=str(arguments.dir or ""))
    opener = ModelOpener(settings)
    names = arguments.names or [n for n, model in opener.catalogue.items() if precisions_here(opener, model)]
    print("| " + " | ".join(HEAD) + " |\n|" + " --- |" * len(HEAD), flush=True)
    for name in names:
        for role in opener.model(name).roles:
            for row in rows_of(settings, opener, name, role, arguments.threads):
                print("| " + " | ".join(row) + " |", flush=True)


if __name__ == "__main__":
    main()
