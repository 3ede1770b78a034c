"""Score the image encoder on a recording's true masks, named among the names of that scene.

Each thing's vector is the mean over the pictures that show 400 pixels of it or more, weighted by the root of its pixels.
"""

from __future__ import annotations

import time

import numpy as np

from irsd.perception.encoder import LabelEncoder
from irsd.perception.nano_image import NanoImageEncoder
from training.recording_frames import Recorded, frames_of, geometry_of
from training.render_data import sight_of
from training.score_segmenter import LEAST_PX
from training.scoring import Evaluation, Row, confusion, ranks


def measured(recorded: Recorded, model: NanoImageEncoder, *, metres: bool) -> tuple[list[int], np.ndarray, float]:
    """(ids, unit vectors float32 [n, 384], CPU milliseconds a mask); metres False: without anything of the map."""
    total: dict[int, np.ndarray] = {}
    spent, seen = 0.0, 0
    for frame in recorded.frames:
        size = np.bincount(frame.thing.reshape(-1), minlength=len(recorded.labels))
        wanted = (size >= LEAST_PX) & ~recorded.structural
        numbers = [k for k in np.flatnonzero(wanted).tolist() if k]
        if not numbers:
            continue
        masks = np.stack([frame.thing == k for k in numbers])
        rgb, sight = frame.rgb(), sight_of(frame.points if metres else frame.points[:0])
        began = time.process_time()
        got = model.encode_masks(rgb, masks, sight, geometry_of(frame) if metres else None)
        spent, seen = spent + time.process_time() - began, seen + len(numbers)
        for k, vector in zip(numbers, got, strict=True):
            total[k] = total.get(k, np.zeros(model.dimension)) + vector * np.sqrt(size[k])
    ids = sorted(total)
    vectors = np.stack([total[k] / np.linalg.norm(total[k]) for k in ids]).astype(np.float32)
    return ids, vectors, 1000 * spent / max(seen, 1)


def embed(context: Evaluation) -> tuple[list[int], np.ndarray]:
    """(instance ids, unit vectors float32 [n, 384]) from true masks."""
    ids, vectors, _ = measured(
        frames_of(context.data), NanoImageEncoder(context.models / "image_encoder.onnx"), metres=True
    )
    return ids, vectors


def score(context: Evaluation) -> list[Row]:
    """The image encoder's rows of the table."""
    recorded, labels = frames_of(context.data), LabelEncoder.load()
    model = NanoImageEncoder(context.models / "image_encoder.onnx")
    rows = []
    for metres in (True, False):
        ids, vectors, ms = measured(recorded, model, metres=metres)
        truth = [recorded.labels[k] for k in ids]
        names = sorted(set(truth))
        rank = ranks(vectors, truth, names, labels.encode(names))
        what = f"{len(ids)} things, {len(names)} names" if metres else "without the map"
        bars = ((0.15, 0.30), (0.40, 0.60)) if metres else ((None, None), (None, None))
        rows.append(Row("image", f"top-1 from true masks, {what}", float((rank < 1).mean()), *bars[0]))
        rows.append(Row("image", f"top-5, {what}", float((rank < 5).mean()), *bars[1]))
        if metres:
            rows.append(Row("image", "CPU milliseconds a mask, 1 thread", ms, 3, None, below=True))
            if context.out is not None:
                called = [names[k] for k in (vectors @ labels.encode(names).T).argmax(1)]
                confusion(
                    context.out / "image_encoder_confusion.svg", truth, called, "Called what, from pictures alone"
                )
    return rows
