"""Score a small COCO detector on the rendered frames of the small house, and print the table per class.

    python benchmarks/detector.py [--model ../shared/data/models/nanodet_m.onnx] [--data ../shared/data/small_house] [--every 4]

The model is a test article trained on photographs, the frames are renderings with simple light: the figures say whether our decoding
works and how far such a detector carries here, not how good it is on a real camera. Truth is the instance image: one box around the
visible pixels of each thing. Things whose name is no class of COCO's are not scored; what COCO's annotators would call by a class that
is scored (a coffee table is a ``dining table`` to them), and things too small to ask for, are neither asked for nor held against a
detection on them.

AP50 is COCO's: boxes of IoU >= 0.5 matched best score first, precision at 101 levels of recall. Recall and precision are those at the
detector's own threshold. Times are of one thread, picture in, boxes out, after class-wise suppression of overlaps at 0.6 as published.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from irsd.perception.aliases import AliasTable
from irsd.perception.families.nanodet import NanoDet
from irsd.perception.kernels import best_boxes
from irsd.perception.models import Session
from irsd.sensors.decode import decode_compressed_image, decode_detection_ids
from irsd.sensors.replay import read_messages

HERE = Path(__file__).resolve().parent
# Names of the world to prompts; and names that count as "could be" for a prompt.
SAME = {
    "bed": "bed",
    "chair": "chair",
    "sofa": "sofa",
    "dining table": "dining table",
    "refrigerator": "refrigerator",
    "television": "television",
    "vase": "vase",
    "exercise ball": "ball",
    "stove": "oven",
}
ALSO = {"coffee table": "dining table", "desk": "dining table", "side table": "dining table", "tablet": "television"}
PROMPTS = tuple(sorted(set(SAME.values())))
MIN_PIXELS, MIN_SIDE_PX = 400, 16
LOW_THRESHOLD = 0.05  # scores below add nothing to AP
NMS_IOU = 0.6


@dataclass(slots=True)
class Tally:
    """One class: (score, hit) of every detection that counts, and how many things there were."""

    scored: list[tuple[float, bool]] = field(default_factory=list)
    truths: int = 0

    def ap50(self) -> float:
        if not self.truths or not self.scored:
            return 0.0
        hit = np.array([h for _, h in sorted(self.scored, key=lambda pair: -pair[0])], float)
        recall = hit.cumsum() / self.truths
        precision = hit.cumsum() / np.arange(1, len(hit) + 1)
        precision = np.maximum.accumulate(precision[::-1])[::-1]
        at = np.searchsorted(recall, np.linspace(0, 1, 101), side="left")
        return float(np.append(precision, 0.0)[at].mean())

    def at(self, threshold: float) -> tuple[float, float]:
        """Recall and precision of the detections above a score."""
        hits = [h for score, h in self.scored if score > threshold]
        return sum(hits) / max(self.truths, 1), sum(hits) / max(len(hits), 1)


def frames(data: Path, every: int) -> Iterator[tuple[NDArray[np.uint8], NDArray[np.uint16]]]:
    """Pictures RGB [H, W, 3] with their instance ids [H, W], every n-th of the recording."""
    name = data.name
    topics = ("/camera/image/compressed", "/gt/instance_ids")
    pictures: dict[int, bytes] = {}
    count = 0
    for message in read_messages([data / f"{name}.mcap", data / f"{name}.gt.mcap"], topics):
        if message.topic == topics[0]:
            pictures[message.log_time_ns] = message.data
            continue
        picture = pictures.pop(message.log_time_ns, None)
        if picture is None:
            raise SystemExit(f"{name}: a truth without its picture at {message.log_time_ns}")
        if count % every == 0:
            rgb = np.ascontiguousarray(decode_compressed_image(picture).bgr[..., ::-1])
            yield rgb, decode_detection_ids(message.data).ids_px
        count += 1


def truth_boxes(ids_px: NDArray[np.uint16], names: dict[int, str]) -> list[tuple[str, NDArray[np.float32], bool]]:
    """(prompt, box, must it be found) of the things in a picture."""
    out = []
    for number in np.unique(ids_px):
        name = names.get(int(number), "")
        prompt = SAME.get(name) or ALSO.get(name)
        if prompt is None:
            continue
        rows, columns = np.nonzero(ids_px == number)
        box = np.array([columns.min(), rows.min(), columns.max() + 1, rows.max() + 1], np.float32)
        large = len(rows) >= MIN_PIXELS and min(box[2] - box[0], box[3] - box[1]) >= MIN_SIDE_PX
        out.append((prompt, box, large and name in SAME))
    return out


def iou(a: NDArray[np.float32], b: NDArray[np.float32]) -> NDArray[np.float32]:
    """[n, m] of boxes [n, 4] and [m, 4]."""
    low = np.maximum(a[:, None, :2], b[None, :, :2])
    high = np.minimum(a[:, None, 2:], b[None, :, 2:])
    both = np.clip(high - low, 0, None).prod(-1)
    area = [(c[:, 2:] - c[:, :2]).prod(-1) for c in (a, b)]
    return np.asarray(both / np.maximum(area[0][:, None] + area[1][None] - both, 1e-9), np.float32)


def score_picture(
    boxes: NDArray[np.float32],
    scores: NDArray[np.float32],
    truths: list[tuple[NDArray[np.float32], bool]],
    tally: Tally,
) -> None:
    """Matches the detections of one class in one picture, best first, each truth once; what lies on a "could be" is left out."""
    tally.truths += sum(wanted for _, wanted in truths)
    overlap = iou(boxes, np.array([box for box, _ in truths], np.float32).reshape(-1, 4))
    free = np.array([wanted for _, wanted in truths], bool)
    optional = ~free
    for row in np.argsort(-scores, kind="stable"):
        candidates = np.where(free, overlap[row], 0)
        if candidates.size and candidates.max() >= 0.5:
            free[candidates.argmax()] = False
            tally.scored.append((float(scores[row]), True))
        elif not (optional.any() and overlap[row][optional].max() >= 0.5):
            tally.scored.append((float(scores[row]), False))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    shared = HERE.parents[1] / "shared" / "data"
    parser.add_argument("--model", type=Path, default=shared / "models" / "nanodet_m.onnx")
    parser.add_argument("--data", type=Path, default=shared / "small_house")
    parser.add_argument("--every", type=int, default=1, help="take every n-th picture")
    parser.add_argument("--threshold", type=float, default=0.35, help="of the columns recall and precision")
    arguments = parser.parse_args()
    if not arguments.model.is_file() or not arguments.data.is_dir():
        print(f"absent: {arguments.model} or {arguments.data}", file=sys.stderr)
        return 2
    truth = json.loads((arguments.data / "ground_truth.json").read_text())
    names = {entry["id"]: entry["label"] for entry in truth["instances"]}
    detector = NanoDet(Session(arguments.model), AliasTable.load(), threshold=LOW_THRESHOLD)
    tallies = {prompt: Tally() for prompt in PROMPTS}
    wall, cpu, count = [], [], 0
    for rgb, ids_px in frames(arguments.data, arguments.every):
        started, cpu_started = time.perf_counter(), time.process_time()
        found = detector.detect(rgb, PROMPTS)
        kept = best_boxes(found.boxes_px, found.scores, found.prompt, NMS_IOU)
        wall.append(time.perf_counter() - started)
        cpu.append(time.process_time() - cpu_started)
        truths = truth_boxes(ids_px, names)
        for number, prompt in enumerate(PROMPTS):
            mine = kept[found.prompt[kept] == number]
            wanted = [(box, must) for name, box, must in truths if name == prompt]
            score_picture(found.boxes_px[mine], found.scores[mine], wanted, tallies[prompt])
        count += 1
    print(f"{count} pictures of {arguments.data.name}, {arguments.model.name}")
    print(
        f"{'class':<14}{'things':>8}{'AP50':>8}{'recall':>8}{'precision':>11}   (recall, precision at {arguments.threshold})"
    )
    for prompt, tally in tallies.items():
        recall, precision = tally.at(arguments.threshold)
        print(f"{prompt:<14}{tally.truths:>8}{tally.ap50():>8.3f}{recall:>8.3f}{precision:>11.3f}")
    scored = [tally for tally in tallies.values() if tally.truths]
    print(f"{'mean':<14}{sum(t.truths for t in scored):>8}{np.mean([t.ap50() for t in scored]):>8.3f}")
    print(
        f"time per picture: {1e3 * np.median(wall):.1f} ms wall, {1e3 * np.median(cpu):.1f} ms CPU (medians, 1 thread)"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
