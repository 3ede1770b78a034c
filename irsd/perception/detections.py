"""What an external perception says about a picture: numbered pixels and a JSON document that explains the numbers.

``detections/ids`` is a 16-bit image, value = number of the detection that owns the pixel, 0 = none. ``detections/info`` is
``{"stamp_ns", "frame_id", "detections": [{"id", "label", "score", "labels"?: [[name, score], ..], "embedding"?: [float, ..]}]}``
with one entry per number. Both carry the stamp of the picture, and belong together when their stamps are equal.
"""

from __future__ import annotations

import json
import math
from collections import OrderedDict
from dataclasses import dataclass
from typing import Any, NoReturn, TypeGuard

import numpy as np
from numpy.typing import NDArray

from irsd.core.errors import DecodeError
from irsd.core.types import Detections

MAX_NUMBER = 65535
MAX_EMBEDDING = 8192
MAX_INFO_BYTES = 64 * 2**20
_PENDING = 8  # pictures that wait for their other half; detectors send both within one


@dataclass(frozen=True, slots=True)
class IdsImage:
    """The pixel half: ids_px uint16 [H, W], 0 = nothing."""

    stamp_ns: int
    frame_id: str
    ids_px: NDArray[np.uint16]


@dataclass(frozen=True, slots=True)
class DetectionInfo:
    """The word half, checked: parallel tuples, one entry per number; embedding float32 [n, D] unit length, or None."""

    stamp_ns: int
    frame_id: str
    number: tuple[int, ...]
    score: tuple[float, ...]
    label: tuple[str, ...]
    top_labels: tuple[tuple[tuple[str, float], ...], ...]
    embedding: NDArray[np.float32] | None


def parse_info(payload: bytes | str) -> DetectionInfo:
    """The checked content of a detections/info document. Raises DecodeError that names the entry and what is wrong with it."""
    if len(payload) > MAX_INFO_BYTES:
        raise DecodeError(f"detections/info: {len(payload)} bytes, at most {MAX_INFO_BYTES} are read")
    try:
        document = json.loads(payload, parse_constant=_refuse_constant)
    except (ValueError, RecursionError) as error:
        raise DecodeError(f"detections/info is not JSON: {error}") from error
    if not isinstance(document, dict):
        raise DecodeError("detections/info: expected an object")
    stamp_ns, frame_id = document.get("stamp_ns"), document.get("frame_id", "")
    if not _is_int(stamp_ns) or not 0 <= stamp_ns < 2**63:
        raise DecodeError(f"detections/info: stamp_ns = {stamp_ns!r}, expected nanoseconds as a whole number")
    if not isinstance(frame_id, str):
        raise DecodeError(f"detections/info: frame_id = {frame_id!r}, expected text")
    entries = document.get("detections")
    if not isinstance(entries, list) or len(entries) > MAX_NUMBER:
        raise DecodeError(f"detections/info: detections must be a list of at most {MAX_NUMBER} entries")
    for position, entry in enumerate(entries):
        _check_entry(entry, f"detections/info: entry {position}")
    number = tuple(entry["id"] for entry in entries)
    if len(set(number)) != len(number):
        raise DecodeError("detections/info: an id occurs twice")
    return DetectionInfo(
        stamp_ns=stamp_ns,
        frame_id=frame_id.lstrip("/"),
        number=number,
        score=tuple(float(entry["score"]) for entry in entries),
        label=tuple(entry["label"].strip() for entry in entries),
        top_labels=tuple(_top_labels(entry) for entry in entries),
        embedding=_embeddings(entries),
    )


def build(stamp_ns: int, frame_id: str, ids_px: NDArray[np.integer[Any]], info: DetectionInfo) -> Detections:
    """Joins the halves: ids_px [H, W], any unsigned or whole dtype with values in 0..65535.

    A number that owns no pixel is left out: nearer masks may cover one wholly. A pixel whose number info does not explain means
    that the halves are of different pictures: DecodeError, as is another stamp.
    """
    if info.stamp_ns != stamp_ns:
        raise DecodeError(f"detections: ids are of {stamp_ns} ns, info of {info.stamp_ns} ns")
    if ids_px.ndim != 2 or ids_px.dtype.kind not in "ui":
        raise DecodeError(f"detections: expected ids of whole numbers [H, W], got {ids_px.dtype} {ids_px.shape}")
    if ids_px.size and (int(ids_px.min()) < 0 or int(ids_px.max()) > MAX_NUMBER):
        raise DecodeError(f"detections: ids must be in 0..{MAX_NUMBER}")
    ids = np.ascontiguousarray(ids_px, np.uint16)
    present = _values_in(ids)
    unknown = np.setdiff1d(present[present > 0], np.array(info.number, np.int64))
    if unknown.size:
        raise DecodeError(f"detections: the ids image holds {unknown[:5].tolist()}, which info does not explain")
    order = sorted(range(len(info.number)), key=info.number.__getitem__)
    owners = frozenset(present.tolist())
    kept = [k for k in order if info.number[k] in owners]
    return Detections(
        stamp_ns=stamp_ns,
        frame_id=frame_id or info.frame_id,
        ids_px=ids,
        number=np.array([info.number[k] for k in kept], np.int32),
        score=np.array([info.score[k] for k in kept], np.float32),
        label=tuple(info.label[k] for k in kept),
        top_labels=tuple(info.top_labels[k] for k in kept),
        embedding=None if info.embedding is None else info.embedding[kept],
    )


def _values_in(ids: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """The values that occur, sorted. Masks are made of runs, so only the first pixel of each run is looked at."""
    flat = ids.ravel()
    starts = np.flatnonzero(flat[1:] != flat[:-1]) + 1
    return np.unique(np.concatenate([flat[:1], flat[starts]]))


class DetectionPairer:
    """Waits for both halves of a picture's detections, in any order. Bounded: the oldest half is given up and counted."""

    def __init__(self, capacity: int = _PENDING) -> None:
        self._ids: OrderedDict[int, IdsImage] = OrderedDict()
        self._info: OrderedDict[int, DetectionInfo] = OrderedDict()
        self._capacity = capacity
        self._unpaired = 0

    def push_ids(self, ids: IdsImage) -> Detections | None:
        """The detections when their info is here already, else None. Raises DecodeError when the halves contradict each other."""
        info = self._info.pop(ids.stamp_ns, None)
        if info is not None:
            return build(ids.stamp_ns, ids.frame_id, ids.ids_px, info)
        self._keep(self._ids, ids.stamp_ns, ids)
        return None

    def push_info(self, payload: bytes | str) -> Detections | None:
        """As ``push_ids`` for the JSON half. Raises DecodeError also for a document that is wrong in itself."""
        info = parse_info(payload)
        ids = self._ids.pop(info.stamp_ns, None)
        if ids is not None:
            return build(ids.stamp_ns, ids.frame_id, ids.ids_px, info)
        self._keep(self._info, info.stamp_ns, info)
        return None

    @property
    def unpaired(self) -> int:
        """Halves that were given up because their other half never came."""
        return self._unpaired

    def _keep(self, pending: OrderedDict[int, Any], stamp_ns: int, half: Any) -> None:
        self._unpaired += stamp_ns in pending
        pending[stamp_ns] = half
        if len(pending) > self._capacity:
            pending.popitem(last=False)
            self._unpaired += 1


def _refuse_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is not a JSON number")


def _is_int(value: object) -> TypeGuard[int]:
    return isinstance(value, int) and not isinstance(value, bool)


def _is_score(value: object) -> TypeGuard[float]:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and 0.0 <= value <= 1.0


def _check_entry(entry: object, where: str) -> None:
    if not isinstance(entry, dict):
        raise DecodeError(f"{where}: expected an object, got {type(entry).__name__}")
    number, label, score = entry.get("id"), entry.get("label"), entry.get("score")
    if not _is_int(number) or not 1 <= number <= MAX_NUMBER:
        raise DecodeError(f"{where}: id = {number!r}, expected 1..{MAX_NUMBER}")
    if not isinstance(label, str) or not label.strip():
        raise DecodeError(f"{where}: label = {label!r}, expected a name")
    if not _is_score(score):
        raise DecodeError(f"{where}: score = {score!r}, expected 0..1")
    labels = entry.get("labels", [])
    if not isinstance(labels, list) or not all(_is_ranked(pair) for pair in labels):
        raise DecodeError(f"{where}: labels must be a list of [name, score]")


def _is_ranked(pair: object) -> bool:
    return (
        isinstance(pair, list)
        and len(pair) == 2
        and isinstance(pair[0], str)
        and bool(pair[0].strip())
        and _is_score(pair[1])
    )


def _top_labels(entry: dict[str, Any]) -> tuple[tuple[str, float], ...]:
    """(name, score) best first; the entry's own label with its score where it gives no list."""
    ranked = [(name.strip(), float(score)) for name, score in entry.get("labels", [])]
    return tuple(sorted(ranked, key=lambda pair: -pair[1])) or ((entry["label"].strip(), float(entry["score"])),)


def _embeddings(entries: list[dict[str, Any]]) -> NDArray[np.float32] | None:
    """float32 [n, D] of unit length, or None where no entry has one. All must have one, of the same length."""
    given = [entry.get("embedding") for entry in entries]
    if all(embedding is None for embedding in given):
        return None
    lengths = {len(embedding) if isinstance(embedding, list) else -1 for embedding in given}
    if len(lengths) != 1 or not 1 <= (length := lengths.pop()) <= MAX_EMBEDDING:
        raise DecodeError("detections/info: every entry needs an embedding of the same length, or none may have one")
    if not all(isinstance(v, (int, float)) and not isinstance(v, bool) for row in given if row for v in row):
        raise DecodeError("detections/info: an embedding must be a list of numbers")
    try:
        rows = np.array(given, np.float64).reshape(len(entries), length)
    except OverflowError as error:
        raise DecodeError(f"detections/info: embedding: {error}") from error
    norms = np.sqrt((rows * rows).sum(1)) if np.abs(rows).max() < 1e100 else np.array([math.inf])
    if not (np.isfinite(norms) & (norms > 1e-9)).all():
        raise DecodeError("detections/info: an embedding has no direction")
    return np.asarray(rows / norms[:, None], np.float32)
