"""Train the shape encoder: clouds of furniture to the text encoder's space. Resumes from its last epoch.

python -m training.train_shape --data A.npz B.npz --out shape.pt [--epochs 12] [--threads 2] [--evaluate DIR]

The network is PointNet with one exchange between local and whole (Qi et al., CVPR 2017), its last layer in the space of
all-MiniLM-L6-v2; the loss is cross-entropy over the cosines to the mean vector of each name's words.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
import torch
from torch import nn

from irsd.perception.encoder import DIMENSION, LabelEncoder
from training.names import words
from training.shape_data import POINTS
from training.shape_features import MEASURES, aligned

_SCALE = 20.0  # of the cosines in the loss
_BATCH = 256


def _block(inputs: int, outputs: int) -> nn.Module:
    return nn.Sequential(nn.Linear(inputs, outputs), nn.LayerNorm(outputs), nn.GELU())


class ShapeNet(nn.Module):
    """points [B, N, 4] and measures [B, 9] to unit vectors [B, 384]; the measures are standardised inside."""

    def __init__(self, mean: torch.Tensor, spread: torch.Tensor) -> None:
        super().__init__()
        self.register_buffer("mean", mean)
        self.register_buffer("spread", spread)
        self.near = nn.Sequential(_block(4 + MEASURES, 64), _block(64, 64))
        self.wide = nn.Sequential(_block(128, 128), _block(128, 256))
        self.head = nn.Sequential(
            _block(512 + MEASURES, 256), nn.Dropout(0.2), _block(256, 256), nn.Linear(256, DIMENSION)
        )

    def forward(self, points: torch.Tensor, measures: torch.Tensor) -> torch.Tensor:
        scaled = (measures - self.mean) / self.spread
        each = self.near(torch.cat([points, scaled[:, None].expand(-1, points.shape[1], -1)], -1))
        whole = each.max(1, keepdim=True).values.expand_as(each)
        each = self.wide(torch.cat([each, whole], -1))
        pooled = torch.cat([each.max(1).values, each.mean(1), scaled], -1)
        return nn.functional.normalize(self.head(pooled), dim=-1)


def load(paths: list[Path]) -> tuple[torch.Tensor, torch.Tensor, np.ndarray]:
    """Points [n, 256, 4], measures [n, 9] and names [n] of the files that ``shape_data`` wrote."""
    rows, names = [], []
    for path in paths:
        with np.load(path) as data:
            rows += [aligned(p.astype(np.float32), int(n)) for p, n in zip(data["points"], data["size"], strict=True)]
            names.append(data["name"])
    points, measures = (torch.from_numpy(np.stack(part)) for part in zip(*rows, strict=True))
    return points, measures, np.concatenate(names)


def name_vectors(names: np.ndarray, encoder: LabelEncoder) -> torch.Tensor:
    """[n, 384] unit: the mean over each name's words."""
    vectors = np.stack([encoder.encode(words(str(name))).mean(0) for name in names])
    return torch.from_numpy(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))


def score(net: ShapeNet, folder: Path, encoder: LabelEncoder) -> tuple[float, float, int]:
    """(top-1, top-5, instances) on a recording's ground truth: instances.npz and ground_truth.json, names of that scene."""
    truth = json.loads((folder / "ground_truth.json").read_text())
    with np.load(folder / "instances.npz") as cloud:
        xyz, owner = cloud["xyz"], cloud["instance"]
    rng = np.random.default_rng(0)
    rows, labels = [], []
    for instance in truth["instances"]:
        points = xyz[owner == instance["id"]]
        if instance["structural"] or not instance["observable"] or len(points) < 4:
            continue
        for _ in range(4):
            chosen = rng.choice(len(points), POINTS, replace=len(points) < POINTS)
            rows.append(aligned(points[chosen], len(points)))
        labels.append(instance["label"])
    points, measures = (torch.from_numpy(np.stack(part)) for part in zip(*rows, strict=True))
    names = sorted(set(labels))
    net.eval()
    with torch.no_grad():
        vectors = net(points, measures).reshape(len(labels), 4, -1).mean(1)
    order = (-(vectors @ torch.from_numpy(encoder.encode(names)).T)).argsort(1).numpy()
    right = order == np.array([names.index(label) for label in labels])[:, None]
    return float(right[:, 0].mean()), float(right[:, :5].any(1).mean()), len(labels)


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, nargs="+", required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--epochs", type=int, default=12)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--evaluate", type=Path, help="folder of a recording with ground truth; never trained on")
    arguments = parser.parse_args()
    torch.manual_seed(0)
    torch.set_num_threads(arguments.threads)
    encoder = LabelEncoder.load()
    points, measures, name = load(arguments.data)
    names, target = np.unique(name, return_inverse=True)
    vectors, goal = name_vectors(names, encoder), torch.from_numpy(target)
    net = ShapeNet(measures.mean(0), measures.std(0) + 1e-3)
    optimiser = torch.optim.AdamW(net.parameters(), 1e-3, weight_decay=0.02)
    per_epoch = len(points) // _BATCH
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, 2e-3, total_steps=arguments.epochs * per_epoch + 1)
    first = 0
    if arguments.out.exists():
        state = torch.load(arguments.out)
        net.load_state_dict(state["net"])
        optimiser.load_state_dict(state["optimiser"])
        schedule.load_state_dict(state["schedule"])
        first = state["epoch"]
    for epoch in range(first, arguments.epochs):
        net.train()
        loss = _epoch(net, points, measures, goal, vectors, optimiser, schedule)
        state = {
            "net": net.state_dict(),
            "optimiser": optimiser.state_dict(),
            "schedule": schedule.state_dict(),
            "epoch": epoch + 1,
        }
        torch.save(state, arguments.out)
        found = score(net, arguments.evaluate, encoder) if arguments.evaluate else None
        scored = f", top-1 {found[0]:.3f}, top-5 {found[1]:.3f} of {found[2]}" if found else ""
        print(f"epoch {epoch + 1}: loss {loss:.3f}{scored}", flush=True)  # noqa: T201


def _epoch(net, points, measures, goal, vectors, optimiser, schedule) -> float:  # type: ignore[no-untyped-def]
    """One pass in random order, with both plan axes turned at random, noise, and fewer points; the mean loss."""
    order, total, count = torch.randperm(len(points)), 0.0, 0
    for start in range(0, len(order) - _BATCH + 1, _BATCH):
        batch = order[start : start + _BATCH]
        kept = torch.randperm(POINTS)[: int(torch.randint(POINTS // 2, POINTS, ()))]
        cloud = points[batch][:, kept]
        cloud[:, :, :2] *= torch.randint(0, 2, (_BATCH, 1, 2)) * 2 - 1
        cloud += torch.randn_like(cloud) * 0.008
        measure = measures[batch] + torch.randn(_BATCH, MEASURES) * 0.05 * net.spread
        cosine = net(cloud, measure) @ vectors.T
        loss = nn.functional.cross_entropy(cosine * _SCALE, goal[batch], label_smoothing=0.05)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        schedule.step()
        total, count = total + loss.item(), count + 1
    return total / max(count, 1)


if __name__ == "__main__":
    main()
