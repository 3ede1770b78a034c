"""The structure network's adapter, on a real ONNX file: one matrix product, written byte by byte."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tiny_onnx import node, tensor, value_info, write

from irsd.core.errors import ModelError
from irsd.core.types import MapBlock, Structure
from irsd.perception.structure_net import SHIPPED, NanoStructure, PointNetwork, structure_model


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


def test_the_shipped_network_knows_an_empty_room() -> None:
    a, b = (v.ravel() for v in np.meshgrid(np.arange(0.02, 4, 0.05), np.arange(0.02, 2.6, 0.05)))
    c, d = (v.ravel() for v in np.meshgrid(np.arange(0.02, 4, 0.05), np.arange(0.02, 3, 0.05)))
    zero, high = np.zeros_like(c), np.full_like(c, 2.6)
    sides = [
        (np.stack([a, 0 * a, b], 1), (0, 1, 0)),
        (np.stack([c, d, zero], 1), (0, 0, 1)),
        (np.stack([c, d, high], 1), (0, 0, -1)),
    ]
    points = np.concatenate([p for p, _ in sides]).astype(np.float32)
    normals = np.concatenate([np.tile(np.float32(n), (len(p), 1)) for p, n in sides])
    truth = np.repeat([Structure.WALL, Structure.FLOOR, Structure.CEILING], [len(p) for p, _ in sides])
    levels = np.tile(np.float32([0, 2.6, np.nan, np.nan]), (len(points), 1))
    levels[truth == Structure.WALL, 2:] = 0
    model = structure_model(SHIPPED)
    assert isinstance(model, NanoStructure)
    found = model.classify(MapBlock(points, normals, points, levels, truth.astype(np.uint8)))
    for kind in (Structure.WALL, Structure.FLOOR, Structure.CEILING):
        assert (found[truth == kind] == kind).mean() > 0.9, kind


def test_no_name_is_no_network() -> None:
    assert structure_model("") is None
