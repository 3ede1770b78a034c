"""The output folder of a replay (docs/design.md, "Contracts"): graph.json, rooms.json, instances.npz, occupancy, metrics, plan."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irsd.core.grid import GridFrame
from irsd.ctl.draw import draw_graph, to_svg
from irsd.graph.codec import occupancy_to_png, rooms_document, snapshot_to_json
from irsd.graph.model import GraphSnapshot, InstanceArrays

ZIP_EPOCH = (1980, 1, 1, 0, 0, 0)  # a fixed time, so that the same arrays give the same bytes


def write_outputs(
    folder: Path,
    snapshot: GraphSnapshot,
    arrays: Mapping[str, InstanceArrays],
    grid: tuple[GridFrame, NDArray[np.int8]],
    metrics: Mapping[str, Any],
) -> None:
    """Write every file of the contract into ``folder`` (made if absent). Equal inputs give equal bytes, metrics apart."""
    folder.mkdir(parents=True, exist_ok=True)
    frame, cells = grid
    (folder / "graph.json").write_bytes(snapshot_to_json(snapshot))
    (folder / "rooms.json").write_text(json.dumps(rooms_document(snapshot), indent=1) + "\n")
    write_npz(folder / "instances.npz", instance_cloud(arrays))
    write_npz(folder / "embeddings.npz", instance_embeddings(arrays))
    (folder / "occupancy.png").write_bytes(occupancy_to_png(cells))
    (folder / "occupancy.yaml").write_text(map_server_yaml(frame))
    (folder / "metrics.json").write_text(json.dumps(metrics, indent=1) + "\n")
    (folder / "plan.svg").write_text(to_svg(draw_graph(snapshot, grid)))


def number_of(node_id: str) -> int:
    """7 for ``I7``."""
    return int(node_id[1:])


def instance_cloud(arrays: Mapping[str, InstanceArrays]) -> dict[str, NDArray[Any]]:
    """points float32 [N, 3] in the map frame and instance int32 [N], the number in the id of each point's owner."""
    ids = sorted(arrays, key=number_of)
    points = [arrays[i].points_map for i in ids]
    owner = [np.full(len(p), number_of(i), np.int32) for i, p in zip(ids, points, strict=True)]
    return {
        "points": np.concatenate([np.zeros((0, 3), np.float32), *points]),
        "instance": np.concatenate([np.zeros(0, np.int32), *owner]),
    }


def instance_embeddings(arrays: Mapping[str, InstanceArrays]) -> dict[str, NDArray[Any]]:
    """embedding float16 [n, D] and instance int32 [n], for the instances that have one."""
    pairs = [(i, e) for i in sorted(arrays, key=number_of) if (e := arrays[i].embedding) is not None]
    return {
        "embedding": np.array([e for _, e in pairs], np.float16) if pairs else np.zeros((0, 0), np.float16),
        "instance": np.array([number_of(i) for i, _ in pairs], np.int32),
    }


def write_npz(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """As ``numpy.savez_compressed``, but with a fixed time stamp inside the archive."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, array in arrays.items():
            buffer = io.BytesIO()
            np.lib.format.write_array(buffer, np.ascontiguousarray(array), allow_pickle=False)
            archive.writestr(zipfile.ZipInfo(f"{name}.npy", ZIP_EPOCH), buffer.getvalue(), zipfile.ZIP_DEFLATED)


def map_server_yaml(frame: GridFrame, image: str = "occupancy.png") -> str:
    """The map_server description of an occupancy picture whose top row has the largest y."""
    x, y = frame.origin_xy_m
    return (
        f"image: {image}\nresolution: {frame.resolution_m}\norigin: [{x:.6f}, {y:.6f}, 0.0]\n"
        "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\nmode: trinary\n"
    )
