"""What irsd's map shows a recording's camera, beside the truth: the frames that the segmenter and the image encoder are scored on.

The recording runs through the product's own decoding, synchronising and mapping; every k-th picture is kept with the map in its sight at
that moment and the exact instance ids of NAME.gt.mcap.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from irsd.config import IrsdConfig, with_pictures
from irsd.core.types import CameraView, Structure
from irsd.ingest import SensorDecoder
from irsd.instances.lift import points_in_sight
from irsd.mapping.mapper import Mapper
from irsd.perception.nano_image import Geometry
from irsd.perception.structure_net import structure_model
from irsd.sensors.decode import decode_detection_ids
from irsd.sensors.replay import read_messages
from irsd.sensors.sync import Synchronizer
from training.render_data import Frame

_IDS = "/gt/instance_ids"
EVERY = 4  # pictures


@dataclass(frozen=True, slots=True)
class Recorded:
    """frames at full size; labels and structural bool: of instance ids, [id] (0 is nothing)."""

    frames: list[Frame]
    labels: tuple[str, ...]
    structural: NDArray[np.bool_]


@lru_cache(maxsize=1)
def frames_of(folder: Path) -> Recorded:
    """Every fourth picture of the recording FOLDER/FOLDER.mcap."""
    document = json.loads((folder / "ground_truth.json").read_text())
    count = 1 + max(instance["id"] for instance in document["instances"])
    labels, structural = [""] * count, np.zeros(count, np.bool_)
    for instance in document["instances"]:
        labels[instance["id"]] = instance["label"]
        structural[instance["id"]] = instance["structural"]
    truth = _truth_ids(folder / f"{folder.name}.gt.mcap")
    views = _views(folder / f"{folder.name}.mcap", truth)
    frames = [frame for k, frame in enumerate(views) if k % EVERY == 0]
    return Recorded(frames, tuple(labels), structural)


def geometry_of(frame: Frame) -> Geometry:
    """The camera above the floor at z = 0."""
    return Geometry(frame.matrix, frame.pose[2, :3], float(frame.pose[2, 3]))


def _truth_ids(path: Path) -> dict[int, NDArray[np.uint8]]:
    """Instance ids by stamp, packed as PNG."""
    found = {}
    for message in read_messages([path]):
        if message.topic == _IDS:
            picture = decode_detection_ids(message.data)
            _, packed = cv2.imencode(".png", picture.ids_px.astype(np.uint16))
            found[picture.stamp_ns] = packed.reshape(-1)
    return found


def _views(path: Path, truth: dict[int, NDArray[np.uint8]]) -> Iterator[Frame]:
    """The pictures with truth, as the map stands when they come."""
    settings = with_pictures(IrsdConfig())
    decoder, sync = SensorDecoder(settings.ingest), Synchronizer(settings.sync)
    mapper = Mapper(settings.pipeline.mapping, structure_model(settings.pipeline.mapping.network.model))
    for message in read_messages([path]):
        for sensed in decoder.decode(message.topic, message.data):
            sync.push(sensed)
        for frame in sync.pop():
            mapper.integrate(frame)
            for view in frame.views:
                if view.image is not None and view.stamp_ns in truth:
                    yield _frame(view, mapper, settings, truth[view.stamp_ns])


def _frame(view: CameraView, mapper: Mapper, settings: IrsdConfig, packed: NDArray[np.uint8]) -> Frame:
    lift = settings.pipeline.lift
    points, structure = mapper.visible(view.map_T_camera, view.camera, lift.max_range_m)
    index, pixel, depth_m = points_in_sight(view, points, lift)
    part = structure[index] != Structure.OTHER  # as the lookout says it
    assert view.image is not None
    _, blob = cv2.imencode(".jpg", view.image.bgr, [cv2.IMWRITE_JPEG_QUALITY, 95])
    rows = np.column_stack([pixel, depth_m, part]).astype(np.float32)
    thing = cv2.imdecode(packed, cv2.IMREAD_UNCHANGED)
    assert thing is not None
    nothing = np.zeros(0, np.uint8)
    return Frame(blob.reshape(-1), thing, nothing, rows, view.map_T_camera, view.camera.matrix, ())
