"""The structure network's adapter, on a real ONNX file: one matrix product, written byte by byte."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tiny_onnx import node, tensor, value_info, write

from irsd.core.errors import ModelError
from irsd.core.types import MapBlock
from irsd.perception.structure_net import PointNetwork


def write_model(path: Path, weights: np.ndarray, output: str = "logits") -> Path:
    """points [n, 3] @ weights [3, K] -> output [n, K]."""
    return write(
        path,
        node("MatMul", ("points", "w"), output),
        tensor("w", weights),
        value_info(11, "points", ("n", 3)),
        value_info(12, output, ("n", weights.shape[1])),
    )


def block(points: np.ndarray) -> MapBlock:
    n = len(points)
    return MapBlock(points, np.zeros_like(points), points, np.zeros((n, 4), np.float32), np.zeros(n, np.uint8))


def test_the_class_of_a_point_is_the_highest_of_its_logits(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    weights = rng.normal(size=(3, 6)).astype(np.float32)
    points = rng.normal(size=(50, 3)).astype(np.float32)
    found = PointNetwork(write_model(tmp_path / "net.onnx", weights)).classify(block(points))
    np.testing.assert_array_equal(found, (points @ weights).argmax(1))
    assert found.dtype == np.uint8


def test_a_network_of_another_kind_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="lacks logits"):
        PointNetwork(write_model(tmp_path / "a.onnx", np.zeros((3, 6)), "scores"))
    few = PointNetwork(write_model(tmp_path / "b.onnx", np.zeros((3, 4))))
    with pytest.raises(ModelError, match="shape"):
        few.classify(block(np.zeros((2, 3), np.float32)))
    with pytest.raises(ModelError):
        PointNetwork(tmp_path / "absent.onnx")
