"""The table of the model pack, on a recording that nothing was trained on.

python -m training.evaluate [--data ../shared/data/small_house] [--models irsd/models/nano] [--only structure shape..] [--out DIR] [--json FILE]

Each role has a module ``training.score_ROLE`` with ``score(context) -> list[Row]``; a role without its model file or module is reported as absent.
The modules of shape and image also give ``embed(context)``, which naming by both is measured with. --out: where pictures of the confusion go.
"""

from __future__ import annotations

import argparse
import importlib
import json
from dataclasses import asdict
from pathlib import Path

import irsd.models
from training.scoring import Evaluation, Row

ROLES = {
    "structure": "structure",
    "segmenter": "segmenter",
    "shape": "shape_encoder",
    "image": "image_encoder",
    "fused": "shape_encoder",
}


def scored(role: str, context: Evaluation) -> list[Row]:
    """The rows of a role; one that says absent where its file or its scorer is missing."""
    if not (context.models / f"{ROLES[role]}.onnx").exists():
        return [Row(role, f"absent: no {ROLES[role]}.onnx", None)]
    try:
        module = importlib.import_module(f"training.score_{role}")
    except ModuleNotFoundError as error:
        return [Row(role, f"absent: {error}", None)]
    rows: list[Row] = module.score(context)
    return rows


def line(row: Row) -> str:
    """A row of the table."""
    value = "" if row.value is None else f"{row.value:.3f}"
    held = "" if row.value is None or row.bar is None else ("ok" if row.met else "MISSED")
    bar, aim = ("" if number is None else f"{number:g}" for number in (row.bar, row.aim))
    return f"| {row.role:<9} | {row.measure:<64} | {value:>7} | {bar:>5} | {aim:>5} | {held:<6} |"


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--data", type=Path, default=Path(__file__).resolve().parents[2] / "shared" / "data" / "small_house"
    )
    parser.add_argument("--models", type=Path, default=Path(irsd.models.__file__).parent / "nano")
    parser.add_argument("--only", nargs="+", choices=tuple(ROLES), default=tuple(ROLES))
    parser.add_argument("--out", type=Path, help="folder for the pictures of the cards")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    context = Evaluation(arguments.data, arguments.models, arguments.out)
    print(line(Row("role", "measure", None)).replace("       |       |       |", " value |   bar |   aim |"))
    rows = []
    for role in arguments.only:
        for row in scored(role, context):
            rows.append(row)
            print(line(row), flush=True)
    if arguments.json:
        arguments.json.write_text(json.dumps([asdict(row) for row in rows], indent=1) + "\n")


if __name__ == "__main__":
    main()
