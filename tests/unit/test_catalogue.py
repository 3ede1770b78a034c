"""The catalogue: what is shipped is whole and free to use, and a wrong one is refused with every problem named."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import pytest

from irsd.core.errors import ModelError
from irsd.models import MINILM_VOCABULARY, MINILM_WEIGHTS
from irsd.perception import assemble
from irsd.perception.catalogue import ROLES, find_model, load_catalogue, parse_catalogue

ENTRY: dict[str, Any] = {
    "title": "A model",
    "roles": ["detector"],
    "family": "owl",
    "licence": "MIT",
    "source": "https://example.org",
    "base": "https://example.org/files/",
    "files": {
        "model": {"fp32": {"path": "onnx/model.onnx", "size_bytes": 10, "sha256": "a" * 64}},
        "tokenizer": {"path": "tokenizer.json", "sha256": None},
    },
    "contract": {"model": {"inputs": {"x?": "float32[1,n]"}, "outputs": {"y": "float32[n]"}}},
    "quantise": {"model": {"method": "matmul", "exclude": ["/a/MatMul"]}},
    "floors": {"box_iou": 0.9},
}


def parsed(**changes: Any) -> Any:
    return parse_catalogue({"schema": 1, "models": {"m": copy.deepcopy(ENTRY) | changes}})["m"]


def test_what_is_shipped_is_whole() -> None:
    catalogue = load_catalogue()
    assert set(ROLES) == {role for model in catalogue.values() for role in model.roles}
    families = {
        "tagger": assemble._TAGGERS,
        "detector": assemble._DETECTORS,
        "segmenter": assemble._SEGMENTERS,
        "image_encoder": assemble._IMAGE_ENCODERS,
        "text_encoder": assemble._TEXT_ENCODERS,
    }
    for model in catalogue.values():
        assert all(model.family in families[role] for role in model.roles), model.name
        assert set(model.recipes) <= set(model.contracts), model.name
        assert not model.recipes or model.floors, f"{model.name}: nothing would hold a quantised file back"
    assert {model.licence for model in catalogue.values() if not model.permissive} == {"apple-ascl"}


def test_pins_of_packaged_files_agree() -> None:
    text, vocabulary = load_catalogue()["minilm-l6-v2"].files
    for file, pin in ((text, MINILM_WEIGHTS), (vocabulary, MINILM_VOCABULARY)):
        assert (file.url, file.size_bytes, file.sha256) == (
            f"package:{pin.package}/{pin.name}",
            pin.size_bytes,
            pin.sha256,
        )


def test_an_entry_is_typed() -> None:
    model = parsed()
    weights, tokenizer = model.files
    assert (weights.local_name, weights.url) == ("model.fp32.onnx", "https://example.org/files/onnx/model.onnx")
    assert (tokenizer.local_name, tokenizer.sha256) == ("tokenizer.json", None)
    (x,), (y,) = model.contracts["model"].inputs, model.contracts["model"].outputs
    assert (x.name, x.optional, x.shape) == ("x", True, (1, "n"))
    assert (y.dtype, y.shape) == ("float32", ("n",))
    assert model.recipes["model"].exclude == ("/a/MatMul",)


def test_every_problem_is_named() -> None:
    with pytest.raises(ModelError) as refused:
        parsed(
            roles=["oracle"],
            colour="blue",
            files={"model": {"huge": {"path": "a", "url": "b", "sha256": "12"}}},
            contract={"model": {"inputs": {"x": "float[1"}}, "other": {}},
            quantise={"model": {"method": "magic"}},
            cost={"model": {"cpu_ms": 3, "rss_mb": [1, None], "peak_mb": [1, 2]}},
            floors={"box_iou": 2, "beauty": 0.5},
        )
    for complaint in (
        "m.colour: unknown key",
        "m.roles = ['oracle']",
        "m.files.model.huge: is no precision",
        "needs a path (below base) or a url",
        "must begin with https://",
        "sha256 = '12'",
        "must look like float32[batch,3,224,224]",
        "m.contract.other: there is no such part",
        "method = 'magic'",
        "cpu_ms = 3",
        "m.floors.box_iou = 2",
        "m.floors.beauty: unknown key",
    ):
        assert complaint in str(refused.value)
    with pytest.raises(ModelError, match=r"contract: lacks model"):
        parsed(contract={}, quantise={})


def test_a_site_lays_its_own_over(tmp_path: Path) -> None:
    pin = "b" * 64
    (tmp_path / "catalogue.yaml").write_text(
        f"schema: 1\nmodels: {{clip-vit-b32: {{files: {{image: {{fp32: {{sha256: {pin}, size_bytes: 5}}}}}}}}}}\n"
    )
    image = load_catalogue(tmp_path)["clip-vit-b32"].files_of("image")
    assert (image[0].sha256, image[0].size_bytes, image[0].precision) == (pin, 5, "fp32")
    assert image[0].url.endswith("onnx/vision_model.onnx")
    (tmp_path / "catalogue.yaml").write_text("models: [")
    with pytest.raises(ModelError, match="is not YAML"):
        load_catalogue(tmp_path)


def test_names_and_licences() -> None:
    catalogue = load_catalogue()
    assert find_model(catalogue, "clip-vit-b32@int8") == (catalogue["clip-vit-b32"], "int8")
    with pytest.raises(ModelError, match=r"no model is called 'clip'; known are .*clip-vit-b16"):
        find_model(catalogue, "clip")
    catalogue["clip-vit-b32"].check_licence(())
    with pytest.raises(ModelError, match=r"accept_license: apple-ascl"):
        catalogue["mobileclip-s0"].check_licence(("another",))
    catalogue["mobileclip-s0"].check_licence(("apple-ascl",))
