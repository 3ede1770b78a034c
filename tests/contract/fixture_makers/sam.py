"""SAM: encoder and decoder as optimum splits them, the decoder with boxes as well, and SamProcessor + SamModel as the reference."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from contract_fixtures import BOXES, POINTS, digest, pictures
from optimum.exporters.onnx.model_configs import SamOnnxConfig
from transformers import SamConfig, SamImageProcessor, SamModel, SamProcessor

from fixture_makers.common import check_export, export, save, seeded
from fixture_makers.tracing import trace

SIDE_PX, PATCH_PX = 128, 16


def make(folder: Path) -> None:
    """vision_encoder.onnx, prompt_encoder_mask_decoder.onnx (points), box_decoder.onnx (boxes), both_decoder.onnx, reference.npz."""
    model = _model()
    for name in ("vision_encoder", "prompt_encoder_mask_decoder"):
        options = {"task": "feature-extraction", "variant": "split", "vision_encoder": name == "vision_encoder"}
        export(model, SamOnnxConfig(model.config, **options), folder / f"{name}.onnx")
    _export_with_boxes(model, folder / "box_decoder.onnx", with_points=False)
    _export_with_boxes(model, folder / "both_decoder.onnx", with_points=True)
    arrays: dict[str, np.ndarray] = {}
    views = pictures()
    real = SamImageProcessor()
    for name, view in views.items():
        pixels = real(view, return_tensors="np")["pixel_values"][0]
        arrays[f"digest_{name}"] = np.array(digest(pixels))
    processor = SamProcessor(
        SamImageProcessor(size={"longest_edge": SIDE_PX}, pad_size={"height": SIDE_PX, "width": SIDE_PX})
    )
    for name, boxes in BOXES.items():
        arrays |= _reference(model, processor, f"box_{name}", views[name], input_boxes=[boxes])
        arrays |= _reference(
            model, processor, f"point_{name}", views[name], input_points=[[[point] for point in POINTS[name]]]
        )
        points, labels = zip(*(_stopgap(box, views[name]) for box in boxes), strict=True)
        arrays |= _reference(
            model, processor, f"stopgap_{name}", views[name], input_points=[list(points)], input_labels=[list(labels)]
        )
    save(folder, **arrays)


def _reference(model: SamModel, processor: SamProcessor, name: str, view: np.ndarray, **prompts: list) -> dict:
    """Scores and every second logit of each prompt's masks, and the best one in full, a bit a pixel, by transformers."""
    inputs = processor(view, **prompts, return_tensors="pt")
    sizes = inputs["original_sizes"], inputs["reshaped_input_sizes"]
    inputs = {key: value.to(torch.float32) if value.is_floating_point() else value for key, value in inputs.items()}
    with torch.no_grad():
        result = model(**inputs, multimask_output=True)
    pad_size = {"height": SIDE_PX, "width": SIDE_PX}
    masks = processor.post_process_masks(result.pred_masks, *sizes, pad_size=pad_size)[0].numpy()
    ious = result.iou_scores[0].numpy()
    return {
        f"{name}_ious": ious,
        f"{name}_logits": result.pred_masks[0, ..., ::2, ::2].numpy(),
        f"{name}_masks": np.packbits(masks[np.arange(len(ious)), ious.argmax(1)]),
    }


def _stopgap(box: list[float], view: np.ndarray) -> tuple[list, list]:
    """A box for a decoder without boxes: its centre, and as background the corners a tenth outside; none (-10) off the picture."""
    x0, y0, x1, y1 = box
    w, h = 0.1 * (x1 - x0), 0.1 * (y1 - y0)
    points = [[(x0 + x1) / 2, (y0 + y1) / 2]]
    labels = [1]
    for x, y in ((x0 - w, y0 - h), (x1 + w, y0 - h), (x0 - w, y1 + h), (x1 + w, y1 + h)):
        points.append([x, y])
        labels.append(0 if 0 <= x < view.shape[1] and 0 <= y < view.shape[0] else -10)
    return points, labels


def _model() -> SamModel:
    shared = {"hidden_size": 16, "image_size": SIDE_PX, "patch_size": PATCH_PX}
    vision = {
        **shared, "output_channels": 16, "num_hidden_layers": 2, "num_attention_heads": 2, "mlp_dim": 32, "window_size": 3,
        "global_attn_indexes": [1], "num_pos_feats": 8, "mlp_ratio": 2, "initializer_range": 0.25,
    }  # fmt: skip
    decoder = {
        "hidden_size": 16,
        "num_hidden_layers": 1,
        "mlp_dim": 32,
        "num_attention_heads": 2,
        "iou_head_hidden_dim": 16,
    }
    config = SamConfig(vision, {**shared, "mask_input_channels": 4}, decoder, initializer_range=0.25)
    model = seeded(lambda: SamModel(config), seed=31)
    # Trained positions have a spread of about 1, the random ones of transformers 8: sines of large numbers prove nothing.
    with torch.no_grad():
        model.shared_image_embedding.positional_embedding.normal_()
        model.prompt_encoder.shared_embedding.positional_embedding.copy_(
            model.shared_image_embedding.positional_embedding
        )
    return model


class _WithBoxes(torch.nn.Module):
    """What the ``boxes`` revisions export: the box goes through the prompt encoder; with points or without."""

    def __init__(self, model: SamModel) -> None:
        super().__init__()
        self.model = model

    def forward(self, input_boxes, image_embeddings, image_positional_embeddings, input_points=None, input_labels=None):
        sparse, dense = self.model.prompt_encoder(input_points, input_labels, input_boxes, None)
        masks, ious = self.model.mask_decoder(
            image_embeddings=image_embeddings,
            image_positional_embeddings=image_positional_embeddings,
            sparse_prompt_embeddings=sparse,
            dense_prompt_embeddings=dense,
            multimask_output=True,
        )[:2]
        return ious, masks


def _export_with_boxes(model: SamModel, path: Path, *, with_points: bool) -> None:
    wrapped = _WithBoxes(model).eval()
    grid = SIDE_PX // PATCH_PX
    width = model.config.mask_decoder_config.hidden_size
    inputs = {
        "input_boxes": torch.tensor([[[1.0, 2, 30, 40], [5, 6, 70, 80]]]),
        "image_embeddings": torch.randn(1, width, grid, grid),
        "image_positional_embeddings": torch.randn(1, width, grid, grid),
    }
    dynamic = {"input_boxes": {0: "batch_size", 1: "nb_boxes"}}
    if with_points:
        inputs |= {"input_points": torch.rand(1, 2, 3, 2) * 99, "input_labels": torch.ones(1, 2, 3, dtype=torch.int64)}
        dynamic |= {key: {0: "batch_size", 1: "nb_boxes", 2: "nb_points"} for key in ("input_points", "input_labels")}
    trace(wrapped, inputs, ("iou_scores", "pred_masks"), dynamic, path)
    feeds = {name: value.numpy() for name, value in inputs.items()}
    feeds["input_boxes"] = np.random.default_rng(2).uniform(0, 128, (1, 5, 4)).astype(np.float32)
    if with_points:
        feeds |= {"input_points": np.zeros((1, 5, 0, 2), np.float32), "input_labels": np.zeros((1, 5, 0), np.int64)}
    named = {name: torch.from_numpy(value) for name, value in feeds.items()}
    check_export(path, dict(zip(("iou_scores", "pred_masks"), wrapped(**named), strict=True)), **feeds)
