"""NanoDet-m through our adapter against the published runner's arithmetic, written out cell by cell. The model is a test article that
lives beside the recordings; what needs no model is tested without it."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from irsd.core.errors import ModelError
from irsd.models import MINILM_WEIGHTS
from irsd.perception.aliases import AliasTable
from irsd.perception.families.nanodet import BINS, COCO_CLASSES, NanoDet, decode_boxes, letterbox
from irsd.perception.models import Session, packaged_path
from irsd.sensors.decode import decode_compressed_image
from irsd.sensors.replay import read_messages


@pytest.fixture(scope="module")
def session(shared_data: Path) -> Session:
    path = shared_data / "models" / "nanodet_m.onnx"
    if not path.is_file():
        pytest.skip(f"the test article is absent: {path}")
    return Session(path)


@pytest.fixture(scope="module")
def picture(shared_data: Path) -> NDArray[np.uint8]:
    """A frame with chairs and a bed in it, RGB."""
    recording = shared_data / "small_house" / "small_house_short.mcap"
    messages = list(read_messages(recording, ["/camera/image/compressed"]))
    return np.ascontiguousarray(decode_compressed_image(messages[90].data).bgr[..., ::-1])


def reference(session: Session, rgb: NDArray[np.uint8], threshold: float) -> list[tuple[int, float, list[float]]]:
    """(class, score, box) of every cell and class above the threshold, in plain Python after hpc203/nanodet-opncv-dnn-cpp-python."""
    height, width = rgb.shape[:2]
    bgr = cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR)
    new_h, new_w = (416, int(416 * width / height)) if height > width else (int(416 * height / width), 416)
    top, left = int((416 - new_h) * 0.5), int((416 - new_w) * 0.5)
    small = cv2.resize(bgr, (new_w, new_h), interpolation=cv2.INTER_AREA)
    square = cv2.copyMakeBorder(small, top, 416 - new_h - top, left, 416 - new_w - left, cv2.BORDER_CONSTANT, value=0)
    values = (square.astype(np.float32) - [103.53, 116.28, 123.675]) / [57.375, 57.12, 58.395]
    feeds = {session.inputs[0]: values.transpose(2, 0, 1)[None].astype(np.float32)}
    by_shape = {value.shape[1:]: value[0] for value in session.run(feeds, session.outputs)}
    found = []
    for stride in (8, 16, 32):
        side = 416 // stride
        scores, sides = by_shape[(side * side, 80)], by_shape[(side * side, 32)]
        for cell, column in zip(*np.nonzero(scores > threshold), strict=True):
            x = (cell % side) * stride + 0.5 * (stride - 1)
            y = (cell // side) * stride + 0.5 * (stride - 1)
            distance = []
            for k in range(4):
                e = [math.exp(v) for v in sides[cell, 8 * k : 8 * k + 8]]
                distance.append(stride * sum(j * w for j, w in enumerate(e)) / sum(e))
            box = [x - distance[0], y - distance[1], x + distance[2], y + distance[3]]
            box = [(b - (left, top)[i % 2]) * (width / new_w, height / new_h)[i % 2] for i, b in enumerate(box)]
            box = [min(max(b, 0.0), (width, height)[i % 2]) for i, b in enumerate(box)]
            found.append((int(column), float(scores[cell, column]), box))
    return found


@pytest.mark.parametrize("transpose", [False, True], ids=["landscape", "portrait"])
def test_equals_the_published_runner(session: Session, picture: NDArray[np.uint8], transpose: bool) -> None:
    rgb = np.ascontiguousarray(picture.transpose(1, 0, 2)) if transpose else picture
    prompts = tuple(names.split(" / ")[0] for names in COCO_CLASSES)
    ours = NanoDet(session, AliasTable.load(), threshold=0.2).detect(rgb, prompts)
    wanted = reference(session, rgb, 0.2)
    assert len(wanted) > 10
    got = sorted(zip(ours.prompt.tolist(), ours.scores.tolist(), ours.boxes_px.tolist(), strict=True))
    for mine, theirs in zip(got, sorted(wanted), strict=True):
        assert mine[0] == theirs[0]
        assert mine[1] == pytest.approx(theirs[1], abs=1e-6)
        np.testing.assert_allclose(mine[2], theirs[2], atol=1e-3)


def test_sees_the_bed_and_only_what_was_asked(session: Session, picture: NDArray[np.uint8]) -> None:
    detector = NanoDet(session, AliasTable.load())
    found = detector.detect(picture, ("lamp", "bed"))
    assert set(found.prompt.tolist()) == {1}
    assert found.scores.max() > 0.5
    assert found.boxes_px.dtype == found.scores.dtype == np.float32
    assert found.prompt.dtype == np.int32
    nothing = detector.detect(picture, ("lamp",))
    assert nothing.boxes_px.shape == (0, 4)
    assert detector.detect(picture, ()).scores.shape == (0,)


def test_prompts_are_matched_by_name_and_synonym(session: Session) -> None:
    detector = NanoDet(session, AliasTable.load())
    known = (
        "TV",
        "the fridges",
        "couch",
        "Kühlschrank",
        "monitor",
        "kitchen table",
        "person",
        "cell phone",
        "exercise ball",
    )
    assert set(detector.unknown((*known, "lamp", "office chair"))) <= {"lamp", "office chair", "exercise ball"}
    assert {"lamp", "office chair"} <= set(detector.unknown((*known, "lamp", "office chair")))


def test_two_names_of_one_class_share_its_boxes(session: Session, picture: NDArray[np.uint8]) -> None:
    found = NanoDet(session, AliasTable.load()).detect(picture, ("seat", "chair", "side chair"))
    assert set(found.prompt.tolist()) == {1}


def test_another_network_is_refused() -> None:
    session = Session(packaged_path(MINILM_WEIGHTS))
    with pytest.raises(ModelError):
        NanoDet(session, AliasTable.load()).detect(np.zeros((48, 64, 3), np.uint8), ("bed",))


def test_a_class_list_of_another_length_is_refused(session: Session, picture: NDArray[np.uint8]) -> None:
    with pytest.raises(ModelError, match="no NanoDet of 3 classes"):
        NanoDet(session, AliasTable.load(), classes=("bed", "chair", "sofa")).detect(picture, ("bed",))


def test_class_names_are_those_of_the_file(shared_data: Path) -> None:
    path = shared_data / "models" / "coco.names"
    theirs = path.read_text().split("\n")[:80]
    aliases = AliasTable.load()
    same_thing = {
        "motorbike": "motorcycle", "aeroplane": "airplane", "sports ball": "sports ball / ball", "pottedplant": "potted plant",
        "diningtable": "dining table", "tvmonitor": "television / monitor", "remote": "remote control", "hair drier": "hair dryer",
    }  # fmt: skip
    assert [same_thing.get(name, name) for name in theirs] == list(COCO_CLASSES)
    assert aliases.canonical("television") == "television"


@pytest.mark.parametrize("size", [(480, 640), (640, 480), (416, 416), (7, 1000), (1000, 7), (1, 1), (333, 517)])
def test_letterbox_keeps_places(size: tuple[int, int]) -> None:
    height, width = size
    pixels, scale, offset = letterbox(np.full((height, width, 3), 255, np.uint8), 416)
    assert pixels.shape == (1, 3, 416, 416)
    white = pixels[0, 0] > 2
    rows, columns = np.nonzero(white)
    corners = np.array([[columns.min(), rows.min()], [columns.max() + 1, rows.max() + 1]])
    np.testing.assert_allclose((corners - offset) * scale, [[0, 0], [width, height]], atol=1e-3)


def test_the_head_decodes_as_by_hand() -> None:
    rng = np.random.default_rng(5)
    sides = rng.normal(0, 3, (20, 4 * BINS)).astype(np.float32)
    sides[0] += 200  # a naive exponential would overflow
    centres, strides = rng.uniform(0, 416, (20, 2)).astype(np.float32), rng.choice([8, 16, 32], 20).astype(np.float32)
    got = decode_boxes(centres, strides, sides)
    for n in range(20):
        for k in range(4):
            logits = sides[n, BINS * k : BINS * k + BINS].astype(np.float64)
            weights = np.exp(logits - logits.max())
            distance = strides[n] * (weights / weights.sum()) @ np.arange(BINS)
            sign = -1 if k < 2 else 1
            assert got[n, k] == pytest.approx(centres[n, k % 2] + sign * distance, abs=2e-3)
