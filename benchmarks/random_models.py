"""Make networks of irsd's own eyes in their true sizes with random weights: what they cost is real, what they say is noise.

    python benchmarks/random_models.py FOLDER [NAME...]

In the environment of 'make fixtures' (torch, transformers). Writes FOLDER as 'irsctl models' keeps it, with a catalogue.yaml that
knows these files' checksums, and FOLDER/foundation.yaml, a configuration for benchmarks/governor.py and 'irsctl replay'. For int8:
``irsctl models quantise NAME --frames RECORDING --dir FOLDER`` (random weights may fail the gate; it says by how much).
"""

from __future__ import annotations

import argparse
import hashlib
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch
import yaml
from transformers import (
    CLIPConfig,
    CLIPTextModelWithProjection,
    CLIPVisionModelWithProjection,
    OwlViTConfig,
    OwlViTForObjectDetection,
    SiglipConfig,
    SiglipTextModel,
    SiglipVisionModel,
)

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent / "tests" / "contract")]

from fixture_makers import clip, mobile_sam  # noqa: E402
from fixture_makers.common import export, seeded  # noqa: E402
from fixture_makers.owlvit import OwlViTOnnxConfig, tempered  # noqa: E402
from fixture_makers.siglip import SiglipTextOnnxConfig, SiglipVisionModelOnnxConfig  # noqa: E402
from fixture_makers.tracing import trace  # noqa: E402
from fixture_makers.vocabulary import clip_tokenizer, siglip_tokenizer  # noqa: E402

TASK = "feature-extraction"


def make_clip(folder: Path, patch: int) -> None:
    """The towers of CLIP B/32 or B/16. The tokenizer is a small one: token numbers cost the same whatever they mean."""
    config = CLIPConfig(text_config={"projection_dim": 512}, vision_config={"patch_size": patch, "projection_dim": 512})
    text = seeded(lambda: CLIPTextModelWithProjection(config.text_config), 1)
    vision = seeded(lambda: CLIPVisionModelWithProjection(config.vision_config), 2)
    export(text, clip._Text(config.text_config, task=TASK), folder / "text.fp32.onnx")
    export(vision, clip._Vision(config.vision_config, task=TASK), folder / "image.fp32.onnx")
    with tempfile.TemporaryDirectory() as scratch:
        clip_tokenizer(folder, Path(scratch))


def make_siglip(folder: Path) -> None:
    """The towers of SigLIP B/16 at 224 pixels."""
    config = SiglipConfig(vision_config={"image_size": 224})
    text = seeded(lambda: SiglipTextModel(config.text_config), 3)
    vision = seeded(lambda: SiglipVisionModel(config.vision_config), 4)
    export(text, SiglipTextOnnxConfig(config.text_config, task=TASK), folder / "text.fp32.onnx")
    export(vision, SiglipVisionModelOnnxConfig(config.vision_config, task=TASK), folder / "image.fp32.onnx")
    with tempfile.TemporaryDirectory() as scratch:
        siglip_tokenizer(folder, Path(scratch))


def make_owlvit(folder: Path) -> None:
    """OWL-ViT B/32, whose heads are tempered so that it finds boxes."""
    config = OwlViTConfig()
    model = tempered(seeded(lambda: OwlViTForObjectDetection(config), 5))
    export(model, OwlViTOnnxConfig(config, task="zero-shot-object-detection"), folder / "model.fp32.onnx")
    with tempfile.TemporaryDirectory() as scratch:
        clip_tokenizer(folder, Path(scratch), pad="!")


def make_mobile_sam(folder: Path) -> None:
    """MobileSAM's encoder on normalised pictures, and its decoder of one mask."""
    package = mobile_sam.package()
    model = seeded(package.sam_model_registry["vit_t"], 6)
    pictures = {"images": torch.randn(1, 3, 1024, 1024)}
    trace(model.image_encoder, pictures, ["image_embeddings"], {}, folder / "encoder.fp32.onnx")
    from mobile_sam.utils.onnx import SamOnnxModel  # noqa: PLC0415  (package() makes it importable)

    mobile_sam.WIDTH = 256
    mobile_sam._export_decoder(SamOnnxModel(model, return_single_mask=True), folder / "decoder.fp32.onnx")


MAKERS: dict[str, Callable[[Path], None]] = {
    "clip-vit-b32": lambda folder: make_clip(folder, 32),
    "clip-vit-b16": lambda folder: make_clip(folder, 16),
    "siglip-b16-224": make_siglip,
    "owlvit-b32": make_owlvit,
    "mobile-sam": make_mobile_sam,
}
FOUNDATION = {
    "perception": {
        "detector": "owlvit-b32",
        "segmenter": "mobile-sam",
        "image_encoder": "clip-vit-b32",
        "prompts": "vocabulary",
    },
    "budget": {"cpu_cores": 1.0, "latency_p95_ms": 500, "rss_mb": 1500},
}


def overlay(folder: Path, names: list[str]) -> dict[str, Any]:
    """Entries of the packaged catalogue, with the files that were made here."""
    known = yaml.safe_load((HERE.parent / "irsd" / "models" / "catalogue.yaml").read_text())["models"]
    models = {}
    for name in names:
        entry = known[name]
        for part, files in entry["files"].items():
            plain = "path" in files
            local = "tokenizer.json" if plain else f"{part}.fp32.onnx"
            data = (folder / name / local).read_bytes()
            file = {"path": local, "size_bytes": len(data), "sha256": hashlib.sha256(data).hexdigest()}
            entry["files"][part] = file if plain else {"fp32": file}
        entry.pop("base", None)
        models[name] = {**entry, "title": entry["title"] + ", random weights"}
    return {"schema": 1, "models": models}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(MAKERS)}; default: all")
    arguments = parser.parse_args()
    names = arguments.names or list(MAKERS)
    for name in names:
        (arguments.folder / name).mkdir(parents=True, exist_ok=True)
        MAKERS[name](arguments.folder / name)
        print(f"{name}: {sum(p.stat().st_size for p in (arguments.folder / name).iterdir()) / 1e6:.0f} MB", flush=True)
    document = yaml.safe_dump(overlay(arguments.folder, names), sort_keys=False)
    (arguments.folder / "catalogue.yaml").write_text(document)
    settings = {**FOUNDATION, "models": {"directory": str(arguments.folder.resolve())}}
    (arguments.folder / "foundation.yaml").write_text(yaml.safe_dump(settings, sort_keys=False))


if __name__ == "__main__":
    main()
