"""Class-agnostic average precision of masks at an IoU of a half, as COCO counts it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

IOU = 0.5


@dataclass(frozen=True, slots=True)
class Judged:
    """One picture: scores float32 [n]; right bool [n]; counts bool [n] (False: neither right nor wrong); how many things there were."""

    scores: NDArray[np.float32]
    right: NDArray[np.bool_]
    counts: NDArray[np.bool_]
    things: int


def judge(
    masks: NDArray[np.bool_],
    scores: NDArray[np.float32],
    thing: NDArray[np.integer],
    ignored: NDArray[np.bool_],
    least_px: int,
) -> Judged:
    """Masks bool [n, H, W], best first, against numbers of things [H, W] (0 nothing).

    A thing of fewer than ``least_px`` pixels, or ``ignored`` [numbers] (doors, windows, carpets), is not asked for; a mask of it, or a mask
    that small, is not counted.
    """
    size = np.bincount(thing.reshape(-1), minlength=len(ignored))
    wanted = (size >= least_px) & ~ignored[: len(size)]
    wanted[0] = False
    right, counts = np.zeros(len(masks), np.bool_), np.ones(len(masks), np.bool_)
    taken: set[int] = set()
    for k, mask in enumerate(masks):
        both = np.bincount(thing[mask], minlength=len(size))
        both[0] = 0
        own = int(mask.sum())
        iou = both / np.maximum(size + own - both, 1)
        best = int(np.where([n in taken for n in range(len(size))], 0, iou).argmax()) if taken else int(iou.argmax())
        if iou[best] >= IOU and wanted[best]:
            right[k] = True
            taken.add(best)
        elif own < least_px or (iou[best] >= IOU and not wanted[best]):
            counts[k] = False
    return Judged(np.asarray(scores, np.float32), right, counts, int(wanted.sum()))


def average_precision(pictures: list[Judged]) -> tuple[float, float]:
    """(AP, recall) over all pictures' masks together: the area under precision made monotone over recall."""
    scores = np.concatenate([p.scores[p.counts] for p in pictures])
    right = np.concatenate([p.right[p.counts] for p in pictures])
    things = sum(p.things for p in pictures)
    right = right[np.argsort(-scores, kind="stable")]
    if not things or not len(right):
        return 0.0, 0.0
    hits = np.cumsum(right)
    precision = np.maximum.accumulate((hits / np.arange(1, len(right) + 1))[::-1])[::-1]
    return float((precision * right).sum() / things), float(hits[-1] / things)
