"""What every chain does with masks, whoever made them: which are kept, which are known, in what order they are worth a look."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from irsd.core.types import KnownThings
from irsd.perception.budget import Rung
from irsd.perception.job import PerceptionJob, Sight
from irsd.perception.kernels import Bools, Floats, Rows, paint, share_with_known
from irsd.perception.roles import Masks


@dataclass(frozen=True, slots=True)
class Found:
    """Masks with what the detector said of them: label '' where it said nothing; row of the known thing or -1."""

    masks: Bools
    scores: Floats
    labels: tuple[str, ...]
    known: Rows
    ids_px: NDArray[np.uint16]


def solid(masks: Masks, labels: tuple[str, ...], scores: Floats, rung: Rung, min_px: int, unsure: Bools) -> Found:
    """The masks that are large enough to be seen once all are painted; best first, at most as many as the rung allows.

    Where the others lie is written into ``unsure``.
    """
    order = np.argsort(-scores, kind="stable")
    for k in order[rung.masks :].tolist():
        unsure |= masks.masks[k]
    order = order[: rung.masks]
    ids = paint(masks.masks[order])
    size = np.bincount(ids.reshape(-1), minlength=len(order) + 1)[1:]
    keep = np.flatnonzero(size >= min_px)
    chosen = order[keep]
    return Found(
        masks.masks[chosen],
        np.asarray(scores[chosen], np.float32),
        tuple(labels[k] for k in chosen.tolist()),
        np.full(len(chosen), -1, np.int32),
        renumbered(ids, keep),
    )


def recognise(found: Found, sight: Sight, job: PerceptionJob, known_iou: float) -> Found:
    """Which masks are things that are known already: each mask the thing that it shares most with, if it is enough."""
    count, things = len(found.scores), len(job.known.id)
    if not count or not things:
        return found
    share = share_with_known(found.ids_px, sight.pixel, sight.of_point, count, things)
    best = share.argmax(1)
    has_meaning = np.asarray(job.known.embedding.any(1))
    sure = (share[np.arange(count), best] >= known_iou) & has_meaning[best]
    known = np.where(sure, best, -1).astype(np.int32)
    return Found(found.masks, found.scores, found.labels, known, found.ids_px)


def looks_of(found: Found, known: KnownThings) -> tuple[Rows, NDArray[np.int64]]:
    """(embeddings that each mask's thing got already, -1 for a new one; places of the masks, new things first, then those looked at
    least often, then those not seen for longest)."""
    old = found.known >= 0
    looks = np.where(old, known.looks[found.known] if len(known.looks) else 0, -1).astype(np.int32)
    waits = np.where(old, known.last_seen_ns[found.known] if len(known.id) else 0, 0)
    return looks, np.lexsort((waits, looks))


def reduced(bgr: NDArray[np.uint8], side_px: int) -> tuple[NDArray[np.uint8], float]:
    """(RGB whose longer side is at most side_px, its scale)."""
    scale = min(side_px / max(bgr.shape[:2]), 1.0)
    if scale < 1.0:
        size = (max(round(bgr.shape[1] * scale), 1), max(round(bgr.shape[0] * scale), 1))
        bgr = np.asarray(cv2.resize(bgr, size, interpolation=cv2.INTER_AREA), np.uint8)
    return np.ascontiguousarray(bgr[..., ::-1]), scale


def scaled(sight: Sight, scale: float) -> Sight:
    """The sight in the pixels of the reduced picture."""
    pixel = ((sight.pixel + 0.5) * scale - 0.5).astype(np.float32) if scale < 1.0 else sight.pixel
    return replace(sight, pixel=pixel)


def renumbered(ids_px: NDArray[np.uint16], keep: NDArray[np.int64]) -> NDArray[np.uint16]:
    """1, 2 .. for the masks ``keep`` in their order, 0 for all others."""
    table = np.zeros(int(ids_px.max(initial=0)) + 1, np.uint16)
    table[keep + 1] = np.arange(1, len(keep) + 1)
    return np.asarray(table[ids_px], np.uint16)


def enlarged(pixels: NDArray[Any], hw: tuple[int, ...]) -> NDArray[Any]:
    """Numbers [h, w] at another size; each pixel takes the nearest one's."""
    if pixels.shape == tuple(hw):
        return pixels
    return np.asarray(cv2.resize(pixels, (hw[1], hw[0]), interpolation=cv2.INTER_NEAREST))
