"""Train the segmenter on rendered rooms; goes on from its last checkpoint.

python -m training.train_segmenter --data DIR --out segmenter.pt [--steps 14000] [--seed 0]
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import torch

from training.loop import train
from training.render_data import Frames
from training.segment_net import SegmentNet, example, loss, placed, targets

BATCH = 8
_RATE = 2.5e-3


def batch_of(frames: Frames, rng: np.random.Generator) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    rows = []
    for k in rng.integers(0, len(frames.frames), BATCH):
        image, shown, thing, part, down, across = example(frames.frames[k], rng)
        rows.append((image, shown, targets(thing, part), down, across))
    image, shown, target, down, across = (
        torch.from_numpy(np.ascontiguousarray(np.stack(part))) for part in zip(*rows, strict=True)
    )
    return image.float() / 255, placed(shown, down, across), target


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--steps", type=int, default=14_000)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    torch.manual_seed(arguments.seed)
    frames = Frames(arguments.data)

    def loss_of(net: torch.nn.Module, rng: np.random.Generator) -> torch.Tensor:
        image, shown, target = batch_of(frames, rng)
        with torch.autocast("cpu", dtype=torch.bfloat16):
            heads = net(image.to(memory_format=torch.channels_last), shown)
        return loss(heads.float(), target)

    net = SegmentNet().to(memory_format=torch.channels_last)
    train(net, loss_of, arguments.out, steps=arguments.steps, rate=_RATE, decay=0.02, seed=arguments.seed)


if __name__ == "__main__":
    main()
