"""What the codec writes is what docs/schema promises."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from graph_values import deltas, nodes, snapshots
from hypothesis import given, settings

from irsd.graph import codec
from irsd.graph.model import BuildingNode, DoorEdge, GraphDelta, GraphSnapshot, InstanceNode, RoomNode

FOLDER = Path(__file__).parents[2] / "docs" / "schema"
FILES = {
    GraphDelta: "delta",
    GraphSnapshot: "snapshot",
    BuildingNode: "building",
    RoomNode: "room",
    DoorEdge: "door",
    InstanceNode: "instance",
}
few = settings(max_examples=30, deadline=None)


def schema(name: str) -> dict[str, Any]:
    return json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))


def check(name: str, document: Any) -> None:
    jsonschema.Draft202012Validator(schema(name)).validate(document)


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.json")), ids=lambda p: p.stem)
def test_each_file_is_a_schema(path: Path) -> None:
    jsonschema.Draft202012Validator.check_schema(json.loads(path.read_text(encoding="utf-8")))


@pytest.mark.parametrize("kind", FILES, ids=lambda k: k.__name__)
def test_a_schema_names_the_fields_of_its_type(kind: type) -> None:
    document = schema(FILES[kind])
    assert document["$id"] == codec.schema_name(kind)
    assert set(document["properties"]) == {"schema", "seq", "frame", *kind.__slots__}
    assert set(document["required"]) == set(document["properties"])


@few
@given(deltas)
def test_deltas_are_valid(delta: GraphDelta) -> None:
    check("delta", json.loads(codec.delta_to_json(delta)))


@few
@given(snapshots)
def test_snapshots_are_valid(snapshot: GraphSnapshot) -> None:
    check("snapshot", json.loads(codec.snapshot_to_json(snapshot)))


@few
@given(nodes)
def test_nodes_are_valid(node: codec.Node) -> None:
    check(FILES[type(node)], json.loads(codec.node_to_json(node, seq=1, frame="map")))


VALID = {
    "waypoints": {
        "schema": "irs/nav/waypoints/1",
        "seq": 1,
        "frame": "map",
        "goal_id": "g",
        "waypoints": [[0, 1, 2]],
        "valid_s": 0.9,
    },
    "nav_state": {
        **{"schema": "irs/nav/state/1", "seq": 1, "frame": "map", "goal_id": "g", "state": "reached"},
        **{"distance_m": 0.43, "remaining_m": 0.0, "eta_s": None, "plans": 1},
        **{"reason": "", "text": "Reached: 0.43 m from I7 television"},
    },
    "nav_answer": {
        "id": "q1",
        "status": "resolved",
        "target": {"instance": "I7", "room": "R3", "label": "television", "score": 0.9},
        "candidates": [],
        "approach": {"x": 1.0, "y": 2.0, "yaw": 0.0, "distance_to_target_m": 0.4},
        "waypoints": [[0, 0, 0]],
        "why": {},
    },
    "status": {"schema": "irs/status/1", "seq": 1, "frame": "map", "robot": "bot1", "faults": []},
    "detections_info": {
        "stamp_ns": 1,
        "frame_id": "camera",
        "detections": [{"id": 1, "label": "tv", "score": 0.5, "labels": [["tv", 0.5]]}],
    },
}


@pytest.mark.parametrize("name", VALID)
def test_documents_of_other_parts(name: str) -> None:
    check(name, VALID[name])
    document = dict(VALID[name])
    document.pop(schema(name)["required"][0])
    with pytest.raises(jsonschema.ValidationError):
        check(name, document)
