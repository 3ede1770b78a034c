"""How well shapes are named, on the true clouds of a recording that nothing was trained on."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from irsd.perception.encoder import LabelEncoder
from irsd.perception.shape import MIN_POINTS, UNKNOWN, ShapeEncoder, features
from training.scoring import Evaluation, Row, confusion, ranks


@dataclass(frozen=True, slots=True)
class Clouds:
    """True things of a recording: ids, clouds, labels, inputs points [n, POINTS, 4] and measures [n, MEASURES], names of the scene."""

    ids: tuple[int, ...]
    clouds: tuple[NDArray[np.float32], ...]
    labels: tuple[str, ...]
    points: NDArray[np.float32]
    measures: NDArray[np.float32]

    @property
    def names(self) -> list[str]:
        """The scene's names, each once."""
        return sorted(set(self.labels))


def house_clouds(folder: Path) -> Clouds:
    """Of instances.npz and ground_truth.json: all observable things that are not structure."""
    truth = json.loads((folder / "ground_truth.json").read_text())
    with np.load(folder / "instances.npz") as data:
        xyz, owner = data["xyz"], data["instance"]
    rng = np.random.default_rng(0)
    ids, clouds, labels = [], [], []
    for instance in truth["instances"]:
        cloud = xyz[owner == instance["id"]].astype(np.float32)
        if not instance["structural"] and instance["observable"] and len(cloud) >= MIN_POINTS:
            ids.append(int(instance["id"]))
            clouds.append(cloud[rng.permutation(len(cloud))])
            labels.append(str(instance["label"]))
    points, measures = zip(*(features(cloud, 0.0) for cloud in clouds), strict=True)
    return Clouds(tuple(ids), tuple(clouds), tuple(labels), np.stack(points), np.stack(measures))


def embed(context: Evaluation) -> tuple[tuple[int, ...], NDArray[np.float32]]:
    """(instance ids [n], unit vectors [n, D]) of all true things, by their true clouds."""
    house = house_clouds(context.data)
    return house.ids, ShapeEncoder(context.models / "shape_encoder.onnx").encode(house.clouds, 0.0)


def worn(clouds: tuple[NDArray[np.float32], ...], seed: int = 0) -> list[NDArray[np.float32]]:
    """The clouds as maps hold them when little was seen: 5 cm voxels, 2 cm noise, a third cut off."""
    rng = np.random.default_rng(seed)
    out = []
    for cloud in clouds:
        depth = cloud @ rng.normal(size=3)
        part = cloud[depth >= np.quantile(depth, 0.33)] + rng.normal(
            0, 0.02, (int((depth >= np.quantile(depth, 0.33)).sum()), 3)
        )
        _, first = np.unique(np.floor(part / 0.05).astype(np.int64), axis=0, return_index=True)
        out.append(np.asarray(part[first] if len(first) >= MIN_POINTS else part, np.float32))
    return out


def score(context: Evaluation) -> list[Row]:
    """Naming by shape: among the scene's names, and how it knows what it does not know."""
    house, labels = house_clouds(context.data), LabelEncoder.load()
    encoder = ShapeEncoder(context.models / "shape_encoder.onnx")
    names = house.names
    vectors = encoder.encode(house.clouds, 0.0)
    rank = ranks(vectors, house.labels, names, labels.encode(names))
    rows = [
        Row(
            "shape",
            f"true clouds, top-1 of {len(names)} names, {len(rank)} things",
            float((rank < 1).mean()),
            0.3,
            0.45,
        ),
        Row("shape", "true clouds, top-5", float((rank < 5).mean()), 0.55, 0.75),
    ]
    tired = ranks(encoder.encode(worn(house.clouds), 0.0), house.labels, names, labels.encode(names))
    rows += [
        Row("shape", "a third cut off, 2 cm noise, 5 cm voxels: top-1", float((tired < 1).mean())),
        Row("shape", "a third cut off, 2 cm noise, 5 cm voxels: top-5", float((tired < 5).mean())),
    ]
    share = encoder.calibration.probabilities(vectors @ labels.encode([*names, UNKNOWN]).T)
    sure = (share.argmax(1) < len(names)) & (share.max(1) >= encoder.calibration.min_probability)
    rows += [
        Row(
            "shape",
            f"names it dares to say (probability >= {encoder.calibration.min_probability:g})",
            float(sure.mean()),
        ),
        Row("shape", "of those, right", float((rank[sure] < 1).mean()) if sure.any() else None),
        Row(
            "shape", "of the others, right would have been", float((rank[~sure] < 1).mean()) if (~sure).any() else None
        ),
    ]
    if context.out:
        called = [names[k] for k in (vectors @ labels.encode(names).T).argmax(1)]
        confusion(context.out / "shape_encoder.svg", house.labels, called, "called by shape alone")
    return rows
