"""Does a model keep its contract, and what does it cost here? Measured in processes of their own, so that memory is the model's.

python -m irsd.perception.supply.check '{"directory": .., "name": .., "threads": 1}'   prints one JSON object
"""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from numpy.typing import NDArray

from irsd.core.errors import ModelError
from irsd.perception.assemble import ModelOpener, ModelSettings
from irsd.perception.catalogue import PartContract, TensorContract
from irsd.perception.models import Session, Tensor
from irsd.perception.supply import gate
from irsd.perception.supply.watch import Call, Watch

_RUNS = 5
_ENOUGH_S = 20.0  # of measuring one model
_PATIENCE_S = 600.0


@dataclass(frozen=True, slots=True)
class PartCost:
    """Median of the calls of one network after the first. calls: how many a picture (or text) takes."""

    part: str
    calls: int
    wall_ms: float
    cpu_ms: float


@dataclass(frozen=True, slots=True)
class Report:
    """problems: breaches of the contract, empty when it is kept. rss_mb: of the process, over what it had before the model."""

    name: str
    threads: int
    precisions: Mapping[str, str]
    problems: tuple[str, ...]
    open_s: float
    costs: tuple[PartCost, ...]
    rss_mb: float
    peak_mb: float


def check(settings: ModelSettings, name: str, threads: int, role: str = "") -> Report:
    """Loads the model in a process of its own, holds it to its contract, warms it up and measures it. ModelError when that dies.

    role: measured alone (the others are not even opened); empty: all that the model has.
    """
    question = {
        "directory": str(settings.folder),
        "name": name,
        "threads": threads,
        "role": role,
        "providers": list(settings.providers),
        "accept_license": list(settings.accepted),
    }
    command = [sys.executable, "-m", "irsd.perception.supply.check", json.dumps(question)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=_PATIENCE_S, check=False)
    except subprocess.TimeoutExpired:
        raise ModelError(f"{name} did not finish within {_PATIENCE_S:g} s on {threads} threads") from None
    if done.returncode:
        tail = done.stderr.strip().splitlines()[-1:] or [f"exit code {done.returncode}"]
        raise ModelError(tail[0].removeprefix("irsd: "))
    answer = json.loads(done.stdout.splitlines()[-1])
    costs = tuple(PartCost(**cost) for cost in answer.pop("costs"))
    return Report(**answer | {"problems": tuple(answer["problems"]), "costs": costs})


# ------------------------------------------------------------------------------------------------------------- contract
def declared_problems(part: str, contract: PartContract, session: Session) -> list[str]:
    """Where what a file declares departs from the contract: names, dtypes, ranks, fixed dimensions."""
    problems = []
    for kind, wanted, found in (
        ("input", contract.inputs, session.input_tensors),
        ("output", contract.outputs, session.output_tensors),
    ):
        by_name = {tensor.name: tensor for tensor in found}
        for tensor in wanted:
            if tensor.name in by_name:
                problems += [f"{part}: {kind} {p}" for p in _declared(tensor, by_name[tensor.name])]
            elif not tensor.optional:
                problems.append(f"{part}: {kind} {tensor.name} is missing, there is {', '.join(by_name)}")
        known = {tensor.name for tensor in wanted}
        if kind == "input":
            problems += [f"{part}: input {name} is not in the contract" for name in by_name if name not in known]
    return problems


def _declared(contract: TensorContract, found: Tensor) -> list[str]:
    where, wanted = contract.name, _text(contract.dtype, contract.shape)
    if found.dtype != contract.dtype:
        return [f"{where} is {found.dtype}, not {wanted}"]
    if not found.shape:
        return []  # the file does not say
    if len(found.shape) != len(contract.shape):
        return [f"{where} has {len(found.shape)} dimensions, not {wanted}"]
    fixed = [
        (theirs, ours)
        for theirs, ours in zip(found.shape, contract.shape, strict=True)
        if isinstance(theirs, int) and isinstance(ours, int) and theirs != ours
    ]
    return [f"{where} is {list(found.shape)}, not {wanted}"] if fixed else []


def observed_problems(part: str, contract: PartContract, calls: Sequence[Call]) -> list[str]:
    """Where what went in and came out departs from the contract; free dimensions must be the same wherever they occur."""
    wanted = {tensor.name: tensor for tensor in (*contract.inputs, *contract.outputs)}
    problems: dict[str, None] = {}
    for call in calls:
        free: dict[str, int] = {}
        for name, (dtype, shape) in call.shapes.items():
            if name not in wanted:
                continue
            tensor = wanted[name]
            fits = dtype == tensor.dtype and len(shape) == len(tensor.shape)
            for size, dimension in zip(shape, tensor.shape, strict=False):
                fits &= size == (dimension if isinstance(dimension, int) else free.setdefault(dimension, size))
            if not fits:
                problems[f"{part}: {name} was {_text(dtype, shape)}, not {_text(tensor.dtype, tensor.shape)}"] = None
    return list(problems)


def _text(dtype: str, shape: Sequence[int | str]) -> str:
    return f"{dtype}[{','.join(map(str, shape))}]"


# ------------------------------------------------------------------------------------------------------- in the process
def picture() -> NDArray[np.uint8]:
    """uint8 [480, 640, 3]: smooth patches and edges, the same every time."""
    rng = np.random.default_rng(0)
    coarse = rng.integers(0, 256, (12, 16, 3), np.uint8)
    return np.ascontiguousarray(np.kron(coarse, np.ones((40, 40, 1), np.uint8)))


def measure(settings: ModelSettings, name: str, role: str = "") -> dict[str, Any]:
    """In this process: the report as plain values."""
    process = psutil.Process()
    base_mb = process.memory_info().rss / 1e6
    watch = Watch()
    opener = ModelOpener(settings, open_session=watch.open_session)
    model = opener.model(name)
    precision = opener.precision_of(name)
    files = [opener.shelf.choose(model, part, precision) for part in model.parts]
    part_of = {opener.shelf.verified(model, file): file.part for file in files}
    problems: list[str] = []
    began_s = time.perf_counter()
    try:
        calls_of = _questions(opener, name, role)
    except ModelError as error:
        problems.append(str(error))
        calls_of = {}
    open_s = time.perf_counter() - began_s
    costs: list[dict[str, Any]] = []
    rss_mb = process.memory_info().rss / 1e6
    for ask in calls_of.values():
        ask()  # warm up; may also be the largest in memory
        first, runs, until_s = len(watch.calls), 0, time.perf_counter() + _ENOUGH_S
        while runs < _RUNS and (runs < 1 or time.perf_counter() < until_s):
            ask()
            runs += 1
        rss_mb = max(rss_mb, process.memory_info().rss / 1e6)
        costs += _costs(watch.calls[first:], runs, part_of)
    for path, session in watch.opened.items():
        part, contract = part_of[path], model.contracts[part_of[path]]
        problems += declared_problems(part, contract, session)
        problems += observed_problems(part, contract, [call for call in watch.calls if call.path == path])
    return {
        "name": name,
        "threads": settings.threads,
        "precisions": {row["part"]: row["precision"] for row in opener.status()},
        "problems": problems,
        "open_s": round(open_s, 2),
        "costs": costs,
        "rss_mb": round(rss_mb - base_mb, 1),
        "peak_mb": round(_peak_mb() - base_mb, 1),
    }


def _costs(calls: Sequence[Call], runs: int, part_of: Mapping[Path, str]) -> list[dict[str, Any]]:
    out = []
    for path in dict.fromkeys(call.path for call in calls):
        own = [call for call in calls if call.path == path]
        wall_ms, cpu_ms = (statistics.median(getattr(c, key) for c in own) for key in ("wall_ms", "cpu_ms"))
        cost = {"part": part_of[path], "calls": len(own) // runs}
        out.append(cost | {"wall_ms": round(wall_ms, 2), "cpu_ms": round(cpu_ms, 2)})
    return out


def _questions(opener: ModelOpener, name: str, role: str) -> dict[str, Callable[[], object]]:
    """By role: one question of the usual size."""
    roles = [role] if role else list(opener.model(name).roles)
    image = picture()
    questions: dict[str, Callable[[], object]] = {}
    if "image_encoder" in roles:
        images = opener.image_encoder(name)
        questions["image_encoder"] = lambda: images.encode_images([image])
    if "text_encoder" in roles:
        texts = opener.text_encoder(name)
        numbers = iter(range(10**6))  # never the same text, some encoders remember
        questions["text_encoder"] = lambda: texts.encode_texts([f"a photo of chair {next(numbers)}"])
    if "detector" in roles:
        detector = opener.detector(name)
        questions["detector"] = lambda: detector.detect(image, gate.PROMPTS[:3])
    if "segmenter" in roles:
        segmenter = opener.segmenter(name)
        questions["segmenter"] = lambda: segmenter.segment(image, gate.boxes_of(image)[:1])
    if "tagger" in roles:
        tagger = opener.tagger(name)
        questions["tagger"] = lambda: tagger.tag(image)
    return questions


def _peak_mb() -> float:
    import resource  # noqa: PLC0415  only this process asks

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024 * 1.048576


def main() -> None:
    """Entry of the process that is measured."""
    question = json.loads(sys.argv[1])
    settings = ModelSettings(
        directory=question["directory"],
        threads=question["threads"],
        providers=tuple(question["providers"]),
        accept_license=tuple(question["accept_license"]),
    )
    try:
        answer = measure(settings, question["name"], question["role"])
    except ModelError as error:
        sys.exit(f"irsd: {' '.join(str(error).split())}")
    sys.stdout.write(json.dumps(answer) + "\n")


if __name__ == "__main__":
    main()
