"""Take trained float networks into the pack: int8 where it agrees with float, float where it doesn't.

python -m training.pack --float DIR --shape-rows ROWS.npz --structure-rows ROWS.npz --out irsd/models/nano

Weights of matrix products get 7 bits, so that machines without VNNI, which add products in 16 bits, give the same answers. A network is shipped in
int8 when at most two answers in a hundred differ in being right from those of its float twin, on buildings that were not trained on, and when it
gets much smaller: int8 arithmetic takes its scale from all that is run together, which is a price.
"""

from __future__ import annotations

import argparse
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np

from irsd.perception.encoder import LabelEncoder
from irsd.perception.models import Session
from training.export import quantise

_LOSS = 0.02
_GAIN_BYTES = 500_000
Right = Callable[[Session], float]


def packed(name: str, folder: Path, out: Path, right: Right) -> None:
    """Writes out/NAME.onnx from folder/NAME.onnx; says what was measured."""
    whole, small, target = folder / f"{name}.onnx", folder / f"{name}.int8.onnx", out / f"{name}.onnx"
    quantise(whole, small)
    before, after = (right(Session(path)) for path in (whole, small))
    worth = whole.stat().st_size - small.stat().st_size > _GAIN_BYTES
    chosen = small if before - after <= _LOSS and worth else whole
    shutil.copyfile(chosen, target)
    print(f"{name}: float {before:.4f}, int8 {after:.4f}: {chosen.name}, {target.stat().st_size / 1024:.0f} KiB")


def shape_right(rows: Path) -> Right:
    """Share of the last clouds whose own name is the first of all names."""
    labels = LabelEncoder.load()
    with np.load(rows) as data:
        count = len(data["name"]) // 20
        points, measures = data["points"][-count:].astype(np.float32), data["measures"][-count:]
        plain = {
            n: labels.aliases.canonical(n[5:].lower()) if n.startswith("sh3d:") else n
            for n in map(str, np.unique(data["name"]))
        }
        names = np.array([plain[str(n)] for n in data["name"]])
    known, target = np.unique(names, return_inverse=True)
    vectors = labels.encode(known.tolist())

    def right(session: Session) -> float:
        found = []
        for k in range(0, count, 256):
            (embedding,) = session.run(
                {"points": points[k : k + 256], "measures": measures[k : k + 256]}, ("embedding",)
            )
            found.append((embedding @ vectors.T).argmax(1))
        return float((np.concatenate(found) == target[-count:]).mean())

    return right


def structure_right(rows: Path) -> Right:
    """Share of the voxels of every tenth building whose class is right."""
    with np.load(rows) as data:
        held = data["owner"] % 10 == 9
        features, classes = data["features"][held].astype(np.float32), data["classes"][held]

    def right(session: Session) -> float:
        (logits,) = session.run({"features": features}, ("logits",))
        return float((logits.argmax(1) == classes).mean())

    return right


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--float", type=Path, required=True)
    parser.add_argument("--shape-rows", type=Path)
    parser.add_argument("--structure-rows", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    arguments = parser.parse_args()
    if arguments.shape_rows:
        packed("shape_encoder", arguments.float, arguments.out, shape_right(arguments.shape_rows))
        shutil.copyfile(arguments.float / "shape_encoder.json", arguments.out / "shape_encoder.json")
    if arguments.structure_rows:
        packed("structure", arguments.float, arguments.out, structure_right(arguments.structure_rows))


if __name__ == "__main__":
    main()
