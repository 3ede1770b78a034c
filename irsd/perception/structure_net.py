"""An ONNX point network as a structure model: points in, class per point out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from irsd.core.errors import ModelError
from irsd.core.types import MapBlock, Structure
from irsd.perception.models import Session

_INPUT, _OUTPUT = "points", "logits"


class PointNetwork:
    """A network with input ``points`` float32 [N, 3] (metres, relative to the robot, z up) and output ``logits`` float32 [N, 6], whose
    columns are the values of ``Structure``: other, wall, floor, ceiling, door, window."""

    def __init__(self, path: Path, *, threads: int = 1) -> None:
        self._session = Session(path, threads=threads, inputs=(_INPUT,), outputs=(_OUTPUT,))

    def classify(self, block: MapBlock) -> NDArray[np.uint8]:
        """``Structure`` values uint8 [N] of a block's N points. ModelError when the network gives anything else."""
        points = np.ascontiguousarray(block.points, np.float32)
        (logits,) = self._session.run({_INPUT: points}, (_OUTPUT,))
        if logits.shape != (len(points), len(Structure)):
            raise ModelError(f"{self._session.path.name}: {_OUTPUT} has shape {logits.shape} for {len(points)} points")
        return np.asarray(logits.argmax(1), np.uint8)
