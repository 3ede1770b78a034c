"""irsctl why and parse as processes, on a folder as ``irsctl replay`` leaves it; the live form is tested with the bridge."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import jsonschema
import navigation_house as house
import numpy as np
import pytest

from irsd.graph.codec import occupancy_to_png, snapshot_to_json

SCHEMA = Path(__file__).parents[2] / "docs" / "schema" / "nav_answer.json"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("flat")
    (out / "graph.json").write_bytes(snapshot_to_json(house.GRAPH))
    points = {int(t.id[1:]): house.points_of(t.id) for t in house.THINGS}
    np.savez(
        out / "instances.npz",
        points=np.concatenate(list(points.values())),
        instance=np.concatenate([np.full(len(p), n, np.int32) for n, p in points.items()]),
    )
    (out / "occupancy.png").write_bytes(occupancy_to_png(house.occupancy()))
    x, y = house.FRAME.origin_xy_m
    (out / "occupancy.yaml").write_text(f"image: occupancy.png\nresolution: 0.05\norigin: [{x}, {y}, 0.0]\nnegate: 0\n")
    return out


def irsctl(*arguments: str, code: int = 0) -> str:
    run = subprocess.run([sys.executable, "-m", "irsd.ctl", *arguments], capture_output=True, text=True, check=False)
    assert run.returncode == code, run.stderr
    return run.stdout


def test_why_in_words_and_json(folder: Path) -> None:
    arguments = ("why", "TV in the kitchen", "--offline", str(folder), "--from", "2.5,3")
    text = irsctl(*arguments)
    assert "I12 television in R2" in text
    assert "out: not in a kitchen" in text
    assert "places to stand" in text
    document = json.loads(irsctl(*arguments, "--json"))
    jsonschema.Draft202012Validator(json.loads(SCHEMA.read_text())).validate(document)
    room = json.loads(irsctl("why", "the lab", "--offline", str(folder), "--json"))
    jsonschema.Draft202012Validator(json.loads(SCHEMA.read_text())).validate(room)
    assert (room["target"]["instance"], room["target"]["room"]) == (None, "R1")
    # Whatever the answer is, explaining it is no error.
    assert "no elephant is known here" in irsctl("why", "elephant", "--offline", str(folder))
    irsctl("why", "elephant", "--from", "0,0", code=2)


def test_parse_in_words_and_json() -> None:
    assert "kitchen" in irsctl("parse", "the red chair in the kitchen")
    parsed = json.loads(irsctl("parse", "der zweite Stuhl neben dem Tisch", "--json"))
    assert (parsed["language"], parsed["rank"], parsed["relations"][0]["kind"]) == ("de", 2, "near")
