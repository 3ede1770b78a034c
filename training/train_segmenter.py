"""Train the segmenter on rendered rooms; goes on from its last checkpoint.

python -m training.train_segmenter --data DIR --out segmenter.pt [--minutes 60] [--seed 0]

The rate follows a cosine over the minutes of training (not of waiting), so that a slower machine ends in time with fewer steps; the
folder may still be growing. Kept are the weights and their moving average, which is what is exported.
"""

from __future__ import annotations

import argparse
import copy
import math
import time
from pathlib import Path

import numpy as np
import torch

from training.render_data import Frames
from training.segment_net import SegmentNet, example, loss, placed, targets

BATCH = 8
_RATE = 2.5e-3


def batch_of(frames: Frames, rng: np.random.Generator) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    rows = []
    for k in rng.integers(0, len(frames.frames), BATCH):
        image, shown, thing, down, across = example(frames.frames[k], rng)
        rows.append((image, shown, targets(thing), down, across))
    image, shown, target, down, across = (
        torch.from_numpy(np.ascontiguousarray(np.stack(part))) for part in zip(*rows, strict=True)
    )
    return image.float() / 255, placed(shown, down, across), target


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--minutes", type=float, default=60)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    torch.manual_seed(arguments.seed)
    frames = Frames(arguments.data)
    net = SegmentNet().to(memory_format=torch.channels_last)
    average = copy.deepcopy(net)
    optimiser = torch.optim.AdamW(net.parameters(), _RATE, weight_decay=0.02)
    step, spent = 0, 0.0
    if arguments.out.exists():
        state = torch.load(arguments.out)
        net.load_state_dict(state["net"])
        average.load_state_dict(state["average"])
        optimiser.load_state_dict(state["optimiser"])
        step, spent = state["step"], state["spent"]
    rng = np.random.default_rng([arguments.seed, step])
    total, recent, began = arguments.minutes * 60, [], time.monotonic()
    saved = spent
    while spent < total:
        rate = _RATE * min(1.0, (step + 1) / 60) * (0.02 + 0.98 * 0.5 * (1 + math.cos(math.pi * min(spent / total, 1))))
        for group in optimiser.param_groups:
            group["lr"] = rate
        image, shown, target = batch_of(frames, rng)
        net.train()
        value = loss(net(image.to(memory_format=torch.channels_last), shown), target)
        optimiser.zero_grad()
        value.backward()
        torch.nn.utils.clip_grad_norm_(net.parameters(), 5.0)
        optimiser.step()
        step += 1
        keep = min(0.995, (step + 1) / (step + 10))
        with torch.no_grad():
            for mine, theirs in zip(average.state_dict().values(), net.state_dict().values(), strict=True):
                mine.lerp_(theirs, 1 - keep) if mine.dtype.is_floating_point else mine.copy_(theirs)
        recent.append(float(value.detach()))
        now = time.monotonic()
        spent, began = spent + now - began, now
        if spent - saved > 90 or spent >= total:
            saved = spent
            state = {"net": net.state_dict(), "average": average.state_dict(), "optimiser": optimiser.state_dict()}
            torch.save(state | {"step": step, "spent": spent}, arguments.out)
            print(
                f"step {step} {spent / 60:.1f} min: loss {np.mean(recent):.3f}, {len(frames.frames)} frames", flush=True
            )
            recent.clear()
            frames.refresh()


if __name__ == "__main__":
    main()
