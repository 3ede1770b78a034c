"""The only door to onnxruntime: find a model file, check its bytes, open it with options that suit a budgeted daemon."""

from __future__ import annotations

import ctypes
import hashlib
import importlib
import importlib.resources
import logging
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

# onnxruntime's wheels send usage data to its maker, with an id of the machine; read once, at import
os.environ["ORT_DISABLE_TELEMETRY"] = "1"
import onnxruntime

from irsd.core.errors import ModelError, RunCancelledError
from irsd.core.runtime import Guarded
from irsd.models import PackagedFile

_log = logging.getLogger(__name__)

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

CPU = "cpu"
# Our words for onnxruntime's execution providers, and the options that keep their memory bounded.
PROVIDERS: dict[str, tuple[str, dict[str, str]]] = {
    "tensorrt": ("TensorrtExecutionProvider", {}),
    "cuda": ("CUDAExecutionProvider", {"arena_extend_strategy": "kSameAsRequested"}),
    "openvino": ("OpenVINOExecutionProvider", {}),
    CPU: ("CPUExecutionProvider", {}),
}


def onnxruntime_version() -> str:
    """What runs the networks; a quantised file was judged with one version."""
    return str(onnxruntime.__version__)


def quantisation_tools() -> Any:
    """onnxruntime's own module of that name. ModelError when it can't be had."""
    onnxruntime.set_default_logger_severity(3)  # it opens networks in its own way, and those chat
    try:
        return importlib.import_module("onnxruntime.quantization")
    except ImportError as error:
        raise ModelError(f"quantising needs the package onnx ({error}): pip install 'irsd[quantise]'") from error


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
    found = sha256_of(path)
    if found != sha256:
        raise ModelError(f"model file {path} was altered (sha256 {found[:12]}, expected {sha256[:12]}): {advice}")


def sha256_of(path: Path) -> str:
    """The checksum of a file's bytes, 64 hexadecimal digits."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


class Cancel:
    """The wish that runs end early. Any thread may ask; runs that carry this object raise RunCancelledError until ``clear``.

    onnxruntime looks between nodes only: a run ends when its current node does, which can be a quarter of a large encoder.
    """

    def __init__(self) -> None:
        self._running: Guarded[list[Any]] = Guarded([])
        self._requested = False

    @property
    def requested(self) -> bool:
        return self._requested

    def request(self) -> None:
        """Ends what runs now, and keeps others from starting."""
        with self._running.locked() as running:
            self._requested = True
            for options in running:
                options.terminate = True

    def clear(self) -> None:
        """Runs may start again."""
        with self._running.locked():
            self._requested = False

    def _enter(self, options: Any) -> None:
        with self._running.locked() as running:
            options.terminate = self._requested
            running.append(options)

    def _leave(self, options: Any) -> None:
        with self._running.locked() as running:
            running.remove(options)


@dataclass(frozen=True, slots=True)
class Tensor:
    """An input or output as the file declares it. dtype: ``float32``, ``int64`` .. ; a free dimension has a name or None."""

    name: str
    dtype: str
    shape: tuple[int | str | None, ...]


class Session:
    """One network: arrays in and out by name. Safe to call from several threads.

    providers: what runs it, best first. fallback: what was asked for and is not to be had, in words; empty when all is as asked.
    """

    def __init__(
        self,
        path: Path,
        *,
        threads: int = 1,
        inputs: tuple[str, ...] = (),
        outputs: tuple[str, ...] = (),
        providers: tuple[str, ...] = (CPU,),
        cancel: Cancel | None = None,
    ):
        """inputs, outputs: names the caller relies on; ModelError when the file lacks one or is no ONNX model.

        providers: keys of ``PROVIDERS``, best first; the CPU is the last resort whether named or not.
        cancel: ends the runs of this session, where a run brings none of its own.
        """
        wanted = list(dict.fromkeys((*providers, CPU)))
        unknown = [name for name in wanted if name not in PROVIDERS]
        if unknown:
            raise ModelError(f"unknown execution provider {', '.join(unknown)}; known are {', '.join(PROVIDERS)}")
        here = onnxruntime.get_available_providers()
        usable = [_provider(name, threads) for name in wanted if PROVIDERS[name][0] in here]
        try:
            self._session = onnxruntime.InferenceSession(str(path), _options(threads), providers=usable)
        except _ERRORS as error:
            raise ModelError(f"{path} is no model that onnxruntime can open: {error}") from error
        _give_back()
        self.path = path
        self._cancel = cancel
        running = self._session.get_providers()
        self.providers = tuple(name for name in wanted if PROVIDERS[name][0] in running)
        lost = [name for name in wanted if name not in self.providers]
        self.fallback = f"{', '.join(lost)} not available, runs on {self.providers[0]}" if lost else ""
        if lost:
            _log.warning("%s: %s", path.name, self.fallback)
        self.input_tensors = tuple(_tensor(node) for node in self._session.get_inputs())
        self.output_tensors = tuple(_tensor(node) for node in self._session.get_outputs())
        self.inputs = tuple(tensor.name for tensor in self.input_tensors)
        self.outputs = tuple(tensor.name for tensor in self.output_tensors)
        lacking = [name for name in inputs if name not in self.inputs]
        lacking += [name for name in outputs if name not in self.outputs]
        if lacking:
            raise ModelError(
                f"{path} lacks {', '.join(lacking)}; it has inputs {self.inputs} and outputs {self.outputs}"
            )

    def run(
        self, feeds: Mapping[str, NDArray[Any]], outputs: tuple[str, ...], cancel: Cancel | None = None
    ) -> tuple[NDArray[Any], ...]:
        """The named outputs for the named inputs; ModelError when onnxruntime refuses them, RunCancelledError when told to stop."""
        options = onnxruntime.RunOptions()
        options.add_run_config_entry("memory.enable_memory_arena_shrinkage", "cpu:0")
        cancel = cancel or self._cancel
        if cancel is not None:
            cancel._enter(options)
        try:
            values = self._session.run(list(outputs), dict(feeds), options)
        except _ERRORS as error:
            if cancel is not None and cancel.requested:
                raise RunCancelledError(f"{self.path.name} was told to stop") from error
            raise ModelError(f"{self.path.name} failed: {error}") from error
        finally:
            if cancel is not None:
                cancel._leave(options)
        return tuple(np.asarray(value) for value in values)


def _provider(name: str, threads: int) -> tuple[str, dict[str, str]]:
    """A provider as onnxruntime wants it. OpenVINO has threads of its own, which onnxruntime's options don't reach."""
    provider, options = PROVIDERS[name]
    return provider, options | ({"num_of_threads": str(threads)} if name == "openvino" else {})


def _options(threads: int) -> Any:
    """Options that were measured. Spinning threads burn CPU while they wait. The memory arena is given back after each run: kept, it
    holds gigabytes after one large picture; without any, a large encoder spends more CPU on page faults than on arithmetic (SlimSAM:
    10.0 s instead of 4.3). The memory pattern would double the peak."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    options.execution_mode = onnxruntime.ExecutionMode.ORT_SEQUENTIAL
    options.enable_mem_pattern = False
    options.log_severity_level = 3
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    return options


def _give_back() -> None:
    """What opening a file took and freed goes back to the system: else a fifth to a third of all memory stays with the allocator."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)  # glibc only
    if trim is not None:
        trim(0)


def _tensor(node: Any) -> Tensor:
    kind = str(node.type).removeprefix("tensor(").removesuffix(")")
    return Tensor(node.name, {"float": "float32", "double": "float64"}.get(kind, kind), tuple(node.shape))
