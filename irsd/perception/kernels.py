"""Pure functions over boxes, masks and pixels that the chain is made of."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from irsd.core.jit import kernel

Floats = NDArray[np.float32]
Bools = NDArray[np.bool_]
Rows = NDArray[np.int32]


@kernel
def suppress(boxes_px: Floats, kind: Rows, order: NDArray[np.int64], overlap: float) -> Bools:
    """Class-wise non-maximum suppression (greedy, Neubeck & Van Gool 2006): bool [n], True for boxes that stay.

    boxes_px: float32 [n, 4] x0 y0 x1 y1. kind: int32 [n], only boxes of one kind suppress each other. order: int64 [n], best first;
    a box goes when its IoU with a better one that stays exceeds ``overlap``.
    """
    n = len(order)
    keep = np.ones(n, np.bool_)
    area = np.empty(n)
    for k in range(n):
        wide = max(float(boxes_px[k, 2] - boxes_px[k, 0]), 0.0)
        area[k] = wide * max(float(boxes_px[k, 3] - boxes_px[k, 1]), 0.0)
    for i in range(n):
        a = order[i]
        if not keep[a]:
            continue
        for j in range(i + 1, n):
            b = order[j]
            if not keep[b] or kind[a] != kind[b]:
                continue
            wide = min(boxes_px[a, 2], boxes_px[b, 2]) - max(boxes_px[a, 0], boxes_px[b, 0])
            high = min(boxes_px[a, 3], boxes_px[b, 3]) - max(boxes_px[a, 1], boxes_px[b, 1])
            if wide > 0 and high > 0:
                both = float(wide) * float(high)
                if both > overlap * (area[a] + area[b] - both):
                    keep[b] = False
    return keep


def best_boxes(boxes_px: Floats, scores: Floats, kind: Rows, overlap: float) -> NDArray[np.int64]:
    """Indices of the boxes that survive class-wise suppression, best first; the earlier among equals."""
    order = np.argsort(-scores, kind="stable")
    keep = suppress(np.ascontiguousarray(boxes_px, np.float32), kind.astype(np.int32), order, overlap)
    return np.asarray(order[keep[order]])


def paint(masks: Bools) -> NDArray[np.uint16]:
    """uint16 [H, W]: k + 1 where mask k lies, 0 elsewhere. Masks bool [n, H, W]; a smaller one lies on a larger one."""
    out = np.zeros(masks.shape[1:], np.uint16)
    size = masks.sum((1, 2))
    for k in np.argsort(-size, kind="stable").tolist():
        out[masks[k]] = k + 1
    return out


@kernel
def share_with_known(ids_px: NDArray[np.uint16], pixel: Floats, of_point: Rows, masks: int, known: int) -> Floats:
    """IoU float32 [masks, known] of masks and known things, over the map points that both are seen by.

    ids_px: uint16 [H, W], k + 1 where mask k lies; pixel: float32 [M, 2]; of_point: int32 [M], row of the thing or -1.
    """
    both = np.zeros((masks, known))
    of_mask, of_thing = np.zeros(masks), np.zeros(known)
    height, width = ids_px.shape
    for p in range(len(pixel)):
        column, row = int(np.floor(pixel[p, 0] + 0.5)), int(np.floor(pixel[p, 1] + 0.5))
        if not (0 <= column < width and 0 <= row < height):
            continue
        mask, thing = int(ids_px[row, column]) - 1, of_point[p]
        if mask >= 0:
            of_mask[mask] += 1
        if thing >= 0:
            of_thing[thing] += 1
            if mask >= 0:
                both[mask, thing] += 1
    out = np.zeros((masks, known), np.float32)
    for m in range(masks):
        for k in range(known):
            if both[m, k] > 0:
                out[m, k] = both[m, k] / (of_mask[m] + of_thing[k] - both[m, k])
    return out


def unit_rows(vectors: Floats) -> Floats:
    """float32 [n, D]: each row divided by its length; a zero row stays."""
    length = np.linalg.norm(vectors.astype(np.float64), axis=1, keepdims=True)
    return np.asarray(vectors / np.maximum(length, 1e-12), np.float32)
