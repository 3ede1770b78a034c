"""Naming by shape and image together: their unit vectors, weighed and added."""

from __future__ import annotations

import importlib

import numpy as np

from irsd.perception.encoder import LabelEncoder
from training.score_shape import embed, house_clouds
from training.scoring import Evaluation, Row, ranks

_WEIGHTS = (0.0, 0.2, 0.35, 0.5, 0.65, 0.8, 1.0)  # of the shape


def score(context: Evaluation) -> list[Row]:
    """For several weights: the ablation from image alone (0) to shape alone (1)."""
    house, labels = house_clouds(context.data), LabelEncoder.load()
    names, shape = house.names, dict(zip(*embed(context), strict=True))
    try:
        image = dict(zip(*importlib.import_module("training.score_image").embed(context), strict=True))
    except ModuleNotFoundError as error:
        return [Row("fused", f"absent: {error}", None)]
    kept = [k for k, number in enumerate(house.ids) if number in image]
    truth = [house.labels[k] for k in kept]
    rows = []
    for weight in _WEIGHTS:
        vectors = np.stack([weight * shape[house.ids[k]] + (1 - weight) * image[house.ids[k]] for k in kept])
        rank = ranks(vectors, truth, names, labels.encode(names))
        bars = ((0.35, 0.5), (0.62, 0.8)) if 0 < weight < 1 else ((None, None), (None, None))
        rows.append(
            Row(
                "fused",
                f"shape {weight:g} + image {1 - weight:g}: top-1 of {len(kept)} things",
                float((rank < 1).mean()),
                *bars[0],
            )
        )
        rows.append(Row("fused", f"shape {weight:g} + image {1 - weight:g}: top-5", float((rank < 5).mean()), *bars[1]))
    return rows
