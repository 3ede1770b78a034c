"""SigLIP: one tower a file, and both in one. Reference: SiglipImageProcessor, SiglipTokenizer (sentencepiece), SiglipModel."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import torch
from contract_fixtures import ODD_TEXTS, digest, pictures, probe
from optimum.exporters.onnx.model_configs import SiglipOnnxConfig, SiglipTextOnnxConfig, SiglipVisionModelOnnxConfig
from transformers import SiglipConfig, SiglipImageProcessor, SiglipModel, SiglipTextModel, SiglipVisionModel

from fixture_makers.common import export, save, seeded
from fixture_makers.vocabulary import siglip_tokenizer

SIDE_PX = 32


def make(folder: Path) -> None:
    """vision_model.onnx, text_model.onnx, model.onnx, tokenizer.json, reference.npz."""
    with tempfile.TemporaryDirectory() as scratch:
        tokenizer = siglip_tokenizer(folder, Path(scratch))
        tokens = tokenizer(list(ODD_TEXTS), padding="max_length", max_length=64, truncation=True, return_tensors="pt")
    sizes = {"hidden_size": 16, "intermediate_size": 32, "num_hidden_layers": 2, "num_attention_heads": 2}
    config = SiglipConfig(
        text_config={**sizes, "vocab_size": len(tokenizer), "max_position_embeddings": 64},
        vision_config={**sizes, "image_size": SIDE_PX, "patch_size": 8},
    )
    model = seeded(lambda: SiglipModel(config), 2)
    text, vision = SiglipTextModel(config.text_config).eval(), SiglipVisionModel(config.vision_config).eval()
    for tower in (text, vision):
        tower.load_state_dict({key: value for key, value in model.state_dict().items() if key in tower.state_dict()})
    export(text, SiglipTextOnnxConfig(config.text_config, task="feature-extraction"), folder / "text_model.onnx")
    vision_config = SiglipVisionModelOnnxConfig(config.vision_config, task="feature-extraction")
    export(vision, vision_config, folder / "vision_model.onnx")
    export(model, SiglipOnnxConfig(config, task="zero-shot-image-classification"), folder / "model.onnx")

    real, small = (SiglipImageProcessor(size={"height": side, "width": side}) for side in (224, SIDE_PX))
    views = pictures()
    pixels = small(list(views.values()), return_tensors="pt")["pixel_values"]
    with torch.no_grad():
        result = model(input_ids=tokens["input_ids"], pixel_values=pixels)
    full = {name: real(view, return_tensors="np")["pixel_values"][0] for name, view in views.items()}
    save(
        folder,
        **{f"probe_{name}": probe(value) for name, value in full.items()},
        **{f"digest_{name}": np.array(digest(value)) for name, value in full.items()},
        ids=tokens["input_ids"].numpy(),
        image_embeds=result.image_embeds.numpy(),
        text_embeds=result.text_embeds.numpy(),
        logits_per_image=result.logits_per_image.numpy(),
        logit_scale=model.logit_scale.exp().detach().numpy(),
        logit_bias=model.logit_bias.detach().numpy(),
    )
