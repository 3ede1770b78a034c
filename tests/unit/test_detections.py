"""Detections: the halves are checked, paired by stamp, and contradictions are refused."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from irsd.core.errors import DecodeError
from irsd.core.types import Detections
from irsd.perception.detections import DetectionPairer, IdsImage, build, parse_info
from irsd.sensors.decode import decode_detections
from irsd.sensors.encode import encode_detections


def document(stamp_ns: int = 5, entries: list[dict[str, Any]] | None = None, **more: Any) -> bytes:
    entries = [{"id": 2, "label": "sofa", "score": 0.5}] if entries is None else entries
    return json.dumps({"stamp_ns": stamp_ns, "frame_id": "cam", "detections": entries} | more).encode()


def ids(*numbers: int, stamp_ns: int = 5) -> IdsImage:
    pixels = np.zeros((3, 4), np.uint16)
    pixels.flat[: len(numbers)] = numbers
    return IdsImage(stamp_ns, "cam", pixels)


def test_nothing_seen_is_a_normal_value() -> None:
    got = build(5, "cam", ids().ids_px, parse_info(document(entries=[])))
    assert (len(got.number), got.label, got.top_labels, got.embedding) == (0, (), (), None)
    assert got.number.dtype == np.int32
    assert got.score.dtype == np.float32


def test_entries_are_sorted_by_number_and_hidden_ones_left_out() -> None:
    entries = [
        {"id": 9, "label": "tv", "score": 0.9, "labels": [["lamp", 0.2], ["tv", 0.9]]},
        {"id": 4, "label": "hidden", "score": 0.1},
        {"id": 2, "label": " sofa ", "score": 1},
    ]
    got = build(5, "cam", ids(9, 2, 2).ids_px, parse_info(document(entries=entries)))
    assert got.number.tolist() == [2, 9]
    assert got.label == ("sofa", "tv")
    assert got.top_labels == ((("sofa", 1.0),), (("tv", 0.9), ("lamp", 0.2)))


def test_embeddings_become_unit_length() -> None:
    entries = [{"id": k, "label": "a", "score": 0.5, "embedding": [3 * k, 4 * k]} for k in (1, 2)]
    got = build(5, "cam", ids(1, 2).ids_px, parse_info(document(entries=entries)))
    assert got.embedding is not None
    assert got.embedding.dtype == np.float32
    np.testing.assert_allclose(got.embedding, [[0.6, 0.8], [0.6, 0.8]])


ENTRY = {"id": 2, "label": "sofa", "score": 0.5}


@pytest.mark.parametrize(
    ("payload", "says"),
    [
        (b"", "not JSON"),
        (b"[1]", "expected an object"),
        (b'{"stamp_ns": NaN}', "NaN"),
        (b"[" * 100_000, "not JSON"),
        (b"\xff\xfe", "not JSON"),
        (document(stamp_ns=True), "stamp_ns"),
        (document(stamp_ns=-1), "stamp_ns"),
        (document(frame_id=3), "frame_id"),
        (document(detections={}), "must be a list"),
        (document(entries=[ENTRY, ENTRY]), "twice"),
        (document(entries=[ENTRY, 3]), "entry 1: expected an object"),
        (document(entries=[ENTRY | {"id": 0}]), "id = 0"),
        (document(entries=[ENTRY | {"id": 65536}]), "65536"),
        (document(entries=[ENTRY | {"label": " "}]), "label"),
        (document(entries=[ENTRY | {"score": 1.5}]), "score = 1.5"),
        (document(entries=[ENTRY | {"score": True}]), "score"),
        (document(entries=[ENTRY | {"labels": [["a"]]}]), "labels"),
        (document(entries=[ENTRY | {"labels": [["a", 2]]}]), "labels"),
        (document(entries=[ENTRY | {"embedding": []}]), "embedding"),
        (document(entries=[ENTRY | {"embedding": [0, 0]}]), "direction"),
        (document(entries=[ENTRY | {"embedding": ["a"]}]), "numbers"),
        (document(entries=[ENTRY | {"embedding": [10**400]}]), "embedding"),
        (document(entries=[ENTRY | {"embedding": [1e200]}]), "direction"),
        (document(entries=[ENTRY | {"embedding": [1, 2]}, {"id": 3, "label": "a", "score": 0}]), "every entry"),
        (document(entries=[ENTRY | {"embedding": [1]}, ENTRY | {"id": 3, "embedding": [1, 2]}]), "same length"),
    ],
)
def test_documents_that_are_wrong_are_refused_with_the_reason(payload: bytes, says: str) -> None:
    with pytest.raises(DecodeError, match=says):
        parse_info(payload)


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(
            st.sampled_from(["id", "label", "score", "labels", "embedding", "detections", "stamp_ns"]), inner
        )
    ),
    max_leaves=12,
)


@given(json_values)
def test_any_json_only_raises_decode_error(value: Any) -> None:
    for payload in (json.dumps(value), document(detections=value), document(entries=[ENTRY | {"embedding": value}])):
        try:
            info = parse_info(payload)
        except DecodeError:
            continue
        assert len(info.number) == len(info.label) == len(info.top_labels) == len(info.score)


@pytest.mark.parametrize(
    ("image", "says"),
    [
        (ids(2, 7), r"\[7\]"),
        (ids(2, stamp_ns=6), "ids are of 6 ns"),
        (IdsImage(5, "cam", np.zeros((2, 2), np.float32)), "whole numbers"),  # type: ignore[arg-type]
        (IdsImage(5, "cam", np.zeros((2, 2, 3), np.uint16)), "whole numbers"),
        (IdsImage(5, "cam", np.full((2, 2), 70000, np.int64)), "0..65535"),  # type: ignore[arg-type]
    ],
)
def test_halves_that_contradict_each_other_are_refused(image: IdsImage, says: str) -> None:
    with pytest.raises(DecodeError, match=says):
        build(image.stamp_ns, image.frame_id, image.ids_px, parse_info(document()))


def test_halves_pair_in_any_order_and_none_is_held_for_ever() -> None:
    pairer = DetectionPairer(capacity=2)
    assert pairer.push_ids(ids(2)) is None
    first = pairer.push_info(document())
    assert pairer.push_info(document(stamp_ns=6)) is None
    second = pairer.push_ids(ids(2, stamp_ns=6))
    assert first is not None
    assert second is not None
    assert (first.stamp_ns, second.stamp_ns, pairer.unpaired) == (5, 6, 0)
    for stamp_ns in range(10, 15):
        pairer.push_ids(ids(2, stamp_ns=stamp_ns))
        pairer.push_info(document(stamp_ns=stamp_ns + 100))
    assert pairer.unpaired == 6
    pairer.push_ids(ids(2, stamp_ns=14))  # sent twice
    assert pairer.unpaired == 7


@given(st.integers(0, 6), st.booleans(), st.integers(0, 1000))
def test_encoded_detections_come_back(count: int, embedded: bool, seed: int) -> None:
    rng = np.random.default_rng(seed)
    number = np.sort(rng.choice(np.arange(1, 65536), count, replace=False)).astype(np.int32)
    pixels = np.zeros(30, np.uint16)
    pixels[:count] = number
    embedding = rng.normal(size=(count, 5))
    sent = Detections(
        stamp_ns=1_700_000_000_000_000_001,
        frame_id="cam",
        ids_px=rng.permutation(pixels).reshape(5, 6),
        number=number,
        score=rng.uniform(0, 1, count).astype(np.float32),
        label=tuple(f"thing {k}" for k in range(count)),
        top_labels=tuple(((f"thing {k}", 0.5), ("other", 0.25)) for k in range(count)),
        embedding=(embedding / np.linalg.norm(embedding, axis=1, keepdims=True)).astype(np.float32)
        if embedded
        else None,
    )
    got = decode_detections(*encode_detections(sent))
    assert (got.stamp_ns, got.frame_id, got.label, got.top_labels) == (
        sent.stamp_ns,
        "cam",
        sent.label,
        sent.top_labels,
    )
    np.testing.assert_array_equal(got.ids_px, sent.ids_px)
    np.testing.assert_array_equal(got.number, sent.number)
    np.testing.assert_allclose(got.score, sent.score, rtol=1e-7)
    if sent.embedding is not None and count:
        np.testing.assert_allclose(got.embedding, sent.embedding, atol=1e-7)
    else:
        assert got.embedding is None
