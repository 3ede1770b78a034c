"""RAM: no package has its code, so this joins what it is made of, with few channels and 45 tags: Swin of transformers, and the tagging
head of Query2Label restated after xinyu1205/recognize-anything (Apache-2.0): tags as queries, layers of attention to the picture
without attention among tags, one linear unit.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from contract_fixtures import digest, pictures
from PIL import Image
from transformers import SwinConfig, SwinModel

from fixture_makers.common import save, seeded
from fixture_makers.tracing import trace

SIDE_PX, WIDTH, TAGS = 384, 16, 45


def make(folder: Path) -> None:
    """model.onnx (logits), model_tag.onnx (decided in the graph), tags.txt, thresholds.txt, reference.npz."""
    model = seeded(_Ram, seed=2)
    thresholds = np.random.default_rng(4).uniform(0.3, 0.7, TAGS).round(2)
    (folder / "tags.txt").write_text("".join(f"tag {number}\n" for number in range(TAGS)))
    (folder / "thresholds.txt").write_text("".join(f"{value}\n" for value in thresholds))
    inputs = {"image": torch.randn(1, 3, SIDE_PX, SIDE_PX)}
    trace(model, inputs, ["logits"], {}, folder / "model.onnx")
    decided = _Decided(model, torch.from_numpy(thresholds).float())
    trace(decided, inputs, ["tag"], {}, folder / "model_tag.onnx")
    arrays = {"thresholds": thresholds}
    for name, view in pictures().items():
        # torchvision's Resize, ToTensor and Normalize, on a Pillow picture, step by step
        small = Image.fromarray(view).resize((SIDE_PX, SIDE_PX), Image.Resampling.BILINEAR)
        pixels = torch.from_numpy(np.array(small)).permute(2, 0, 1).float().div(255)
        mean, std = (torch.tensor(v)[:, None, None] for v in ([0.485, 0.456, 0.406], [0.229, 0.224, 0.225]))
        pixels = pixels.sub(mean).div(std)
        with torch.no_grad():
            logits = model(pixels[None])[0]
        arrays[f"digest_{name}"] = np.array(digest(pixels.numpy()))
        arrays[f"probability_{name}"] = torch.sigmoid(logits).numpy()
    save(folder, **arrays)


class _Ram(torch.nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.swin = SwinModel(
            SwinConfig(
                image_size=SIDE_PX, patch_size=4, embed_dim=4, depths=[1, 1, 1, 1], num_heads=[1, 1, 2, 2], window_size=6,
                mlp_ratio=1.0, initializer_range=0.2,
            )
        )  # fmt: skip
        self.image_proj = torch.nn.Linear(32, WIDTH)
        self.label_embed = torch.nn.Parameter(torch.randn(TAGS, WIDTH) * 2)
        self.wordvec_proj = torch.nn.Linear(WIDTH, WIDTH)
        self.layers = torch.nn.ModuleList([_Layer() for _ in range(2)])
        self.fc = torch.nn.Linear(WIDTH, 1)

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        patches = self.swin(image).last_hidden_state
        seen = self.image_proj(torch.cat([patches.mean(1, keepdim=True), patches], 1))
        tags = torch.relu(self.wordvec_proj(self.label_embed))[None]
        for layer in self.layers:
            tags = layer(tags, seen)
        return self.fc(tags).squeeze(-1)


class _Layer(torch.nn.Module):
    """A BERT layer without self-attention: attention to the picture, then the feed-forward part, each with its norm after."""

    def __init__(self) -> None:
        super().__init__()
        self.look = torch.nn.MultiheadAttention(WIDTH, 2, batch_first=True)
        self.forth, self.back = torch.nn.Linear(WIDTH, 32), torch.nn.Linear(32, WIDTH)
        self.norms = torch.nn.ModuleList([torch.nn.LayerNorm(WIDTH) for _ in range(2)])

    def forward(self, tags: torch.Tensor, seen: torch.Tensor) -> torch.Tensor:
        tags = self.norms[0](tags + self.look(tags, seen, seen, need_weights=False)[0])
        return self.norms[1](tags + self.back(torch.nn.functional.gelu(self.forth(tags))))


class _Decided(torch.nn.Module):
    """The repository's own export: thresholds in the graph."""

    def __init__(self, model: torch.nn.Module, thresholds: torch.Tensor) -> None:
        super().__init__()
        self.model, self.thresholds = model, thresholds

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        return torch.where(torch.sigmoid(self.model(image)) > self.thresholds, torch.tensor(1.0), torch.tensor(0.0))
