"""The pack of small networks that irsd ships: opened from its own folder, and what they cost."""

from __future__ import annotations

import importlib.resources
from pathlib import Path

from irsd.perception.assemble import ModelSettings
from irsd.perception.budget import Stage
from irsd.perception.encoder import LabelEncoder
from irsd.perception.models import Cancel
from irsd.perception.naming import Namer
from irsd.perception.nano_chain import NanoChain
from irsd.perception.nano_image import NanoImageEncoder
from irsd.perception.nano_segmenter import NanoSegmenter
from irsd.perception.settings import HOUSEHOLD, PerceptionSettings
from irsd.perception.shape import ShapeEncoder

# CPU seconds (fixed, each) on one thread of two cores without VNNI (benchmarks/nano_eyes.py): what a replay counts with and a robot
# starts from.
COSTS: dict[Stage, tuple[float, float]] = {Stage.SEGMENT: (0.060, 0.0), Stage.EMBED: (0.001, 0.002)}


def nano_path(name: str) -> Path:
    """A file of the pack."""
    return Path(str(importlib.resources.files("irsd.models.nano").joinpath(name)))


def open_nano_chain(settings: PerceptionSettings, where: ModelSettings, cancel: Cancel) -> NanoChain:
    """Segmenter and image encoder. ModelError when a file of the pack is missing or is not what it should be."""
    segmenter = NanoSegmenter(nano_path("segmenter.onnx"), threads=where.threads, cancel=cancel)
    encoder = NanoImageEncoder(nano_path("image_encoder.onnx"), threads=where.threads, cancel=cancel)
    return NanoChain(settings, segmenter, encoder, cancel=cancel.request, clear=cancel.clear)


def open_namer(settings: PerceptionSettings, labels: LabelEncoder) -> Namer:
    """Names by shape and picture; runs on the map's thread. ModelError as above."""
    shapes = ShapeEncoder(nano_path("shape_encoder.onnx"))
    reading = shapes.calibration
    return Namer(
        settings.naming,
        shapes,
        labels.encode,
        settings.vocabulary or HOUSEHOLD,
        scale=reading.scale,
        min_probability=reading.min_probability,
    )


def nano_status() -> list[dict[str, object]]:
    """What runs on what, for the status."""
    return [
        {"model": "nano", "part": part, "precision": "shipped", "judged": True, "providers": ["cpu"], "fallback": ""}
        for part in ("image_encoder", "segmenter", "shape_encoder")
    ]
