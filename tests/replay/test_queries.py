"""The small house's 71 queries on a graph made of its own ground truth: what language, resolution and routes are worth alone."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from irsd.core.geometry import invert, pose_from_xy_yaw, transform
from irsd.core.grid import GridFrame
from irsd.graph.codec import occupancy_to_png, rooms_document, snapshot_to_json
from irsd.graph.model import BuildingNode, GraphSnapshot, InstanceNode, RoomNode


def test_queries_on_the_true_graph(shared_data: Path, shared_tools: Path, tmp_path: Path) -> None:
    house = shared_data / "small_house"
    write_truth(house, tmp_path)
    command = [
        sys.executable,
        "-m",
        "nav_bridge",
        "offline",
        str(tmp_path),
        "--queries",
        str(house / "ground_truth.json"),
        "--json",
    ]
    answers = tmp_path / "answers.json"
    answers.write_bytes(subprocess.run(command, check=True, capture_output=True).stdout)
    scorer = [
        sys.executable,
        str(shared_tools / "score_replay.py"),
        str(tmp_path),
        str(house),
        "--goto",
        str(answers),
        "--json",
    ]
    score = json.loads(subprocess.run(scorer, check=True, capture_output=True).stdout)["goto"]
    assert score["wrongly_resolved"] == 0, score["detail"]
    assert score["right_rate"] >= 0.95, score["detail"]
    assert score["free"] == score["near"] == score["resolved_right"], score["detail"]


def write_truth(house: Path, out: Path) -> None:
    """The recording's ground truth in the form of a replay's output: graph, points and map in the frame of the robot's start."""
    truth = json.loads((house / "ground_truth.json").read_text())
    arrays = np.load(house / "instances.npz")
    start = truth["start_pose"]
    start_T_world = invert(pose_from_xy_yaw(start["x"], start["y"], start["yaw"]))
    room_ids = {room["id"]: f"R{k}" for k, room in enumerate(truth["rooms"], 1)}
    nodes, points, numbers = [], [], []
    for item in truth["instances"]:
        own = arrays["xyz"][arrays["instance"] == item["id"]].astype(np.float64)
        if item["structural"] or not item["observable"] or len(own) < 3:
            continue
        own = transform(start_T_world, own)
        nodes.append(_instance(item, own, room_ids[item["room"]]))
        points.append(own.astype(np.float32))
        numbers.append(np.full(len(own), item["id"], np.int32))
    rooms = tuple(_room(room, room_ids[room["id"]], start_T_world, nodes) for room in truth["rooms"])
    building = BuildingNode("B0", "house", tuple(room.id for room in rooms))
    graph = GraphSnapshot(1, 1, "truth", "map", building, rooms, (), tuple(nodes))
    (out / "graph.json").write_bytes(snapshot_to_json(graph))
    (out / "rooms.json").write_text(json.dumps(rooms_document(graph)))
    np.savez(out / "instances.npz", points=np.concatenate(points), instance=np.concatenate(numbers))
    _write_map(house, out, start_T_world)


def _instance(item: dict[str, Any], points: np.ndarray, room: str) -> InstanceNode:
    (x, y), (length, width), turn_deg = cv2.minAreaRect(points[:, :2].astype(np.float32))
    low, high = points.min(0), points.max(0)
    share = 0.25 / max(1, len(item["synonyms"]))
    labels = ((item["label"], 0.67), *((name, share) for name in item["synonyms"]))
    size = (max(length, 0.02), max(width, 0.02), max(float(high[2] - low[2]), 0.02))
    return InstanceNode(
        id=f"I{item['id']}",
        label=item["label"],
        labels=labels,
        room=room,
        centroid_m=tuple(map(float, points.mean(0))),
        aabb_min_m=tuple(map(float, low)),
        aabb_max_m=tuple(map(float, high)),
        obb_center_m=(x, y, float(low[2] + high[2]) / 2),
        obb_size_m=size,
        obb_yaw_rad=float(np.radians(turn_deg)),
        volume_m3=float(np.prod(size)),
        point_count=len(points),
        observations=item["camera_frames"],
        existence=0.95,
        state="present",
        first_seen_ns=0,
        last_seen_ns=1,
    )


def _room(room: dict[str, Any], name: str, start_T_world: np.ndarray, nodes: list[InstanceNode]) -> RoomNode:
    corners = np.c_[np.array(room["polygon"], float), np.zeros(len(room["polygon"]))]
    outline = transform(start_T_world, corners)[:, :2]
    aabb = (*map(float, outline.min(0)), *map(float, outline.max(0)))
    polygon = tuple((float(x), float(y)) for x, y in outline)
    inside = tuple(node.id for node in nodes if node.room == name)
    return RoomNode(name, room["name"], ((room["name"], 0.9),), polygon, aabb, 1.0, 0.0, 2.7, inside, ())  # type: ignore[arg-type]


def _write_map(house: Path, out: Path, start_T_world: np.ndarray) -> None:
    """The true map, turned into the start's frame by looking up the centre of each new cell."""
    grey = cv2.imread(str(house / "occupancy.png"), cv2.IMREAD_GRAYSCALE)[::-1]
    old = GridFrame((-10.3, -6.5), 0.05, *grey.shape)
    ends = old.centres_of(np.array([[0, 0], [0, old.width], [old.height, 0], [old.height, old.width]]))
    ends = transform(start_T_world, np.c_[ends, np.zeros(4)])[:, :2]
    low, high = ends.min(0), ends.max(0)
    height, width = (int(n) for n in np.ceil((high - low)[::-1] / 0.05))
    new = GridFrame((float(low[0]), float(low[1])), 0.05, height, width)
    centres = new.centres_of(np.argwhere(np.ones((height, width), bool)))
    source = old.cells_of(transform(invert(start_T_world), np.c_[centres, np.zeros(len(centres))]))
    known = old.inside(source)
    values = np.full(len(centres), 205, np.uint8)
    values[known] = grey[source[known, 0], source[known, 1]]
    cells = np.where(values < 100, 100, np.where(values > 250, 0, -1)).astype(np.int8).reshape(height, width)
    (out / "occupancy.png").write_bytes(occupancy_to_png(cells))
    (out / "occupancy.yaml").write_text(
        f"image: occupancy.png\nresolution: 0.05\norigin: [{low[0]}, {low[1]}, 0.0]\nnegate: 0\n"
    )
