"""Train the shape encoder: clouds of furniture to the text encoder's space. Resumes from its last epoch.

python -m training.train_shape --data ROWS.npz.. --out shape.pt [--epochs 12] [--threads 1] [--evaluate DIR] [--export DIR]

The network is PointNet with one exchange between local and whole (Qi et al., CVPR 2017), its last layer in the space of
all-MiniLM-L6-v2; the loss is cross-entropy over the cosines to the vectors of all names, a tenth of it spread over names that mean
nearly the same.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
import torch
from torch import nn

from irsd.perception.encoder import DIMENSION, LabelEncoder
from irsd.perception.shape import MEASURES, POINTS
from training.export import export_onnx
from training.names import words
from training.score_shape import house_clouds
from training.scoring import ranks

_SCALE = 20.0  # of the cosines in the loss
_BATCH = 256
_SEEN = 128  # points of a cloud per step: half the cost, and no cloud looks the same twice


class ShapeNet(nn.Module):
    """points [B, N, 4] and measures [B, MEASURES] to unit vectors [B, 384]; the measures are standardised inside."""

    def __init__(self, mean: torch.Tensor, spread: torch.Tensor) -> None:
        super().__init__()
        self.register_buffer("mean", mean)
        self.register_buffer("spread", spread)
        self.near = nn.Sequential(nn.Linear(4, 48), nn.ReLU(), nn.Linear(48, 64), nn.ReLU())
        self.wide = nn.Sequential(nn.Linear(64, 96), nn.ReLU(), nn.Linear(96, 224), nn.ReLU())
        self.context = nn.Linear(64 + MEASURES, 96)  # of the whole, added to each point
        self.head = nn.Sequential(
            nn.BatchNorm1d(448 + MEASURES), nn.Dropout(0.1), nn.Linear(448 + MEASURES, 320), nn.BatchNorm1d(320), nn.ReLU(),
            nn.Dropout(0.2), nn.Linear(320, 256), nn.BatchNorm1d(256), nn.ReLU(), nn.Linear(256, DIMENSION),
        )  # fmt: skip

    def forward(self, points: torch.Tensor, measures: torch.Tensor) -> torch.Tensor:
        scaled = (measures - self.mean) / self.spread
        each = self.near(points)
        whole = self.context(torch.cat([each.max(1).values, scaled], -1))
        each = self.wide[3](self.wide[2](self.wide[1](self.wide[0](each) + whole[:, None])))
        pooled = torch.cat([each.max(1).values, each.mean(1), scaled], -1)
        return nn.functional.normalize(self.head(pooled), dim=-1)


def load(paths: list[Path], encoder: LabelEncoder) -> tuple[torch.Tensor, torch.Tensor, np.ndarray]:
    """Points [n, POINTS, 4], measures [n, MEASURES] and canonical names [n] of the files that ``shape_set`` wrote."""
    points, measures, names = [], [], []
    for path in paths:
        with np.load(path) as data:
            points.append(torch.from_numpy(data["points"]))
            measures.append(torch.from_numpy(data["measures"]))
            names.append(data["name"])
    plain = {
        str(n): str(n) if not str(n).startswith("sh3d:") else encoder.aliases.canonical(str(n)[5:].lower())
        for n in np.unique(np.concatenate(names))
    }
    return torch.cat(points), torch.cat(measures), np.array([plain[str(n)] for n in np.concatenate(names)])


def name_vectors(names: np.ndarray, encoder: LabelEncoder) -> torch.Tensor:
    """[n, 384] unit: the name's own vector and, half as much, the mean over what else people call it."""
    rows = []
    for name in names:
        vectors = encoder.encode(words(str(name)))
        rows.append(vectors[0] + 0.5 * vectors.mean(0))
    vectors = np.stack(rows)
    return torch.from_numpy(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, nargs="+", required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--epochs", type=int, default=12)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument(
        "--evaluate", type=Path, help="folder of a recording with ground truth; printed, never trained on"
    )
    parser.add_argument("--export", type=Path, help="folder for shape_encoder.onnx")
    arguments = parser.parse_args()
    torch.manual_seed(0)
    torch.set_num_threads(arguments.threads)
    encoder = LabelEncoder.load()
    points, measures, name = load(arguments.data, encoder)
    names, target = np.unique(name, return_inverse=True)
    vectors, goal = name_vectors(names, encoder), torch.from_numpy(target)
    trained = len(points) - len(points) // 20  # the last buildings are for the calibration
    held = (points[trained:], measures[trained:], goal[trained:])
    points, measures, goal = points[:trained], measures[:trained], goal[:trained]
    counts = np.maximum(np.bincount(target[:trained], minlength=len(names)), 1)
    weight = torch.from_numpy((counts.mean() / counts) ** 0.3).float()
    net = ShapeNet(measures.mean(0), measures.std(0) + 1e-3)
    optimiser = torch.optim.AdamW(net.parameters(), 1e-3, weight_decay=0.02)
    per_epoch = len(points) // _BATCH
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, 2.5e-3, total_steps=arguments.epochs * per_epoch + 1)
    first = 0
    if arguments.out.exists():
        state = torch.load(arguments.out)
        net.load_state_dict(state["net"])
        if state["epochs"] == arguments.epochs and state["rows"] == len(points):
            optimiser.load_state_dict(state["optimiser"])
            schedule.load_state_dict(state["schedule"])
            first = state["epoch"]
    house = house_clouds(arguments.evaluate) if arguments.evaluate else None
    for epoch in range(first, arguments.epochs):
        net.train()
        loss = _epoch(net, points, measures, goal, vectors, weight, optimiser, schedule)
        state = {
            "net": net.state_dict(), "optimiser": optimiser.state_dict(), "schedule": schedule.state_dict(),
            "epoch": epoch + 1, "epochs": arguments.epochs, "rows": len(points),
        }  # fmt: skip
        torch.save(state, arguments.out)
        net.eval()
        scored = ""
        if house:
            with torch.no_grad():
                embedded = net(torch.from_numpy(house.points), torch.from_numpy(house.measures)).numpy()
            rank = ranks(embedded, house.labels, house.names, encoder.encode(house.names))
            scored = f", top-1 {(rank < 1).mean():.3f}, top-5 {(rank < 5).mean():.3f} of {len(rank)}"
        print(f"epoch {epoch + 1}: loss {loss:.3f}{scored}", flush=True)
    net.eval()
    if arguments.export:
        feeds = (torch.zeros(2, POINTS, 4), torch.zeros(2, MEASURES))
        export_onnx(net, feeds, ("points", "measures"), ("embedding",), arguments.export / "shape_encoder.onnx")
        calibration = calibrated(net, *held, vectors)
        (arguments.export / "shape_encoder.json").write_text(json.dumps(calibration) + "\n")
        print(calibration)


def calibrated(
    net: ShapeNet, points: torch.Tensor, measures: torch.Tensor, goal: torch.Tensor, vectors: torch.Tensor
) -> dict[str, float]:
    """The scale at which probabilities over all names of the training fit best, and the least probability of a best name at which such a
    name is right as often as not, on buildings that were not trained on."""
    with torch.no_grad():
        cosine = (
            torch.cat([net(p.float(), m) for p, m in zip(points.split(512), measures.split(512), strict=True)])
            @ vectors.T
        )
    scales = [float(v) for v in np.geomspace(8, 80, 25)]
    losses = [float(nn.functional.cross_entropy(cosine * scale, goal)) for scale in scales]
    scale = scales[int(np.argmin(losses))]
    best, found = (cosine * scale).softmax(1).max(1)
    right = (found == goal).float()
    order = best.argsort()
    width = max(len(order) // 20, 1)
    smooth = np.convolve(right[order].numpy(), np.ones(width) / width, mode="valid")
    known = np.flatnonzero(smooth >= 0.5)
    least = float(best[order][known[0] + width // 2]) if len(known) else 0.5
    return {"scale": round(scale, 2), "min_probability": round(least, 3), "right": round(float(right.mean()), 3)}


def _epoch(net, points, measures, goal, vectors, weight, optimiser, schedule) -> float:  # type: ignore[no-untyped-def]
    """One pass in random order, with both plan axes turned at random, noise, other sizes, and fewer points; the mean loss."""
    alike = nn.functional.softmax(_SCALE * vectors @ vectors.T, -1)
    order, total, count = torch.randperm(len(points)), 0.0, 0
    for start in range(0, len(order) - _BATCH + 1, _BATCH):
        batch = order[start : start + _BATCH]
        cloud = points[batch][:, torch.randperm(POINTS)[:_SEEN]].float()
        cloud[:, :, :2] *= torch.randint(0, 2, (_BATCH, 1, 2)) * 2 - 1
        cloud += torch.randn_like(cloud) * 0.008
        measure = measures[batch] + torch.randn(_BATCH, MEASURES) * 0.04 * net.spread
        cosine = net(cloud, measure) @ vectors.T
        wanted = 0.9 * nn.functional.one_hot(goal[batch], len(vectors)) + 0.1 * alike[goal[batch]]
        each = -(wanted * nn.functional.log_softmax(cosine * _SCALE, -1)).sum(-1)
        loss = (each * weight[goal[batch]]).sum() / weight[goal[batch]].sum()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        schedule.step()
        total, count = total + loss.item(), count + 1
    return total / max(count, 1)


if __name__ == "__main__":
    main()
