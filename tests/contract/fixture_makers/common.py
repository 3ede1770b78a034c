"""What the makers share: seeded models, export as optimum does it, files without the names that fill them."""

from __future__ import annotations

import copy
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import onnxruntime
import torch
from numpy.typing import NDArray
from optimum.exporters.onnx import export as optimum_export
from optimum.exporters.onnx.base import OnnxConfig

OPSET = 17


def seeded(build: Callable[[], torch.nn.Module], seed: int) -> torch.nn.Module:
    """A model in evaluation mode, with noise on every tensor that starts as a constant: zero biases would hide mistakes."""
    torch.manual_seed(seed)
    model = build()
    with torch.no_grad():
        for parameter in model.parameters():
            if parameter.numel() > 1 and bool((parameter == parameter.flatten()[0]).all()):
                parameter.add_(torch.randn_like(parameter) * 0.2)
    return model.eval()


def export(model: torch.nn.Module, config: OnnxConfig, path: Path) -> None:
    """By optimum's exporter, whose files are those that users pull."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        # On a copy: the exporter's dummy inputs and patches are no business of the reference.
        optimum_export(model=copy.deepcopy(model), config=config, output=path, opset=OPSET)
    shorten(path)


def run(path: Path, **feeds: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """All outputs of an ONNX file by name."""
    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    return dict(zip([node.name for node in session.get_outputs()], session.run(None, feeds), strict=True))


def check_export(path: Path, expected: dict[str, torch.Tensor], **feeds: NDArray[Any]) -> None:
    """The file gives what torch gives, or the export itself is at fault, not the adapter."""
    found = run(path, **feeds)
    for name, value in expected.items():
        # Infinities (logits of no token) are equal to themselves.
        ours, theirs = (
            np.nan_to_num(array, posinf=1e9, neginf=-1e9) for array in (found[name], value.detach().numpy())
        )
        worst = float(np.abs(ours - theirs).max())
        assert worst < 1e-4, f"{path.name}: {name} is {worst} off torch"


def save(folder: Path, **arrays: NDArray[Any]) -> None:
    """reference.npz, the same bytes for the same arrays."""
    np.savez_compressed(folder / "reference.npz", **arrays)


def shorten(path: Path) -> None:
    """Names of nodes, weights and intermediate values replaced by numbers: in a tiny network they are most of the bytes."""
    model = onnx.load(path)
    kept = {value.name for value in (*model.graph.input, *model.graph.output)} | {""}
    numbers: dict[str, str] = {}

    def short(name: str) -> str:
        return name if name in kept else numbers.setdefault(name, f"{len(numbers):x}")

    for graph in _graphs(model.graph):
        del graph.value_info[:]
        for weight in graph.initializer:
            weight.name = short(weight.name)
        for value in (*graph.input, *graph.output):
            value.name = short(value.name)
        for node in graph.node:
            node.name = node.doc_string = ""
            node.input[:] = [short(name) for name in node.input]
            node.output[:] = [short(name) for name in node.output]
    onnx.checker.check_model(model)
    onnx.save(model, path)


def _graphs(graph: onnx.GraphProto) -> Iterator[onnx.GraphProto]:
    """The graph and those of its branches and loops."""
    yield graph
    for node in graph.node:
        for attribute in node.attribute:
            if attribute.HasField("g"):
                yield from _graphs(attribute.g)
