"""irsctl models, as its users call it: output, exit codes, completion."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import onnx
import pytest
import yaml
from click.testing import CliRunner, Result
from contract_fixtures import FIXTURES, pictures

from irsd.ctl.app import cli
from irsd.ctl.models import read_pictures
from irsd.perception.models import sha256_of

CLIP = "clip-vit-b32"
FILES = {
    "vision_model.onnx": "vision_model.onnx",
    "text_model.onnx": "text_model.onnx",
    "tokenizer.json": "tokenizer.json",
}


@pytest.fixture(autouse=True)
def no_system_configuration(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    empty = tmp_path / "irsd.yaml"
    empty.write_text("")
    monkeypatch.setenv("IRSD_CONFIG", str(empty))
    monkeypatch.setenv("OMP_NUM_THREADS", "1")


@pytest.fixture
def stick(tmp_path: Path) -> Path:
    """A folder with the tiny files under their published names, and pictures."""
    folder = tmp_path / "stick"
    folder.mkdir()
    for name in FILES:
        shutil.copy(FIXTURES / "clip" / name, folder / name)
    (folder / "seen").mkdir()
    for name, picture in pictures().items():
        cv2.imwrite(str(folder / "seen" / f"{name}.png"), picture[..., ::-1])
    return folder


@pytest.fixture
def shelf(tmp_path: Path) -> Path:
    """A model folder whose catalogue knows that this CLIP is tiny."""
    folder = tmp_path / "models"
    folder.mkdir()
    tiny = {
        "preprocess": {"side_px": 32},
        "contract": {
            "image": {
                "inputs": {"pixel_values": "float32[batch,3,32,32]"},
                "outputs": {"image_embeds": "float32[batch,size]"},
            },
            "text": {"outputs": {"text_embeds": "float32[batch,size]"}},
        },
        "floors": {"cosine": 0.95, "retrieval": 0.8},
    }
    (folder / "catalogue.yaml").write_text(yaml.safe_dump({"schema": 1, "models": {CLIP: tiny}}))
    return folder


def run(*words: object) -> Result:
    return CliRunner().invoke(cli, ["models", *map(str, words)], standalone_mode=False)


def answer(*words: object) -> tuple[int, dict]:
    result = run(*words, "--json")
    assert result.exception is None, result.output
    return int(result.return_value), json.loads(result.stdout)


def test_from_nothing_to_int8(shelf: Path, stick: Path) -> None:
    code, refused = answer("pull", CLIP, "--dir", shelf, "--from", stick)
    assert (code, refused["exit_code"]) == (7, 7)
    assert "--trust-first-use" in refused["error"]

    pin = sha256_of(stick / "vision_model.onnx")
    code, pulled = answer(
        "pull", CLIP, "--dir", shelf, "--from", stick, "--trust-first-use", "--sha256", f"image={pin}"
    )
    assert code == 0
    assert [file["how"] for file in pulled["files"]] == ["fetched"] * 3

    code, checked = answer("check", CLIP, "--dir", shelf)
    assert code == 0, checked
    assert [report["threads"] for report in checked["reports"]] == [1, 2]
    assert {cost["part"] for cost in checked["reports"][0]["costs"]} == {"image", "text"}
    assert all(report["rss_mb"] > 0 and report["problems"] == [] for report in checked["reports"])

    code, quantised = answer("quantise", CLIP, "--dir", shelf, "--frames", stick / "seen")
    assert code == 0, quantised
    assert [part["part"] for part in quantised["parts"]] == ["image", "text"]
    assert quantised["parts"][0]["verdict"]["measured"]["cosine"] > 0.95

    code, listed = answer("list", "--dir", shelf)
    files = next(model for model in listed["models"] if model["name"] == CLIP)["files"]
    judged = {(file["part"], file["precision"]): bool(file["judged"]) for file in files if file["here"]}
    assert judged[("image", "int8")]
    assert not judged[("image", "fp32")]
    assert f"{CLIP} " in run("list", "--dir", shelf).stdout


def test_text_for_people(shelf: Path, stick: Path) -> None:
    pulled = run("pull", CLIP, "--dir", shelf, "--from", stick, "--trust-first-use")
    assert pulled.return_value == 0
    assert pulled.stdout.count("fetched") == 3
    checked = run("check", CLIP, "--dir", shelf)
    assert checked.return_value == 0
    assert "keeps its contract; opens in" in checked.stdout
    listed = run("list", "--dir", shelf).stdout
    assert next(line for line in listed.splitlines() if line.startswith(CLIP)).split()[4] == "fp32"
    assert f"folder: {shelf}" in listed


def test_a_file_that_breaks_the_contract(shelf: Path, stick: Path) -> None:
    model = onnx.load(str(stick / "vision_model.onnx"))
    model.graph.output[0].name = "vectors"
    for node in model.graph.node:
        node.output[:] = ["vectors" if name == "image_embeds" else name for name in node.output]
    onnx.save(model, str(stick / "vision_model.onnx"))
    assert run("pull", CLIP, "--dir", shelf, "--from", stick, "--trust-first-use").return_value == 0
    result = run("check", CLIP, "--dir", shelf)
    assert result.return_value == 7
    assert "image: output image_embeds is missing, there is vectors" in result.stderr
    code, document = answer("check", CLIP, "--dir", shelf)
    assert code == 7
    assert document["reports"][0]["problems"]


def test_refusals_have_their_exit_codes(shelf: Path, stick: Path, tmp_path: Path) -> None:
    assert answer("check", "no-such-model", "--dir", shelf)[0] == 4
    assert answer("pull", "clip-vit-b16", "--dir", shelf, "--from", tmp_path / "nowhere", "--trust-first-use")[0] == 5
    code, document = answer("pull", "mobileclip-s0", "--dir", shelf, "--from", stick)
    assert code == 1
    assert "accept_license: apple-ascl" in document["error"]
    code, document = answer("check", "owlvit-b32", "--dir", shelf)
    assert code == 1
    assert "irsctl models pull owlvit-b32" in document["error"]
    code, document = answer("pull", "mobile-sam@int8", "--dir", shelf)
    assert code == 1
    assert "has no int8 of encoder to fetch, only fp32" in document["error"]
    assert answer("check", f"{CLIP}@int4", "--dir", shelf)[1]["error"] == f"{CLIP} has no int4, only fp32, int8"
    code, document = answer("check", "minilm-l6-v2", "--dir", shelf)
    assert (code, document["reports"][0]["precisions"]) == (0, {"text": "int8"})
    usage = CliRunner().invoke(cli, ["models", "pull", CLIP, "--dir", str(shelf), "--sha256", "image=12"])
    assert usage.exit_code == 2
    empty = tmp_path / "empty"
    empty.mkdir()
    assert "has no pictures" in answer("quantise", CLIP, "--frames", empty, "--dir", shelf)[1]["error"]


def test_names_are_completed(shelf: Path) -> None:
    environment = {"_IRSCTL_COMPLETE": "bash_complete", "COMP_WORDS": "irsctl models pull clip-", "COMP_CWORD": "3"}
    shown = CliRunner().invoke(cli, env=environment, prog_name="irsctl").stdout
    assert shown.split() == ["plain,clip-vit-b32", "plain,clip-vit-b16"]


def test_pictures_of_a_recording(shared_data: Path) -> None:
    found = read_pictures(shared_data / "small_house" / "small_house_short.mcap", 5)
    assert [picture.shape for picture in found] == [(480, 640, 3)] * 5
    assert found[0].dtype == np.uint8
    assert not np.array_equal(found[0], found[1])
