"""EfficientSAM: no package has its code; this states its file contract anew, after yformer/EfficientSAM (Apache-2.0), on parts of SAM.

Stated exactly: what the graphs do with pictures (resize without keeping proportions, ImageNet levels), points (rescaled, padded to six
with label -1, moved to pixel centres, embedded by label), and masks (the last three of four, enlarged to the picture). The networks
between are SAM's, of few channels: a plain ViT with the same neck, and the two-way decoder, whose layers differ a little in
EfficientSAM (GELU, another upscaling); no file of ours depends on that.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from contract_fixtures import BOXES, POINTS, pictures
from torch.nn import functional

from fixture_makers.common import save, seeded
from fixture_makers.mobile_sam import package
from fixture_makers.tracing import trace

SIDE_PX, WIDTH, MAX_POINTS = 128, 16, 6


def make(folder: Path) -> None:
    """encoder.onnx, decoder.onnx (any number of prompts), decoder_one.onnx (one), reference.npz."""
    model = seeded(_EfficientSam, seed=34)
    with torch.no_grad():
        for weight in model.decoder.parameters():
            weight.mul_(2 if weight.dim() > 1 else 1)
        model.frequencies.normal_()
    free = {"batched_images": {0: "batch", 2: "height", 3: "width"}}
    trace(
        _Encoder(model),
        {"batched_images": torch.rand(1, 3, 70, 90)},
        ["image_embeddings"],
        free,
        folder / "encoder.onnx",
    )
    for name, prompts in (("decoder", 5), ("decoder_one", 1)):
        inputs = {
            "image_embeddings": torch.randn(1, WIDTH, SIDE_PX // 16, SIDE_PX // 16),
            "batched_point_coords": torch.rand(1, prompts, 2, 2) * 60,
            "batched_point_labels": torch.tensor([[[2.0, 3.0]]]).repeat(1, prompts, 1),
            "orig_im_size": torch.tensor([70, 90]),
        }
        axes = {2: "num_points"} if prompts == 1 else {1: "num_queries", 2: "num_points"}
        dynamic = {key: axes for key in ("batched_point_coords", "batched_point_labels")}
        outputs = ("output_masks", "iou_predictions", "low_res_masks")
        trace(_Decoder(model), inputs, outputs, dynamic, folder / f"{name}.onnx")
    save(folder, **_reference(model))


def _reference(model: torch.nn.Module) -> dict[str, np.ndarray]:
    arrays = {}
    for name, view in pictures().items():
        if name not in BOXES:
            continue
        image = torch.from_numpy(view).permute(2, 0, 1)[None].float() / 255
        for kind, points, labels in (
            ("box", np.array(BOXES[name]).reshape(1, -1, 2, 2), [2.0, 3.0]),
            ("point", np.array(POINTS[name]).reshape(1, -1, 1, 2), [1.0]),
        ):
            with torch.no_grad():
                marks = torch.tensor(labels).repeat(1, points.shape[1], 1)
                masks, ious, _ = model(image, torch.from_numpy(points).float(), marks)
            best = masks[0][torch.arange(points.shape[1]), ious[0].argmax(1)]
            arrays[f"{kind}_{name}_ious"] = ious[0].numpy()
            arrays[f"{kind}_{name}_masks"] = np.packbits(best.numpy() > 0)
    return arrays


class _EfficientSam(torch.nn.Module):
    def __init__(self) -> None:
        super().__init__()
        parts = package().modeling
        self.encoder = parts.ImageEncoderViT(
            img_size=SIDE_PX, patch_size=16, embed_dim=16, depth=2, num_heads=2, mlp_ratio=2.0, out_chans=WIDTH
        )
        transformer = parts.TwoWayTransformer(depth=1, embedding_dim=WIDTH, num_heads=2, mlp_dim=32)
        self.decoder = parts.MaskDecoder(
            transformer_dim=WIDTH, transformer=transformer, num_multimask_outputs=3, iou_head_hidden_dim=WIDTH
        )
        self.frequencies = torch.nn.Parameter(torch.randn(2, WIDTH // 2))
        self.labels = torch.nn.Parameter(
            torch.randn(4, WIDTH)
        )  # rows: none (-1), point (1), first corner (2), last corner (3)
        self.register_buffer("mean", torch.tensor([0.485, 0.456, 0.406])[:, None, None])
        self.register_buffer("std", torch.tensor([0.229, 0.224, 0.225])[:, None, None])

    def encode(self, images: torch.Tensor) -> torch.Tensor:
        square = functional.interpolate(images, (SIDE_PX, SIDE_PX), mode="bilinear")
        return self.encoder((square - self.mean) / self.std)

    def decode(self, features: torch.Tensor, points: torch.Tensor, labels: torch.Tensor, size: torch.Tensor) -> tuple:
        queries, count = points.shape[1], points.shape[2]
        height, width = size[0], size[1]
        scaled = torch.stack([points[..., 0] * SIDE_PX / width, points[..., 1] * SIDE_PX / height], -1)
        scaled = functional.pad(scaled, (0, 0, 0, MAX_POINTS - count), value=-1.0)
        labels = functional.pad(labels, (0, MAX_POINTS - count), value=-1.0)
        prompts = self._positions((scaled + 0.5) / SIDE_PX).reshape(queries, MAX_POINTS, WIDTH)
        for label, embedding in zip((-1, 1, 2, 3), self.labels, strict=True):
            prompts = prompts + (labels.reshape(queries, MAX_POINTS, 1) == label) * embedding
        grid = SIDE_PX // 16
        middle = (torch.arange(grid) + 0.5) / grid
        here = torch.stack([middle.repeat(grid, 1), middle.repeat(grid, 1).T], -1)
        low, ious = self.decoder.predict_masks(
            image_embeddings=features,
            image_pe=self._positions(here).permute(2, 0, 1)[None],
            sparse_prompt_embeddings=prompts,
            dense_prompt_embeddings=torch.zeros(1, WIDTH, grid, grid),
        )
        low, ious = low[:, 1:], ious[:, 1:]
        masks = functional.interpolate(low, (height, width), mode="bilinear")
        return masks.reshape(1, queries, 3, height, width), ious.reshape(1, queries, 3), low

    def _positions(self, places: torch.Tensor) -> torch.Tensor:
        waves = 2 * np.pi * ((2 * places - 1) @ self.frequencies)
        return torch.cat([waves.sin(), waves.cos()], -1)

    def forward(self, images: torch.Tensor, points: torch.Tensor, labels: torch.Tensor) -> tuple:
        return self.decode(self.encode(images), points, labels, torch.tensor(images.shape[2:]))


class _Encoder(torch.nn.Module):
    def __init__(self, model: _EfficientSam) -> None:
        super().__init__()
        self.model = model

    def forward(self, batched_images: torch.Tensor) -> torch.Tensor:
        return self.model.encode(batched_images)


class _Decoder(_Encoder):
    def forward(self, image_embeddings, batched_point_coords, batched_point_labels, orig_im_size) -> tuple:
        return self.model.decode(image_embeddings, batched_point_coords, batched_point_labels, orig_im_size)
