"""What irsd's map shows a recording's camera, beside the truth: python -m training.recording_frames FOLDER NAME --out FILE.npz

The recording runs through the product's own decoding, synchronising and mapping; every k-th picture is kept with the map in its sight
and the exact instance ids of FOLDER/NAME.gt.mcap, in the format of ``training.render`` (but pictures and ids at full size).
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import cv2
import numpy as np

from irsd.config import IrsdConfig, with_pictures
from irsd.core.types import CameraView, Structure
from irsd.ingest import SensorDecoder
from irsd.instances.lift import points_in_sight
from irsd.mapping.mapper import Mapper
from irsd.sensors.decode import decode_detection_ids
from irsd.sensors.replay import read_messages
from irsd.sensors.sync import Synchronizer

_IDS = "/gt/instance_ids"


def truth_ids(path: Path) -> dict[int, np.ndarray]:
    """Instance ids uint16 [H, W] by stamp, packed as PNG."""
    found = {}
    for message in read_messages([path]):
        if message.topic == _IDS:
            picture = decode_detection_ids(message.data)
            _, packed = cv2.imencode(".png", picture.ids_px.astype(np.uint16))
            found[picture.stamp_ns] = packed.reshape(-1)
    return found


def kept(view: CameraView, mapper: Mapper, settings: IrsdConfig) -> dict[str, np.ndarray]:
    """A view's picture and the map in its sight, as ``training.render`` writes them."""
    lift = settings.pipeline.lift
    points, structure = mapper.visible(view.map_T_camera, view.camera, lift.max_range_m)
    index, pixel, depth_m = points_in_sight(view, points, lift)
    part = np.isin(structure[index], (Structure.WALL, Structure.FLOOR, Structure.CEILING))
    assert view.image is not None
    _, blob = cv2.imencode(".jpg", view.image.bgr, [cv2.IMWRITE_JPEG_QUALITY, 95])
    return {
        "jpeg": blob.reshape(-1),
        "pixel": np.column_stack([pixel, depth_m, part]).astype(np.float32),
        "pose": view.map_T_camera,
        "matrix": view.camera.matrix,
    }


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("name", help="NAME.mcap and NAME.gt.mcap")
    parser.add_argument("--every", type=int, default=4)
    parser.add_argument("--out", type=Path, required=True)
    arguments = parser.parse_args()
    settings = with_pictures(IrsdConfig())
    decoder, sync = SensorDecoder(settings.ingest), Synchronizer(settings.sync)
    mapper = Mapper(settings.pipeline.mapping)
    truth = truth_ids(arguments.folder / f"{arguments.name}.gt.mcap")
    rows: list[dict[str, np.ndarray]] = []
    seen = 0

    def take(frames) -> None:  # type: ignore[no-untyped-def]
        nonlocal seen
        for frame in frames:
            mapper.integrate(frame)
            for view in frame.views:
                if view.image is None or view.stamp_ns not in truth:
                    continue
                seen += 1
                if seen % arguments.every == 0:
                    rows.append({**kept(view, mapper, settings), "thing": truth[view.stamp_ns]})

    for message in read_messages([arguments.folder / f"{arguments.name}.mcap"]):
        for sensed in decoder.decode(message.topic, message.data):
            sync.push(sensed)
        take(sync.pop())
    take(sync.flush())
    document = json.loads((arguments.folder / "ground_truth.json").read_text())
    top = max(instance["id"] for instance in document["instances"])
    names, structural = [""] * top, np.zeros(top + 1, np.bool_)
    for instance in document["instances"]:
        names[instance["id"] - 1] = instance["label"]
        structural[instance["id"]] = instance["structural"]
    out = {key: np.stack([row[key] for row in rows]) for key in ("pose", "matrix")}
    for key in ("jpeg", "pixel", "thing"):
        out[key] = np.concatenate([row[key] for row in rows])
        out[f"{key}_len"] = np.array([len(row[key]) for row in rows])  # packed one behind the other
    np.savez_compressed(arguments.out, names=np.array(names), structural=structural, **out)
    print(f"{len(rows)} pictures of {seen}")


if __name__ == "__main__":
    main()
