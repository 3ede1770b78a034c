"""Answer goals on the map that ``irsctl replay`` left in a folder: graph.json, instances.npz, occupancy.png/.yaml."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irsd.core.errors import DecodeError, StoreError
from irsd.core.grid import GridFrame
from irsd.graph.codec import png_to_occupancy, snapshot_from_json
from irsd.graph.model import GraphSnapshot
from irsd.perception.encoder import LabelEncoder
from nav_bridge.answer import answer_document
from nav_bridge.config import BridgeSettings, load_map_file
from nav_bridge.planner import Planner, World, XyYaw
from nav_bridge.reader import Reader

EXIT_CODES: Mapping[str, int] = {"resolved": 0, "ambiguous": 3, "not_found": 4, "unreachable": 5}


@dataclass(frozen=True, slots=True)
class OfflineMap:
    """What the folder holds. points: per instance id, float32 [N, 3] in the map frame."""

    graph: GraphSnapshot
    frame: GridFrame
    occupancy: NDArray[np.int8]
    points: Mapping[str, NDArray[np.float32]]

    def points_of(self, instance: str) -> NDArray[np.float32]:
        return self.points.get(instance, np.zeros((0, 3), np.float32))


def load_map(folder: Path) -> OfflineMap:
    """The map in a folder. StoreError when a file is missing, DecodeError when one is not what it should be."""
    graph = snapshot_from_json(_bytes(folder / "graph.json"))
    picture = load_map_file(folder / "occupancy.yaml")
    cells = png_to_occupancy(_bytes(picture.image))
    frame = GridFrame(picture.origin_xy_m, picture.resolution_m, *cells.shape)
    return OfflineMap(graph, frame, cells, _points(folder / "instances.npz"))


def _bytes(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise StoreError(f"{path} can't be read: {error}") from error


def _points(path: Path) -> Mapping[str, NDArray[np.float32]]:
    try:
        with np.load(path) as arrays:
            points, instance = arrays["points"].astype(np.float32), arrays["instance"].astype(np.int64)
    except (OSError, KeyError, ValueError) as error:
        raise DecodeError(f"{path}: expected arrays points and instance ({error})") from error
    if points.ndim != 2 or points.shape[1] != 3 or instance.shape != points.shape[:1]:
        raise DecodeError(f"{path}: expected points [N, 3] and instance [N], got {points.shape} and {instance.shape}")
    order = np.argsort(instance, kind="stable")
    numbers, begins = np.unique(instance[order], return_index=True)
    return (
        {f"I{n}": part for n, part in zip(numbers, np.split(points[order], begins[1:]), strict=True)}
        if len(numbers)
        else {}
    )


def load_queries(path: Path) -> list[tuple[str | None, str]]:
    """(id, text) of a JSON list of objects with ``id`` and ``text``, or of an object that holds it as ``queries``."""
    try:
        document = json.loads(_bytes(path))
        items = document["queries"] if isinstance(document, Mapping) else document
        return [(None if item.get("id") is None else str(item["id"]), str(item["text"])) for item in items]
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise DecodeError(f"{path}: expected a JSON list of objects with id and text ({error!r})") from error


def answer_all(
    folder: Path,
    queries: Iterable[tuple[str | None, str]],
    robot: XyYaw,
    settings: BridgeSettings,
    within_m: float | None = None,
) -> list[dict[str, Any]]:
    """The answers to (id, text) pairs, in order; encoder and map are loaded once."""
    known = load_map(folder)
    encoder = LabelEncoder.load()
    planner, reader = Planner(encoder, settings), Reader(settings.reader, encoder.aliases)
    costs = planner.cost_map(known.frame, known.occupancy)
    world = World(known.graph, lambda: costs, known.points_of, robot)
    return [
        answer_document(planner.answer(text, world, within_m, reader.read(text)), known.graph, query_id)
        for query_id, text in queries
    ]
