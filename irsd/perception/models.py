"""The only door to onnxruntime: find a model file, check its bytes, open it with options that suit a budgeted daemon."""

from __future__ import annotations

import hashlib
import importlib.resources
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime
from numpy.typing import NDArray

from irsd.core.errors import ModelError
from irsd.models import PackagedFile

# onnxruntime's exceptions share no base below Exception: take them all from where they are defined.
_ERRORS: tuple[type[Exception], ...] = (
    RuntimeError,
    ValueError,
    *(
        kind
        for kind in vars(onnxruntime.capi.onnxruntime_pybind11_state).values()
        if isinstance(kind, type) and issubclass(kind, Exception)
    ),
)


def packaged_path(file: PackagedFile) -> Path:
    """Where the file is, after checking its size and sha256. ModelError says what to do when it is missing or altered."""
    try:
        path = Path(str(importlib.resources.files(file.package).joinpath(file.name)))
    except ModuleNotFoundError:
        raise ModelError(f"the Python package {file.package} is not installed: {file.advice}") from None
    check_file(path, file.size_bytes, file.sha256, file.advice)
    return path


def check_file(path: Path, size_bytes: int, sha256: str, advice: str) -> None:
    """ModelError unless the file has exactly this size and checksum."""
    try:
        size = path.stat().st_size
    except OSError:
        raise ModelError(f"model file {path} is missing: {advice}") from None
    if size != size_bytes:
        raise ModelError(f"model file {path} has {size} bytes, expected {size_bytes}: {advice}")
    with path.open("rb") as stream:
        found = hashlib.file_digest(stream, "sha256").hexdigest()
    if found != sha256:
        raise ModelError(f"model file {path} was altered (sha256 {found[:12]}, expected {sha256[:12]}): {advice}")


class Session:
    """One network on the CPU: arrays in and out by name. Safe to call from several threads."""

    def __init__(self, path: Path, *, threads: int = 1, inputs: tuple[str, ...] = (), outputs: tuple[str, ...] = ()):
        """inputs, outputs: names the caller relies on; ModelError when the file lacks one or is no ONNX model.

        The options were measured: spinning threads burn CPU while they wait; the memory arena (an allocator that never gives back)
        can hold gigabytes after one large run, and costs no speed when off.
        """
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads
        options.inter_op_num_threads = 1
        options.execution_mode = onnxruntime.ExecutionMode.ORT_SEQUENTIAL
        options.enable_cpu_mem_arena = False
        options.enable_mem_pattern = False
        options.log_severity_level = 3
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")
        try:
            self._session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
        except _ERRORS as error:
            raise ModelError(f"{path} is no model that onnxruntime can open: {error}") from error
        self.path = path
        self.inputs = tuple(node.name for node in self._session.get_inputs())
        self.outputs = tuple(node.name for node in self._session.get_outputs())
        lacking = [name for name in inputs if name not in self.inputs]
        lacking += [name for name in outputs if name not in self.outputs]
        if lacking:
            raise ModelError(
                f"{path} lacks {', '.join(lacking)}; it has inputs {self.inputs} and outputs {self.outputs}"
            )

    def run(self, feeds: Mapping[str, NDArray[Any]], outputs: tuple[str, ...]) -> tuple[NDArray[np.float32], ...]:
        """The named outputs for the named inputs; ModelError when onnxruntime refuses the inputs."""
        try:
            values = self._session.run(list(outputs), dict(feeds))
        except _ERRORS as error:
            raise ModelError(f"{self.path.name} failed: {error}") from error
        return tuple(np.asarray(value) for value in values)
