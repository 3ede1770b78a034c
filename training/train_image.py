"""Train the image encoder on rendered rooms; goes on from its last checkpoint.

python -m training.train_image --data DIR --val DIR --out image.pt [--steps 8000] [--seed 0]

Names: all that the furniture makers and the
catalogues give; the loss is cross-entropy over the cosines to the mean vector of each name's words.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import torch

from irsd.perception.encoder import LabelEncoder
from training import sweethome
from training.furniture import collection
from training.image_net import ImageNet, Names, examples
from training.loop import train
from training.render_data import Frame, Frames

_FRAMES, _RATE = 10, 2e-3
_TOLD = 2000  # steps between looks at rooms held out


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


def held_out(net: torch.nn.Module, frames: Frames, names: Names) -> tuple[float, float]:
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
    parser.add_argument("--steps", type=int, default=8000)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    torch.manual_seed(arguments.seed)
    frames, val = Frames(arguments.data), Frames(arguments.val)
    names = Names(all_names(frames.frames + val.frames), LabelEncoder.load())

    def loss_of(net: torch.nn.Module, rng: np.random.Generator) -> torch.Tensor:
        crops, measures, number = batch_of(frames, names, rng)
        with torch.autocast("cpu", dtype=torch.bfloat16):
            embedding = net(crops.to(memory_format=torch.channels_last), measures)
        return names.loss(embedding.float(), number)

    def told(average: torch.nn.Module, step: int) -> str:
        if step % _TOLD and step != arguments.steps:
            return ""
        return ", held out top-1 {:.3f} top-5 {:.3f}".format(*held_out(average, val, names))

    net = ImageNet().to(memory_format=torch.channels_last)
    steps, seed = arguments.steps, arguments.seed
    train(net, loss_of, arguments.out, steps=steps, rate=_RATE, decay=0.05, seed=seed, told=told)


if __name__ == "__main__":
    main()
