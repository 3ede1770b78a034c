"""Room types from the true object lists of the recorded house: the names a perfect perception would give."""

from __future__ import annotations

import json
import math
from pathlib import Path

from irsd.graph.room_types import UNKNOWN, Evidence, RoomTyper, RoomTypeSettings
from irsd.perception.encoder import LabelEncoder


def test_no_room_of_the_house_gets_a_wrong_type(shared_data: Path) -> None:
    truth = json.loads((shared_data / "small_house" / "ground_truth.json").read_text())
    encoder = LabelEncoder.load()
    typer = RoomTyper(RoomTypeSettings(), encoder)
    found = {}
    for room in truth["rooms"]:
        inside = [i for i in truth["instances"] if i["rooms_accepted"][:1] == [room["id"]] and not i["structural"]]
        things = [Evidence(((i["label"], 1.0),), math.prod(i["obb"]["size"])) for i in inside]
        found[room["name"]] = typer.type_of(things).label
    wrong = {n: k for n, k in found.items() if k not in (UNKNOWN, encoder.aliases.canonical_room(n))}
    assert not wrong
    assert {n for n, k in found.items() if k != UNKNOWN} >= {"bedroom", "kitchen", "living room", "dining room"}
