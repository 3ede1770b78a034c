"""How well shapes are named, on the true clouds of a recording that nothing was trained on."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from irsd.perception.encoder import LabelEncoder
from irsd.perception.shape import MIN_POINTS, features


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


def ranks(vectors: NDArray[np.float32], house: Clouds, encoder: LabelEncoder) -> NDArray[np.int64]:
    """[n] place of each thing's true name among the scene's names, 0 = first."""
    names = house.names
    order = np.argsort(-(vectors @ encoder.encode(names).T), axis=1)
    right = np.array([names.index(label) for label in house.labels])
    return np.argmax(order == right[:, None], axis=1)
