"""Train the structure network: voxels of generated buildings' maps to other, wall, floor, ceiling, door, window.

python -m training.train_structure --scenes DIR.. --rows structure_rows.npz --out structure.pt [--export DIR] [--held-map MAP.npz]

The rows (features of a sample of voxels, block by block as the product cuts them) are made once. Resumes from its last epoch.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from irsd.core.types import MapBlock, Structure
from irsd.mapping.network import NetworkSettings
from irsd.perception.structure_features import FEATURES, structure_features
from training.export import export_onnx
from training.score_structure import table

_BATCH = 4096
_OF_BLOCK = 4000  # voxels taken of a block
_OF_RARE = 300  # doors and windows beside them at most, each


def block_of(arrays: dict[str, NDArray], rows: NDArray[np.integer]) -> MapBlock:  # type: ignore[type-arg]
    """Voxels of a file of ``scene``, as the map gives them."""
    points, levels = arrays["points"][rows], arrays["levels"][rows].astype(np.float32)
    surface = points + arrays["surface"][rows].astype(np.float32)
    return MapBlock(points, arrays["normals"][rows].astype(np.float32), surface, levels, arrays["geometry"][rows])


def rows_of(path: Path, rng: np.random.Generator) -> tuple[NDArray[np.float16], NDArray[np.uint8]]:
    """Features [n, FEATURES] and classes [n] of a building: a block about the robot's last place and one about another."""
    limits = NetworkSettings()
    features, classes = [np.zeros((0, FEATURES), np.float16)], [np.zeros(0, np.uint8)]
    with np.load(path) as data:
        for shot in range(int(data["shots"])):
            arrays = {
                k: data[f"{k}_{shot}"] for k in ("points", "normals", "surface", "levels", "geometry", "truth", "base")
            }
            points = arrays["points"]
            for base in (arrays["base"], points[rng.integers(len(points))] * np.float32([1, 1, 0])):
                rows = np.flatnonzero((np.abs(points - base) <= limits.block_m / 2).all(1))
                step = max(-(-len(rows) // limits.max_points), 1)
                rows = rows[int(rng.integers(step)) :: step]
                if len(rows) < 500:
                    continue
                truth = arrays["truth"][rows]
                found = structure_features(block_of(arrays, rows))
                rare = [
                    rng.permutation(np.flatnonzero(truth == k))[:_OF_RARE] for k in (Structure.DOOR, Structure.WINDOW)
                ]
                chosen = np.unique(
                    np.concatenate([*rare, rng.choice(len(rows), min(_OF_BLOCK, len(rows)), replace=False)])
                )
                features.append(found[chosen].astype(np.float16))
                classes.append(truth[chosen])
    return np.concatenate(features), np.concatenate(classes)


class StructureNet(nn.Module):
    """features [N, FEATURES] to logits [N, 6]; standardised inside."""

    def __init__(self, mean: torch.Tensor, spread: torch.Tensor) -> None:
        super().__init__()
        self.register_buffer("mean", mean)
        self.register_buffer("spread", spread)
        self.layers = nn.Sequential(
            nn.Linear(FEATURES, 160),
            nn.ReLU(),
            nn.Dropout(0.1),
            nn.Linear(160, 96),
            nn.ReLU(),
            nn.Dropout(0.1),
            nn.Linear(96, 64),
            nn.ReLU(),
            nn.Linear(64, 6),
        )

    def forward(self, features: torch.Tensor) -> torch.Tensor:
        return self.layers(((features - self.mean) / self.spread).clamp(-5, 5))


def collect(scenes: list[Path], cache: Path) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Features, classes and building numbers of all buildings; kept in a file."""
    paths = sorted(p for folder in scenes for p in folder.glob("scene_*.npz") if ".part" not in p.name)
    if not cache.exists():
        rng = np.random.default_rng(0)
        parts = [rows_of(path, rng) for path in paths]
        owner = np.repeat(np.arange(len(parts)), [len(c) for _, c in parts])
        np.savez(
            cache,
            features=np.concatenate([f for f, _ in parts]),
            classes=np.concatenate([c for _, c in parts]),
            owner=owner,
        )
    with np.load(cache) as data:
        return tuple(torch.from_numpy(data[k]) for k in ("features", "classes", "owner"))  # type: ignore[return-value]


def map_score(net: StructureNet, path: Path) -> dict[str, float]:
    """On a whole map with truth (255 = none), block by block."""
    with np.load(path) as data:
        arrays = {k: data[k] for k in ("points", "normals", "surface", "levels", "geometry", "truth")}
    arrays["surface"] = arrays["surface"] - arrays["points"]
    found = np.full(len(arrays["truth"]), 255, np.uint8)
    place = np.floor(arrays["points"][:, :2] / 7).astype(int)
    for cell in np.unique(place, axis=0):
        rows = np.flatnonzero((place == cell).all(1))
        step = max(-(-len(rows) // 30_000), 1)
        for k in range(step):
            part = rows[k::step]
            with torch.no_grad():
                found[part] = net(torch.from_numpy(structure_features(block_of(arrays, part)))).argmax(1).numpy()
    known = arrays["truth"] < 255
    return table(found[known], arrays["truth"][known])


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=Path, nargs="+", required=True)
    parser.add_argument("--rows", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--epochs", type=int, default=20)
    parser.add_argument("--held-map", type=Path, help="a map with truth; printed, never trained on")
    parser.add_argument("--export", type=Path, help="folder for structure.onnx")
    arguments = parser.parse_args()
    torch.manual_seed(0)
    torch.set_num_threads(1)
    features, classes, owner = collect(arguments.scenes, arguments.rows)
    held = owner % 10 == 9
    train = torch.nonzero(~held)[:, 0]
    sample = features[train[torch.randperm(len(train))[:200_000]]].float()
    net = StructureNet(sample.mean(0), sample.std(0) + 1e-2)
    optimiser = torch.optim.AdamW(net.parameters(), 2e-3, weight_decay=0.01)
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimiser, 4e-3, total_steps=arguments.epochs * (len(train) // _BATCH) + 1
    )
    first = 0
    if arguments.out.exists():
        state = torch.load(arguments.out)
        if state["epochs"] == arguments.epochs and state["rows"] == len(features):
            for part, key in ((net, "net"), (optimiser, "optimiser"), (schedule, "schedule")):
                part.load_state_dict(state[key])
            first = state["epoch"]
    for epoch in range(first, arguments.epochs):
        net.train()
        order, total = train[torch.randperm(len(train))], 0.0
        for start in range(0, len(order) - _BATCH + 1, _BATCH):
            rows = order[start : start + _BATCH]
            loss = nn.functional.cross_entropy(net(features[rows].float()), classes[rows].long(), label_smoothing=0.02)
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            schedule.step()
            total += loss.item()
        net.eval()
        with torch.no_grad():
            scored = table(net(features[held].float()).argmax(1).numpy().astype(np.uint8), classes[held].numpy())
        print(
            f"epoch {epoch + 1}: loss {total / (len(order) // _BATCH):.4f}, held-out buildings",
            _text(scored),
            flush=True,
        )
        if arguments.held_map and (epoch % 5 == 4 or epoch + 1 == arguments.epochs):
            print("  map", _text(map_score(net, arguments.held_map)), flush=True)
        torch.save(
            {
                "net": net.state_dict(),
                "optimiser": optimiser.state_dict(),
                "schedule": schedule.state_dict(),
                "epoch": epoch + 1,
                "epochs": arguments.epochs,
                "rows": len(features),
            },
            arguments.out,
        )
    net.eval()
    if arguments.export:
        export_onnx(
            net.eval(), (torch.zeros(2, FEATURES),), ("features",), ("logits",), arguments.export / "structure.onnx"
        )


def _text(scores: dict[str, float]) -> str:
    return ", ".join(f"{name} {value:.3f}" for name, value in scores.items())


if __name__ == "__main__":
    main()
