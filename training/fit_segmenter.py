"""Fit what scores the segmenter's masks, on rendered rooms that the network was not trained on.

python -m training.fit_segmenter --val DIR --model DIR/segmenter.onnx [--every 2]

A region is worth what its IoU with the best thing is: 0 up to .3, 1 from .7. Writes the layers as .json beside the model, fitted on all
pictures; the AP it tells is of a third of them, fitted on the others.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
import torch
from torch import nn

from irsd.perception.models import Session
from irsd.perception.nano_decode import MEASURES, Layers, Regions, chosen, regions_of, score_of
from irsd.perception.nano_map import alone_cells, map_picture
from irsd.perception.nano_segmenter import LEAST_SCORE, MOST_OVER, cell_colours, image_input
from training.average_precision import Judged, average_precision, judge
from training.render_data import Frame, Frames, sight_of

_LEAST_CELLS = 25  # 400 pixels of VGA
_WIDTH, _EPOCHS, _BATCH = 32, 25, 256


def regions(session: Session, frame: Frame) -> Regions:
    """As the product finds them."""
    rgb = frame.rgb()
    sight = sight_of(frame.points, frame.matrix)
    map_, alone = map_picture(sight, rgb.shape[:2]), alone_cells(sight, rgb.shape[:2])
    heads, parts = session.run({"image": image_input(rgb), "map": map_[None]}, ("heads", "parts"))
    return regions_of(heads[0].astype(np.float32), parts[0].astype(np.float32), map_, cell_colours(rgb), alone)


def worth(found: Regions, thing: np.ndarray) -> np.ndarray:
    """What each region should score [n]."""
    size, out = np.bincount(thing.reshape(-1)), np.zeros(len(found.cells), np.float32)
    for p in range(len(found.label)):
        label = found.label[p]
        inside = label >= 0
        both = np.zeros((len(found.cells), len(size)))
        np.add.at(both, (label[inside], thing[inside]), 1)
        iou = both / np.maximum(size[None] + found.cells[:, None] - both, 1)
        mine = found.partition == p
        out[mine] = iou[mine, 1:].max(1, initial=0)
    return np.clip((out - 0.3) / 0.4, 0, 1).astype(np.float32)


def fit(measures: np.ndarray, target: np.ndarray) -> Layers:
    """A perceptron of two hidden layers on standardised measures, the standardising folded into its first."""
    torch.manual_seed(0)
    mean, spread = measures.mean(0), measures.std(0) + 1e-3
    x, y = torch.from_numpy((measures - mean) / spread), torch.from_numpy(target)
    net = nn.Sequential(
        nn.Linear(MEASURES, _WIDTH), nn.ReLU(), nn.Linear(_WIDTH, _WIDTH), nn.ReLU(), nn.Linear(_WIDTH, 1)
    )
    optimiser = torch.optim.AdamW(net.parameters(), 3e-3, weight_decay=0.1)
    for epoch in range(_EPOCHS):
        for group in optimiser.param_groups:
            group["lr"] = 3e-3 * (1 - epoch / _EPOCHS)
        for batch in torch.randperm(len(x)).split(_BATCH):
            value = nn.functional.binary_cross_entropy_with_logits(net(x[batch])[:, 0], y[batch])
            optimiser.zero_grad()
            value.backward()
            optimiser.step()
    layers = [(m.weight.detach().numpy().T, m.bias.detach().numpy()) for m in net if isinstance(m, nn.Linear)]
    weight, bias = layers[0]
    layers[0] = (weight / spread[:, None], bias - (mean / spread) @ weight)
    return tuple(layers)


def judged(found: Regions, thing: np.ndarray, layers: Layers) -> Judged:
    cells, scores = chosen(found, score_of(found.measures, layers), LEAST_SCORE, MOST_OVER)
    masks = cells[None] == np.arange(1, len(scores) + 1)[:, None, None]
    return judge(masks, scores, thing, np.zeros(int(thing.max()) + 1, np.bool_), _LEAST_CELLS)


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--val", type=Path, required=True)
    parser.add_argument("--model", type=Path, required=True)
    parser.add_argument("--every", type=int, default=1, help="of so many pictures one is used")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    frames, session = Frames(arguments.val).frames[:: arguments.every], Session(arguments.model)
    things = [frame.thing[::2, ::2].astype(np.int32) for frame in frames]
    found = [regions(session, frame) for frame in frames]
    target = [worth(r, t) for r, t in zip(found, things, strict=True)]
    held = range(2 * len(frames) // 3, len(frames))
    measures = [r.measures for r in found]
    first = fit(np.concatenate(measures[: held.start]), np.concatenate(target[: held.start]))
    ap, recall = average_precision([judged(found[k], things[k], first) for k in held])
    layers = fit(np.concatenate(measures), np.concatenate(target))
    rows = [
        {"weight": np.round(w, 5).astype(float).tolist(), "bias": np.round(b, 5).astype(float).tolist()}
        for w, b in layers
    ]
    arguments.model.with_suffix(".json").write_text(json.dumps({"layers": rows}) + "\n")
    print(f"held-out rendered pictures: AP50 {ap:.3f}, recall {recall:.3f} ({len(held)} pictures)")


if __name__ == "__main__":
    main()
