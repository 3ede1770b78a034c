"""Train the image encoder on rendered rooms; goes on from its last checkpoint.

python -m training.train_image --data DIR --val DIR --out image.pt [--minutes 45] [--seed 0]

The rate follows a cosine over the minutes of training. Names: all that the furniture makers and the
catalogues give; the loss is cross-entropy over the cosines to the mean vector of each name's words.
"""

from __future__ import annotations

import argparse
import copy
import math
import time
from pathlib import Path

import numpy as np
import torch

from irsd.perception.encoder import LabelEncoder
from training import sweethome
from training.furniture import collection
from training.image_net import ImageNet, Names, examples
from training.render_data import Frame, Frames

_FRAMES, _RATE = 10, 2e-3


def all_names(frames: list[Frame]) -> list[str]:
    """Of the makers and the catalogues, and what else is in the pictures (some makers give more names than one)."""
    catalogued = {"sh3d:" + e.name for e in sweethome.entries() if e.category not in sweethome.OUTDOORS}
    return sorted({*collection.names(), *catalogued, *(name for frame in frames for name in frame.names)})


def batch_of(frames: Frames, names: Names, rng: np.random.Generator) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Crops, measures and numbers of names of the things in a few frames."""
    rows = [examples(frames.frames[k], rng) for k in rng.integers(0, len(frames.frames), _FRAMES)]
    number = torch.tensor([names.number[name] for row in rows for name in row[2]])
    return (
        torch.from_numpy(np.concatenate([r[0] for r in rows])),
        torch.from_numpy(np.concatenate([r[1] for r in rows])),
        number,
    )


def held_out(net: ImageNet, frames: Frames, names: Names) -> tuple[float, float]:
    """(top-1, top-5) among all names, on rendered rooms that are not trained on; names alike count as right."""
    rng, hits = np.random.default_rng(0), []
    net.eval()
    for _ in range(25):
        crops, measures, number = batch_of(frames, names, rng)
        with torch.no_grad():
            order = (net(crops, measures) @ names.vectors.T).argsort(1, descending=True)[:, :5]
        right = (order == number[:, None]) | names.alike[number].gather(1, order)
        hits.append(torch.stack([right[:, 0], right.any(1)], 1))
    one, five = torch.cat(hits).float().mean(0).tolist()
    return one, five


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--val", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--minutes", type=float, default=45)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    torch.manual_seed(arguments.seed)
    frames, val = Frames(arguments.data), Frames(arguments.val)
    names = Names(all_names(frames.frames + val.frames), LabelEncoder.load())
    net = ImageNet().to(memory_format=torch.channels_last)
    average = copy.deepcopy(net)
    optimiser = torch.optim.AdamW(net.parameters(), _RATE, weight_decay=0.05)
    step, spent = 0, 0.0
    if arguments.out.exists():
        state = torch.load(arguments.out)
        net.load_state_dict(state["net"])
        average.load_state_dict(state["average"])
        optimiser.load_state_dict(state["optimiser"])
        step, spent = state["step"], state["spent"]
    rng = np.random.default_rng([arguments.seed, step])
    total, recent, began, saved, looked = arguments.minutes * 60, [], time.monotonic(), spent, spent
    while spent < total:
        rate = _RATE * min(1.0, (step + 1) / 60) * (0.02 + 0.98 * 0.5 * (1 + math.cos(math.pi * min(spent / total, 1))))
        for group in optimiser.param_groups:
            group["lr"] = rate
        crops, measures, number = batch_of(frames, names, rng)
        net.train()
        value = names.loss(net(crops.to(memory_format=torch.channels_last), measures), number)
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
            scored = ""
            if spent - looked > 500 or spent >= total:
                looked = spent
                scored = ", held out top-1 {:.3f} top-5 {:.3f}".format(*held_out(average, val, names))
            print(
                f"step {step} {spent / 60:.1f} min: loss {np.mean(recent):.3f}, {len(frames.frames)} frames{scored}",
                flush=True,
            )
            recent.clear()


if __name__ == "__main__":
    main()
