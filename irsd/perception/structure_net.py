"""Networks that say what each voxel of the map is part of: ours, on what geometry knows, and any that takes bare points."""

from __future__ import annotations

import importlib.resources
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from irsd.core.errors import ModelError
from irsd.core.types import MapBlock, Structure
from irsd.perception.models import Session
from irsd.perception.structure_features import smoothed, structure_features

SHIPPED = "nano"  # the name of our own network in settings
_CLASSES = len(Structure)
# A thing's point that is called wall is lost to the thing, a wall's point that is called thing is noise that fusion removes: the
# network must be so many times as sure of structure. With 1, a quarter of things' points are lost; with 4.5 as few as by geometry.
_DOUBT = 4.5


class StructureModel(Protocol):
    """What ``mapping.network`` asks of a model."""

    def classify(self, block: MapBlock) -> NDArray[np.uint8]:
        """``Structure`` values uint8 [N] of a block's N voxels."""


def structure_model(name: str) -> StructureModel | None:
    """The model of a setting: SHIPPED; the path of an ONNX point network; None for an empty name (geometry alone)."""
    if not name:
        return None
    if name == SHIPPED:
        return NanoStructure(Path(str(importlib.resources.files("irsd.models.nano").joinpath("structure.onnx"))))
    return PointNetwork(Path(name))


class NanoStructure:
    """Our own: input ``features`` float32 [N, FEATURES] of ``structure_features``, output ``logits`` float32 [N, 6]."""

    def __init__(self, path: Path, *, threads: int = 1) -> None:
        self._session = Session(path, threads=threads, inputs=("features",), outputs=("logits",))

    def classify(self, block: MapBlock) -> NDArray[np.uint8]:
        """``Structure`` values uint8 [N] of a block's N voxels."""
        logits = _logits(self._session, "features", structure_features(block))
        shares = np.exp(logits - logits.max(1, keepdims=True))
        shares = smoothed(block, shares / shares.sum(1, keepdims=True))
        shares[:, Structure.OTHER] *= _DOUBT
        return np.asarray(shares.argmax(1), np.uint8)


class PointNetwork:
    """A network with input ``points`` float32 [N, 3] (metres, relative to the robot, z up) and output ``logits`` float32 [N, 6], whose
    columns are the values of ``Structure``: other, wall, floor, ceiling, door, window."""

    def __init__(self, path: Path, *, threads: int = 1) -> None:
        self._session = Session(path, threads=threads, inputs=("points",), outputs=("logits",))

    def classify(self, block: MapBlock) -> NDArray[np.uint8]:
        """``Structure`` values uint8 [N] of a block's N points. ModelError when the network gives anything else."""
        points = np.ascontiguousarray(block.points, np.float32)
        return np.asarray(_logits(self._session, "points", points).argmax(1), np.uint8)


def _logits(session: Session, name: str, values: NDArray[np.float32]) -> NDArray[np.float32]:
    (logits,) = session.run({name: values}, ("logits",))
    if logits.shape != (len(values), _CLASSES):
        raise ModelError(f"{session.path.name}: logits has shape {logits.shape} for {len(values)} points")
    return np.asarray(logits, np.float32)
