"""OWL-ViT. Reference: OwlViTProcessor (CLIPTokenizer) and OwlViTForObjectDetection."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import torch
from contract_fixtures import DETECTOR_PROMPTS, digest, pictures, probe
from optimum.exporters.onnx.model_configs import OwlViTOnnxConfig
from transformers import OwlViTConfig, OwlViTForObjectDetection, OwlViTImageProcessor, OwlViTProcessor

from fixture_makers.common import check_export, export, save, seeded
from fixture_makers.vocabulary import clip_tokenizer

SIDE_PX = 64
SIZES = {"hidden_size": 16, "intermediate_size": 32, "num_hidden_layers": 2, "num_attention_heads": 2}


def make(folder: Path) -> None:
    """model.onnx, tokenizer.json, reference.npz."""
    with tempfile.TemporaryDirectory() as scratch:
        tokenizer = clip_tokenizer(folder, Path(scratch), pad="!")
    tokenizer.model_max_length = 16  # as the published tokenizer_config.json
    config = OwlViTConfig(
        text_config={**SIZES, "vocab_size": len(tokenizer)},
        vision_config={**SIZES, "image_size": SIDE_PX, "patch_size": 16},
        projection_dim=16,
    )
    model = tempered(seeded(lambda: OwlViTForObjectDetection(config), 3))
    onnx_config = OwlViTOnnxConfig(config, task="zero-shot-object-detection")
    real, small = (OwlViTImageProcessor(size={"height": side, "width": side}) for side in (768, SIDE_PX))
    arrays = reference(folder, model, onnx_config, OwlViTProcessor(small, tokenizer))
    full = {name: real(view, return_tensors="np")["pixel_values"][0] for name, view in pictures().items()}
    digests = {f"digest_{name}": np.array(digest(value)) for name, value in full.items()}
    save(folder, **arrays, **digests, **{f"probe_{name}": probe(value) for name, value in full.items()})


def tempered(model: Any) -> Any:
    """The model with texts that differ and heads that do not saturate: as they are drawn, one prompt wins all and boxes are points."""
    with torch.no_grad():
        for name, parameter in model.named_parameters():
            if "token_embedding" in name:
                parameter.mul_(10)
            elif "head." in name and parameter.ndim == 2:
                parameter.mul_(0.15 / parameter.std())
    return model


def reference(folder: Path, model: Any, onnx_config: Any, processor: Any) -> dict[str, np.ndarray]:
    """Exports the model; the processor's tokens, and per picture the boxes, scores and prompts of all patches, no threshold."""
    export(model, onnx_config, folder / "model.onnx")
    arrays: dict[str, np.ndarray] = {}
    for name, view in pictures().items():
        inputs = processor(text=[[f"a photo of a {p}" for p in DETECTOR_PROMPTS]], images=view, return_tensors="pt")
        with torch.no_grad():
            outputs = model(**inputs)
        expected = {"logits": outputs.logits, "pred_boxes": outputs.pred_boxes}
        check_export(folder / "model.onnx", expected, **{key: value.numpy() for key, value in inputs.items()})
        (found,) = processor.post_process_grounded_object_detection(
            outputs, threshold=0.0, target_sizes=torch.tensor([view.shape[:2]])
        )
        arrays |= {f"{name}_{key}": found[key].numpy() for key in ("boxes", "scores", "labels")}
        arrays |= {"ids": inputs["input_ids"].numpy(), "mask": inputs["attention_mask"].numpy()}
    return arrays
