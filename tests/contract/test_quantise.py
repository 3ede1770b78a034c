"""int8 on a tiny CLIP and a tiny OWL-ViT: what is made well passes the gate and is taken into use, what is broken is refused."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import onnx
import pytest
import yaml
from contract_fixtures import FIXTURES, pictures
from onnx import numpy_helper

from irsd.core.errors import ModelError
from irsd.ctl.models import read_pictures
from irsd.perception.assemble import ModelOpener, ModelSettings
from irsd.perception.models import sha256_of
from irsd.perception.shelf import Shelf
from irsd.perception.supply import RefusedError
from irsd.perception.supply.quantise import adopt, float_file, make_int8, quantise

CLIP, OWL = "clip-vit-b32", "owlvit-b32"
PICTURES = list(pictures().values())


def shelve(folder: Path, model: str, files: dict[str, Path], **changes: object) -> ModelSettings:
    """A model folder with tiny files in place of the real ones, pinned by a catalogue of its own."""
    pins: dict[str, object] = {}
    for local, source in files.items():
        (folder / model).mkdir(parents=True, exist_ok=True)
        shutil.copy(source, folder / model / local)
        pin = {"sha256": sha256_of(source), "size_bytes": source.stat().st_size}
        part = local.split(".")[0]
        pins[part] = {"fp32": pin} if local.endswith(".onnx") else pin
    document = {"schema": 1, "models": {model: {"files": pins, **changes}}}
    (folder / "catalogue.yaml").write_text(yaml.safe_dump(document))
    return ModelSettings(directory=str(folder))


@pytest.fixture
def clip(tmp_path: Path) -> ModelSettings:
    source = FIXTURES / "clip"
    files = {
        "image.fp32.onnx": "vision_model.onnx",
        "text.fp32.onnx": "text_model.onnx",
        "tokenizer.json": "tokenizer.json",
    }
    tiny = {local: source / name for local, name in files.items()}
    return shelve(tmp_path, CLIP, tiny, preprocess={"side_px": 32}, floors={"cosine": 0.95, "retrieval": 0.8})


def scaled(source: Path, target: Path, factor: float) -> None:
    """The file with every quantised weight's scale off by a factor: it opens, runs, and answers nonsense."""
    model = onnx.load(str(source))
    for constant in model.graph.initializer:
        if constant.name.endswith("_scale"):
            rng = np.random.default_rng(0)
            value = numpy_helper.to_array(constant)
            spoilt = (value * factor * rng.normal(size=value.shape)).astype(value.dtype)
            constant.CopyFrom(numpy_helper.from_array(np.asarray(spoilt), constant.name))
    onnx.save(model, str(target))


def test_int8_is_made_judged_and_taken_into_use(clip: ModelSettings) -> None:
    before = ModelOpener(clip)
    floats = before.image_encoder(CLIP).encode_images(PICTURES)
    outcomes = list(quantise(clip, CLIP, PICTURES))
    assert [outcome.part for outcome in outcomes] == ["image", "text"]
    assert all(outcome.int8_bytes < outcome.float_bytes for outcome in outcomes)
    assert all(outcome.verdict.measured["cosine"] > 0.95 for outcome in outcomes)

    after = ModelOpener(clip)
    integers = after.image_encoder(CLIP).encode_images(PICTURES)
    assert (floats * integers).sum(1).min() > 0.95
    assert np.abs(floats - integers).max() > 0, "still the fp32 file"
    assert [(row["precision"], row["judged"]) for row in after.status()] == [("int8", True)]
    assert ModelOpener(clip).image_encoder(f"{CLIP}@fp32").encode_images(PICTURES).tobytes() == floats.tobytes()
    assert not list(clip.folder.rglob(".*.onnx")), "scratch files stayed behind"


def test_an_altered_int8_file_is_not_opened(clip: ModelSettings) -> None:
    list(quantise(clip, CLIP, PICTURES, parts=["image"]))
    path = clip.folder / CLIP / "image.int8.onnx"
    path.write_bytes(path.read_bytes()[:-1] + b"\0")
    with pytest.raises(ModelError, match="was altered"):
        ModelOpener(clip).image_encoder(CLIP)


@pytest.mark.parametrize("factor", [0.0, 1.0])
def test_a_broken_quantisation_is_refused_with_the_numbers(clip: ModelSettings, tmp_path: Path, factor: float) -> None:
    shelf, model = Shelf(clip.folder), ModelOpener(clip).model(CLIP)
    good, broken = tmp_path / "good.onnx", tmp_path / "broken.onnx"
    make_int8(shelf.path(model, float_file(model, "image")), good, model.recipes["image"])
    scaled(good, broken, factor)
    with pytest.raises(RefusedError, match=r"refused.*fp32 stays in use|does not run"):
        adopt(clip, model, "image", broken, PICTURES)
    assert not (clip.folder / CLIP / "image.int8.onnx").exists()
    assert ModelOpener(clip).image_encoder(CLIP).dimension > 0
    assert adopt(clip, model, "image", good, PICTURES).verdict.failed == ()


def test_the_numbers_are_in_the_refusal(clip: ModelSettings, tmp_path: Path) -> None:
    model = ModelOpener(clip).model(CLIP)
    broken = tmp_path / "broken.onnx"
    make_int8(clip.folder / CLIP / "text.fp32.onnx", tmp_path / "good.onnx", model.recipes["text"])
    scaled(tmp_path / "good.onnx", broken, 1.0)
    with pytest.raises(
        RefusedError, match=r"text: the int8 file was refused: cosine -?0\.\d+ \(floor 0\.95\), retrieval"
    ):
        adopt(clip, model, "text", broken, PICTURES)


def test_a_detector_by_boxes(tmp_path: Path) -> None:
    source = FIXTURES / "owlvit"
    files = {"model.fp32.onnx": source / "model.onnx", "tokenizer.json": source / "tokenizer.json"}
    side_px = 64
    tiny = shelve(tmp_path, OWL, files, preprocess={"side_px": side_px})
    (outcome,) = quantise(tiny, OWL, PICTURES)
    assert set(outcome.verdict.measured) == {"box_iou", "box_agreement"}
    broken, model = tmp_path / "broken.onnx", ModelOpener(tiny).model(OWL)
    scaled(tmp_path / OWL / "model.int8.onnx", broken, 1.0)
    with pytest.raises(RefusedError, match="refused"):
        adopt(tiny, model, "model", broken, PICTURES)


def test_what_has_no_recipe_or_no_pictures(clip: ModelSettings, tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=r"no recipe to quantise tokenizer; there is one for image, text"):
        list(quantise(clip, CLIP, PICTURES, parts=["tokenizer"]))
    with pytest.raises(ModelError, match="no recipe to quantise any part"):
        list(quantise(clip, "minilm-l6-v2", PICTURES))


def test_static_int8_of_a_real_detector(shared_data: Path, tmp_path: Path) -> None:
    """Convolutions, calibrated on a recording: NanoDet-m finds the same things with a third of the bytes."""
    name, frames = "nanodet-m", read_pictures(shared_data / "small_house" / "small_house_short.mcap", 8)
    (tmp_path / name).mkdir()
    shutil.copy(shared_data / "models" / "nanodet_m.onnx", tmp_path / name / "model.fp32.onnx")
    settings = ModelSettings(directory=str(tmp_path))
    (outcome,) = quantise(settings, name, frames)
    assert outcome.int8_bytes < outcome.float_bytes / 2
    assert outcome.verdict.measured["box_agreement"] > 0.75
    broken, model = tmp_path / "broken.onnx", ModelOpener(settings).model(name)
    scaled(tmp_path / name / "model.int8.onnx", broken, 1.0)
    with pytest.raises(RefusedError, match=r"box_agreement 0\.\d+ \(floor 0\.75\)"):
        adopt(settings, model, "model", broken, frames)
