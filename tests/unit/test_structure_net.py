"""The structure network's adapter, on a real ONNX file: one matrix product, written byte by byte."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from irsd.core.errors import ModelError
from irsd.perception.structure_net import PointNetwork


def varint(value: int) -> bytes:
    out = b""
    while value > 127:
        out, value = out + bytes([value & 127 | 128]), value >> 7
    return out + bytes([value])


def number(field: int, value: int) -> bytes:
    return varint(field << 3) + varint(value)


def block(field: int, *parts: bytes) -> bytes:
    body = b"".join(parts)
    return varint(field << 3 | 2) + varint(len(body)) + body


def value_info(field: int, name: str, columns: int) -> bytes:
    shape = block(2, block(1, block(2, b"n")), block(1, number(1, columns)))
    return block(field, block(1, name.encode()), block(2, block(1, number(1, 1), shape)))


def write_model(path: Path, weights: np.ndarray, output: str = "logits") -> Path:
    """points [n, 3] @ weights [3, K] -> output [n, K]."""
    node = block(1, block(1, b"points"), block(1, b"w"), block(2, output.encode()), block(4, b"MatMul"))
    dims = b"".join(number(1, d) for d in weights.shape)
    tensor = block(5, dims, number(2, 1), block(8, b"w"), block(9, weights.astype("<f4").tobytes()))
    ends = value_info(11, "points", 3) + value_info(12, output, weights.shape[1])
    graph = block(7, node, block(2, b"g"), tensor, ends)
    path.write_bytes(number(1, 8) + graph + block(8, block(1, b""), number(2, 13)))
    return path


def test_the_class_of_a_point_is_the_highest_of_its_logits(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    weights = rng.normal(size=(3, 6)).astype(np.float32)
    points = rng.normal(size=(50, 3)).astype(np.float32)
    found = PointNetwork(write_model(tmp_path / "net.onnx", weights)).classify(points)
    np.testing.assert_array_equal(found, (points @ weights).argmax(1))
    assert found.dtype == np.uint8


def test_a_network_of_another_kind_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="lacks logits"):
        PointNetwork(write_model(tmp_path / "a.onnx", np.zeros((3, 6)), "scores"))
    few = PointNetwork(write_model(tmp_path / "b.onnx", np.zeros((3, 4))))
    with pytest.raises(ModelError, match="shape"):
        few.classify(np.zeros((2, 3), np.float32))
    with pytest.raises(ModelError):
        PointNetwork(tmp_path / "absent.onnx")
