"""What adapters ask of every model file, so that one that does not fit is refused in words and not by a shape error far inside."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from irsd.core.errors import ModelError
from irsd.perception.models import Session


def require(session: Session, inputs: tuple[str, ...], outputs: tuple[str, ...]) -> None:
    """ModelError unless the file has these inputs and outputs."""
    lacking = [n for n in inputs if n not in session.inputs] + [n for n in outputs if n not in session.outputs]
    if lacking:
        raise ModelError(
            f"{session.path.name} lacks {', '.join(lacking)}; it has inputs {session.inputs} and outputs {session.outputs}"
        )


def boxes_in_picture(
    centres: NDArray[np.float32], scale_px: tuple[float, float], width: int, height: int
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Boxes as fractions (centre x, centre y, width, height) float32 [n, 4], times scale_px along x and y, to x0, y0, x1, y1 float32
    [n, 4] clipped to a picture of width x height; and whether anything of each is left."""
    middle, half = centres[:, :2], np.float32(0.5) * centres[:, 2:]
    scale = np.tile(np.array(scale_px, np.float32), 2)
    corners = np.concatenate([middle - half, middle + half], 1) * scale
    corners = np.clip(corners, 0, np.tile(np.array([width, height], np.float32), 2))
    return corners, np.asarray((corners[:, 2:] > corners[:, :2]).all(1))


def sigmoid(logits: NDArray[np.float32]) -> NDArray[np.float32]:
    """1 / (1 + exp(-x)), float32, without overflow; 0 for minus infinity."""
    return np.asarray(0.5 * (1 + np.tanh(0.5 * logits)), np.float32)
