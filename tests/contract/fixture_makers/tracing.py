"""Exports of models that optimum does not know, as the published scripts do it."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path

import torch

from fixture_makers.common import OPSET, check_export, shorten


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
