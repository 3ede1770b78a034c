"""The drawing and the output folder: well-formed, complete, and the same bytes for the same graph."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from irsd.core.grid import GridFrame
from irsd.ctl.draw import draw_graph, to_png, to_svg
from irsd.ctl.live import delta_line, tree_lines
from irsd.ctl.outputs import instance_cloud, instance_embeddings, write_outputs
from irsd.graph.codec import delta_to_json
from irsd.graph.model import BuildingNode, DoorEdge, GraphDelta, GraphSnapshot, InstanceArrays, InstanceNode, RoomNode


def instance(number: int, label: str, room: str | None) -> InstanceNode:
    return InstanceNode(
        f"I{number}", label, ((label, 0.9),), room, (1.0, 1.0, 0.5), (0.5, 0.5, 0.0), (1.5, 1.5, 1.0),
        (1.0, 1.0, 0.5), (1.0, 1.0, 1.0), 0.0, 1.0, 100, 7, 0.9, "present", 1, 2,
    )  # fmt: skip


def room(number: int, label: str, x0: float) -> RoomNode:
    polygon = ((x0, 0.0), (x0 + 4.0, 0.0), (x0 + 4.0, 3.0), (x0, 3.0))
    return RoomNode(
        f"R{number}", label, ((label, 0.8),), polygon, (x0, 0.0, x0 + 4.0, 3.0), 12.0, 0.0, 2.6, (), ("D1",)
    )


def snapshot(instances: tuple[InstanceNode, ...] = ()) -> GraphSnapshot:
    rooms = (room(1, "laboratory", 0.0), room(2, "office & <store>", 4.2))
    door = DoorEdge("D1", ("R1", "R2"), (4.1, 1.5), 0.9)
    return GraphSnapshot(3, 5, "m", "map", BuildingNode("B0", "building", ("R1", "R2")), rooms, (door,), instances)


EMPTY = GraphSnapshot(0, 0, "m", "map", BuildingNode("B0", "building", ()), (), (), ())
GRID = (GridFrame((-1.0, -1.0), 0.05, 100, 200), np.tile(np.array([-1, 0, 100, 0], np.int8), (100, 50)))


@pytest.mark.parametrize("graph", [EMPTY, snapshot(), snapshot((instance(7, "television", "R1"),))])
@pytest.mark.parametrize("grid", [None, GRID])
def test_both_drawings_are_well_formed(graph: GraphSnapshot, grid: tuple[GridFrame, np.ndarray] | None) -> None:
    drawing = draw_graph(graph, grid, path=((0.0, 0.0), (1.0, 1.0)), goal=(1.0, 1.0))
    root = ET.fromstring(to_svg(drawing))
    texts = [t.text for t in root.iter("{http://www.w3.org/2000/svg}text")]
    assert texts == [f"{i.id} {i.label}" for i in graph.instances] + [f"{r.id} {r.label}" for r in graph.rooms]
    picture = cv2.imdecode(np.frombuffer(to_png(drawing), np.uint8), cv2.IMREAD_COLOR)
    assert picture.shape[:2] == (int(float(root.get("height"))), int(float(root.get("width"))))
    assert picture.min() < 200  # something was drawn


def test_output_folder_is_complete_and_repeatable(tmp_path: Path) -> None:
    graph = snapshot((instance(7, "television", "R1"), instance(12, "chair", None)))
    points = np.arange(12, dtype=np.float32).reshape(4, 3)
    arrays = {"I12": InstanceArrays(points[:1], None), "I7": InstanceArrays(points, np.full(3, 0.5, np.float32))}
    for name in ("a", "b"):
        write_outputs(tmp_path / name, graph, arrays, GRID, {"frames": 1})
    names = sorted(p.name for p in (tmp_path / "a").iterdir())
    assert names == sorted(
        [
            "graph.json",
            "rooms.json",
            "instances.npz",
            "embeddings.npz",
            "occupancy.png",
            "occupancy.yaml",
            "metrics.json",
            "plan.svg",
        ]
    )
    assert all((tmp_path / "a" / n).read_bytes() == (tmp_path / "b" / n).read_bytes() for n in names)
    stored = np.load(tmp_path / "a" / "instances.npz")
    assert stored["instance"].tolist() == [7, 7, 7, 7, 12]
    assert stored["points"].dtype == np.float32
    rooms = json.loads((tmp_path / "a" / "rooms.json").read_text())
    assert [(r["id"], r["label"]) for r in rooms] == [("R1", "laboratory"), ("R2", "office & <store>")]
    assert set(rooms[0]) >= {"polygon", "aabb", "floor_z", "ceiling_z"}


def test_no_instances_are_empty_arrays() -> None:
    assert instance_cloud({})["points"].shape == (0, 3)
    assert instance_embeddings({})["instance"].shape == (0,)


def test_tree_names_rooms_things_and_doors() -> None:
    text = "\n".join(tree_lines(snapshot((instance(7, "television", "R1"), instance(12, "chair", None)))))
    assert "R1 laboratory  12.0 m², doors to R2" in text
    assert (
        text.index("R1")
        < text.index("I7 television")
        < text.index("R2 office")
        < text.index("in no room")
        < text.index("I12")
    )


def test_what_has_moved_or_gone_is_called_so() -> None:
    nodes = [
        replace(instance(k, "chair", "R1"), state=state) for k, state in enumerate(("present", "moved", "gone"), 1)
    ]
    tree = tree_lines(snapshot(tuple(nodes)))
    ends = [line.rsplit("x", 1)[1] for line in tree if "chair" in line]
    assert ends == ["", " (moved)", " (gone)"]
    delta = GraphDelta(4, 0, "m", "map", (), (), tuple(nodes), ("I9",), ())
    assert delta_line(delta_to_json(delta)) == "#4  ~I1 chair  ~I2 chair (moved)  ~I3 chair (gone)  -I9"
