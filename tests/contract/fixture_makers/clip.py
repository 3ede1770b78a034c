"""CLIP: split towers as transformers.js publishes them, both in one as optimum does. Reference: CLIPImageProcessor, CLIPModel."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import ClassVar

import numpy as np
import torch
from contract_fixtures import ODD_TEXTS, digest, pictures, probe
from optimum.exporters.onnx.model_configs import CLIPOnnxConfig, CLIPTextOnnxConfig, CLIPVisionModelOnnxConfig
from transformers import (
    CLIPConfig,
    CLIPImageProcessor,
    CLIPModel,
    CLIPTextModelWithProjection,
    CLIPVisionModelWithProjection,
)

from fixture_makers.common import check_export, export, save, seeded
from fixture_makers.vocabulary import clip_tokenizer

SIDE_PX = 32  # of the tiny model; the pixels of the real size (224) are probed
DIMENSION = 16


class _Text(CLIPTextOnnxConfig):
    outputs: ClassVar = {"text_embeds": {0: "batch_size"}}


class _Vision(CLIPVisionModelOnnxConfig):
    outputs: ClassVar = {"image_embeds": {0: "batch_size"}}


def make(folder: Path) -> None:
    """vision_model.onnx, text_model.onnx, model.onnx, tokenizer.json, reference.npz."""
    with tempfile.TemporaryDirectory() as scratch:
        tokenizer = clip_tokenizer(folder, Path(scratch))
    sizes = {"hidden_size": 16, "intermediate_size": 32, "num_hidden_layers": 2, "num_attention_heads": 2}
    sizes["projection_dim"] = DIMENSION
    config = CLIPConfig(
        # eos_token_id 2 is what the published configurations say; it means: pool at the largest id.
        text_config={**sizes, "vocab_size": len(tokenizer), "eos_token_id": 2, "bos_token_id": 0},
        vision_config={**sizes, "image_size": SIDE_PX, "patch_size": 8},
        projection_dim=DIMENSION,
    )
    model = seeded(lambda: CLIPModel(config), 1)
    text = CLIPTextModelWithProjection(config.text_config)
    vision = CLIPVisionModelWithProjection(config.vision_config)
    for tower in (text, vision):
        tower.load_state_dict({key: value for key, value in model.state_dict().items() if key in tower.state_dict()})
        tower.eval()
    export(text, _Text(config.text_config, task="feature-extraction"), folder / "text_model.onnx")
    export(vision, _Vision(config.vision_config, task="feature-extraction"), folder / "vision_model.onnx")
    export(model, CLIPOnnxConfig(config, task="zero-shot-image-classification"), folder / "model.onnx")

    real, small = (
        CLIPImageProcessor(size={"shortest_edge": side}, crop_size={"height": side, "width": side})
        for side in (224, SIDE_PX)
    )
    views = pictures()
    pixels = small(list(views.values()), return_tensors="pt")["pixel_values"]
    tokens = tokenizer(list(ODD_TEXTS), padding="max_length", max_length=77, truncation=True, return_tensors="pt")
    with torch.no_grad():
        result = model(**tokens, pixel_values=pixels)
    check_export(folder / "vision_model.onnx", {}, pixel_values=pixels.numpy())
    full = {name: real(view, return_tensors="np")["pixel_values"][0] for name, view in views.items()}
    save(
        folder,
        **{f"probe_{name}": probe(value) for name, value in full.items()},
        **{f"digest_{name}": np.array(digest(value)) for name, value in full.items()},
        pixels=pixels.numpy(),
        ids=tokens["input_ids"].numpy(),
        lengths=tokens["attention_mask"].sum(1).numpy(),
        image_embeds=result.image_embeds.numpy(),
        text_embeds=result.text_embeds.numpy(),
        logits_per_image=result.logits_per_image.numpy(),
        logit_scale=model.logit_scale.exp().detach().numpy(),
    )
