"""Score the segmenter on a recording with truth: class-agnostic AP at IoU .5, with the map's depth and without.

Things of fewer than 400 pixels, doors, windows and carpets are not asked for.
"""

from __future__ import annotations

import time

import numpy as np

from irsd.perception.job import Sight
from irsd.perception.nano_segmenter import NanoSegmenter
from training.average_precision import average_precision, judge
from training.recording_frames import Recorded, frames_of
from training.render_data import sight_of
from training.scoring import Evaluation, Row

LEAST_PX = 400


def measured(recorded: Recorded, model: NanoSegmenter, *, depth: bool) -> tuple[float, float, float]:
    """(AP50, recall, CPU milliseconds a picture); depth False: without the map."""
    judged, spent = [], 0.0
    nothing = Sight(np.zeros((0, 2), np.float32), np.zeros(0, np.float32), np.zeros(0, np.int32), np.zeros(0, np.bool_))
    for frame in recorded.frames:
        rgb, sight = frame.rgb(), sight_of(frame.points, frame.matrix) if depth else nothing
        began = time.process_time()
        found = model.segment_scene(rgb, sight)
        spent += time.process_time() - began
        judged.append(judge(found.masks, found.scores, frame.thing.astype(np.int32), recorded.structural, LEAST_PX))
    return (*average_precision(judged), 1000 * spent / len(recorded.frames))


def score(context: Evaluation) -> list[Row]:
    """The segmenter's rows of the table."""
    recorded, model = frames_of(context.data), NanoSegmenter(context.models / "segmenter.onnx")
    with_map, recall, ms = measured(recorded, model, depth=True)
    without, _, _ = measured(recorded, model, depth=False)
    return [
        Row("segmenter", f"class-agnostic mask AP50 of {len(recorded.frames)} pictures", with_map, 0.35, 0.55),
        Row("segmenter", "recall at IoU .5", recall),
        Row("segmenter", "AP50 without the map's depth", without),
        Row("segmenter", "CPU milliseconds a picture, 1 thread", ms, 40, None, below=True),
    ]
