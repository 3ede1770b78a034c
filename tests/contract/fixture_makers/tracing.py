"""Exports of models that optimum does not know, as the published scripts do it, and files without the names that fill them."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path

import onnx
import torch

from fixture_makers.common import OPSET, check_export


def trace(
    module: torch.nn.Module, inputs: dict[str, torch.Tensor], outputs: Sequence[str], dynamic: dict, path: Path
) -> None:
    """The module's forward(*inputs) as an ONNX file that gives what torch gives."""
    module.eval()
    with warnings.catch_warnings(), torch.no_grad():
        warnings.simplefilter("ignore")
        torch.onnx.export(
            module, tuple(inputs.values()), path, input_names=list(inputs), output_names=list(outputs),
            dynamic_axes=dynamic, opset_version=OPSET, dynamo=False,
        )  # fmt: skip
        shorten(path)
        results = module(*inputs.values())
    results = results if isinstance(results, tuple) else (results,)
    check_export(
        path, dict(zip(outputs, results, strict=True)), **{name: value.numpy() for name, value in inputs.items()}
    )


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
