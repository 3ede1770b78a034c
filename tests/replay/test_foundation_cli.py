"""irsctl replay with irsd's own eyes: a real small detector, masks by the map's depth, and an encoder of a few nodes."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from tiny_onnx import image_encoder

SAME_BYTES = ("graph.json", "rooms.json", "instances.npz", "embeddings.npz", "plan.svg")


def configure(folder: Path, detector: Path) -> Path:
    """A folder of models with a catalogue of its own, and the configuration that names them."""
    models = folder / "models"
    (models / "nanodet-m").mkdir(parents=True)
    (models / "colours").mkdir()
    shutil.copy(detector, models / "nanodet-m" / "model.fp32.onnx")
    path = image_encoder(models / "colours" / "image.fp32.onnx", np.random.default_rng(5).normal(size=(3, 16)))
    entry = {
        "title": "Mean colour",
        "roles": ["image_encoder"],
        "family": "clip",
        "licence": "Apache-2.0",
        "source": "this test",
        "files": {
            "image": {
                "fp32": {
                    "path": "image.onnx",
                    "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
                    "size_bytes": path.stat().st_size,
                }
            }
        },
        "contract": {
            "image": {
                "inputs": {"pixel_values": "float32[batch,3,8,8]"},
                "outputs": {"image_embeds": "float32[batch,16]"},
            }
        },
        "cost": {"image": {"cpu_ms": [1, 1], "rss_mb": [1, 1], "peak_mb": [1, 1]}},
        "preprocess": {"side_px": 8, "filter": "bicubic", "levels": "clip", "max_tokens": 77},
    }
    (models / "catalogue.yaml").write_text(yaml.safe_dump({"schema": 1, "models": {"colours": entry}}))
    config = folder / "irsd.yaml"
    document = {
        "perception": {"detector": "nanodet-m", "image_encoder": "colours"},
        "models": {"directory": str(models)},
    }
    config.write_text(yaml.safe_dump(document))
    return config


def irsctl(*arguments: str, seed: int = 0) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONHASHSEED": str(seed)}
    command = [sys.executable, "-m", "irsd.ctl", *arguments]
    return subprocess.run(command, capture_output=True, text=True, env=environment, check=False)


@pytest.fixture(scope="module")
def config(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return configure(tmp_path_factory.mktemp("foundation"), shared_data / "models" / "nanodet_m.onnx")


def test_own_eyes_see_things_and_the_same_ones_each_time(shared_data: Path, tmp_path: Path, config: Path) -> None:
    recording = shared_data / "small_house" / "small_house_short.mcap"
    folders = [tmp_path / "a", tmp_path / "b"]
    for seed, folder in enumerate(folders):
        arguments = ("replay", str(recording), "--perception", "foundation", "--config", str(config), "--json")
        run = irsctl(*arguments, "--out", str(folder), seed=seed)
        assert run.returncode == 0, run.stderr
    for name in SAME_BYTES:
        assert (folders[0] / name).read_bytes() == (folders[1] / name).read_bytes(), name
    graph = json.loads((folders[0] / "graph.json").read_text())
    metrics = json.loads((folders[0] / "metrics.json").read_text())
    assert metrics["perception"]["keyframes"] >= 8
    assert metrics["perception"]["ladder"][0] == "full"
    assert graph["instances"], metrics["perception"]
    assert {node["label"] for node in graph["instances"]} & {"chair", "sofa", "bed", "dining table", "refrigerator"}
    assert np.load(folders[0] / "embeddings.npz")["embedding"].shape[1] == 16


def test_a_configuration_without_models_is_refused(shared_data: Path, tmp_path: Path) -> None:
    recording = shared_data / "small_house" / "small_house_short.mcap"
    run = irsctl("replay", str(recording), "--perception", "foundation", "--out", str(tmp_path / "out"))
    assert run.returncode == 1
    assert "perception.image_encoder is not set" in run.stderr


def test_a_model_that_is_not_there_is_named_with_what_to_do(shared_data: Path, tmp_path: Path) -> None:
    config = tmp_path / "irsd.yaml"
    document = {"perception": {"image_encoder": "clip-vit-b32"}, "models": {"directory": str(tmp_path)}}
    config.write_text(yaml.safe_dump(document))
    recording = shared_data / "small_house" / "small_house_short.mcap"
    arguments = ("replay", str(recording), "--perception", "foundation", "--config", str(config))
    run = irsctl(*arguments, "--out", str(tmp_path / "out"))
    assert run.returncode == 1
    assert "irsctl models pull clip-vit-b32" in run.stderr
