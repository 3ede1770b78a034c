"""OWLv2. Reference: Owlv2Processor (CLIPTokenizer) and Owlv2ForObjectDetection."""

from __future__ import annotations

import tempfile
from pathlib import Path

from contract_fixtures import pictures, probe
from optimum.exporters.onnx.model_configs import OwlV2OnnxConfig
from transformers import Owlv2Config, Owlv2ForObjectDetection, Owlv2ImageProcessor, Owlv2Processor

from fixture_makers.common import save, seeded
from fixture_makers.owlvit import SIDE_PX, SIZES, reference, tempered
from fixture_makers.vocabulary import clip_tokenizer


def make(folder: Path) -> None:
    """model.onnx, tokenizer.json, reference.npz."""
    with tempfile.TemporaryDirectory() as scratch:
        tokenizer = clip_tokenizer(folder, Path(scratch), pad="!")
    tokenizer.model_max_length = 16  # as the published tokenizer_config.json
    config = Owlv2Config(
        text_config={**SIZES, "vocab_size": len(tokenizer)},
        vision_config={**SIZES, "image_size": SIDE_PX, "patch_size": 16},
        projection_dim=16,
    )
    model = tempered(seeded(lambda: Owlv2ForObjectDetection(config), 4))
    onnx_config = OwlV2OnnxConfig(config, task="zero-shot-object-detection")
    real, small = (Owlv2ImageProcessor(size={"height": side, "width": side}) for side in (960, SIDE_PX))
    arrays = reference(folder, model, onnx_config, Owlv2Processor(small, tokenizer))
    full = {name: real(view, return_tensors="np")["pixel_values"][0] for name, view in pictures().items()}
    save(folder, **arrays, **{f"probe_{name}": probe(value) for name, value in full.items()})
