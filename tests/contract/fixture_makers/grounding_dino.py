"""Grounding DINO. Reference: GroundingDinoImageProcessor, BertTokenizer, GroundingDinoForObjectDetection and its post-processing.

Two files: ``model.onnx``, whose mask of phrases is computed in the graph for any number of them, and ``frozen.onnx`` as plain
tracing with one phrase gives it: it runs with any number, is right with one, and wrong without complaint with others.
"""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime
import torch
from contract_fixtures import DETECTOR_PROMPTS, digest, pictures, probe
from transformers import (
    GroundingDinoConfig,
    GroundingDinoForObjectDetection,
    GroundingDinoImageProcessor,
    GroundingDinoProcessor,
    SwinConfig,
)
from transformers.models.grounding_dino import modeling_grounding_dino as source
from transformers.models.grounding_dino.image_processing_grounding_dino import get_size_with_aspect_ratio

from fixture_makers.common import check_export, save, seeded, shorten
from fixture_makers.tracing import trace
from fixture_makers.vocabulary import bert_tokenizer

HEIGHT_PX, WIDTH_PX = 96, 128  # tracing fixes the size of pictures, in the published files too
INPUTS = ("pixel_values", "pixel_mask", "input_ids", "token_type_ids", "attention_mask")
AXES = {
    # Named as if free, which they are not.
    "pixel_values": {2: "height", 3: "width"},
    "pixel_mask": {1: "height", 2: "width"},
    **{name: {1: "sequence_length"} for name in INPUTS[2:]},
}


def make(folder: Path) -> None:
    """model.onnx, frozen.onnx, tokenizer.json, reference.npz."""
    with tempfile.TemporaryDirectory() as scratch:
        tokenizer = bert_tokenizer(folder, Path(scratch))
    model = seeded(lambda: GroundingDinoForObjectDetection(_config(len(tokenizer))), 7)
    real = GroundingDinoImageProcessor()
    processor = GroundingDinoProcessor(
        GroundingDinoImageProcessor(size={"height": HEIGHT_PX, "width": WIDTH_PX}), tokenizer
    )
    sample = processor(images=pictures()["odd"], text="trash can.", return_tensors="pt")
    lesser = seeded(lambda: GroundingDinoForObjectDetection(_config(len(tokenizer), decoder_layers=1)), 6)
    inputs = {key: sample[key] for key in INPUTS}
    for name, chosen, patch in (("model", model, _any_number_of_phrases), ("frozen", lesser, contextlib.nullcontext)):
        with patch():
            trace(_Outputs(chosen), inputs, ("logits", "pred_boxes"), AXES, folder / f"{name}.onnx")
            _fold(folder / f"{name}.onnx")
    arrays: dict[str, np.ndarray] = {}
    for name, view in pictures().items():
        arrays |= _reference(model, processor, name, view, folder / "model.onnx")
    full = {name: real(view, return_tensors="np")["pixel_values"][0] for name, view in pictures().items()}
    digests = {f"digest_{name}": np.array(digest(value)) for name, value in full.items()}
    sides = np.random.RandomState(0).randint(20, 2000, (300, 2))
    sized = [get_size_with_aspect_ratio((int(h), int(w)), 800, 1333) for h, w in sides]
    arrays["sizes"] = np.concatenate([sides, sized], 1)
    save(folder, **arrays, **digests, **{f"probe_{name}": probe(value) for name, value in full.items()})


def _config(pieces: int, **sizes: int) -> GroundingDinoConfig:
    swin = SwinConfig(
        image_size=64, embed_dim=4, depths=[1, 1, 1, 1], num_heads=[1, 1, 2, 2], window_size=4, mlp_ratio=2.0
    )
    swin.out_features = ["stage2", "stage3", "stage4"]
    bert = {"vocab_size": pieces, "hidden_size": 16, "intermediate_size": 32, "num_hidden_layers": 2}
    sizes = {"encoder_layers": 1, "decoder_layers": 2, "encoder_ffn_dim": 32, "decoder_ffn_dim": 32, **sizes}
    return GroundingDinoConfig(
        backbone_config=swin,
        text_config={**bert, "num_attention_heads": 2, "max_position_embeddings": 256},
        **{"d_model": 32, "num_queries": 20, "encoder_attention_heads": 2, "decoder_attention_heads": 2},
        **{"encoder_n_points": 2, "decoder_n_points": 2},
        **sizes,
    )


class _Outputs(torch.nn.Module):
    """The model as its public files are: inputs by position, two outputs."""

    def __init__(self, model: torch.nn.Module) -> None:
        super().__init__()
        self.model = model

    def forward(self, *inputs: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        result = self.model(**dict(zip(INPUTS, inputs, strict=True)))
        return result.logits, result.pred_boxes


def _fold(path: Path) -> None:
    """Thousands of nodes compute the shapes that one size of pictures has: constants by now."""
    options = onnxruntime.SessionOptions()
    options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_ENABLE_BASIC
    options.optimized_model_filepath = str(path)
    options.log_severity_level = 3
    onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    shorten(path)


@contextlib.contextmanager
def _any_number_of_phrases() -> Iterator[None]:
    """The mask of phrases without a loop over them, which tracing would unroll."""

    def masks(input_ids: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        special = torch.zeros_like(input_ids, dtype=torch.bool)
        for number in source.SPECIAL_TOKENS:
            special = special | (input_ids == number)
        group = torch.cumsum(special.long(), 1) - special.long()  # a phrase and the stop that ends it
        same = group[:, :, None] == group[:, None, :]
        earlier = torch.ones_like(same[0], dtype=torch.long).tril()
        return same, (same.long() * earlier).sum(-1) - 1

    name = "generate_masks_with_special_tokens_and_transfer_map"
    original = getattr(source, name)
    setattr(source, name, masks)
    try:
        yield
    finally:
        setattr(source, name, original)


def _reference(model: Any, processor: Any, name: str, view: np.ndarray, file: Path) -> dict[str, np.ndarray]:
    """Of one picture: the caption's tokens, and of all queries the box, the score by the processor, and each phrase's best token."""
    inputs = processor(images=view, text=list(DETECTOR_PROMPTS), return_tensors="pt")
    with torch.no_grad():
        outputs = model(**inputs)
    check_export(file, {"pred_boxes": outputs.pred_boxes}, **{key: value.numpy() for key, value in inputs.items()})
    (found,) = processor.post_process_grounded_object_detection(
        outputs, inputs["input_ids"], threshold=0.0, target_sizes=[view.shape[:2]]
    )
    ids = inputs["input_ids"][0]
    stops = [int(n) for n in torch.nonzero(ids == 1012)]
    starts = [1, *(stop + 1 for stop in stops[:-1])]
    probabilities = torch.sigmoid(outputs.logits[0])
    phrases = torch.stack([probabilities[:, a:b].amax(1) for a, b in zip(starts, stops, strict=True)], 1)
    arrays = {"boxes": found["boxes"], "scores": found["scores"], "phrases": phrases}
    return {f"{name}_{key}": value.numpy() for key, value in arrays.items()} | {"ids": ids.numpy()}
