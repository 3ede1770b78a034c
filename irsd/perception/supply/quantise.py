"""int8 files made on this machine from fp32 ones, and taken into use only when they pass the gate.

``matmul``: MatMul, Gemm and embeddings, int8 per channel, activations quantised as they come. On CPUs that is faster than quantising
every operator, since integer convolutions are slow there. ``static``: QDQ around convolutions and MatMul, with ranges calibrated on
what the network really sees. Where the CPU's sums of products overflow, weights have 7 bits.
"""

from __future__ import annotations

import dataclasses
import logging
import os
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from irsd.core.errors import ModelError
from irsd.perception.assemble import ModelOpener, ModelSettings
from irsd.perception.catalogue import Model, ModelFile, Recipe
from irsd.perception.models import Session, onnxruntime_version, quantisation_tools, sha256_of
from irsd.perception.shelf import FLOAT, INT8, Record, Shelf
from irsd.perception.supply import RefusedError, gate
from irsd.perception.supply.watch import Feeds, Watch

_log = logging.getLogger(__name__)

_CALIBRATION_CALLS = 24  # per network: more changes the ranges little and takes minutes
_OPSET = 13
_MATMUL = ("MatMul", "Gemm", "Gather")
_STATIC = ("Conv", "MatMul", "Gemm")


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of one part: the verdict, and the sizes of both files."""

    part: str
    verdict: gate.Verdict
    float_bytes: int
    int8_bytes: int


def quantise(
    settings: ModelSettings,
    name: str,
    pictures: Sequence[NDArray[np.uint8]],
    *,
    parts: Sequence[str] = (),
    say: Callable[[str], None] = _log.info,
) -> Iterator[Outcome]:
    """Makes int8 of the model's parts (default: all that have a recipe), each judged and taken into use before the next.

    pictures: RGB uint8 [H, W, 3], what the robot sees. Raises RefusedError with the numbers, ModelError for everything else.
    """
    opener = ModelOpener(settings)
    model = opener.model(name)
    model.check_licence(settings.accepted)
    chosen = tuple(parts) or tuple(model.recipes)
    unknown = [part for part in chosen if part not in model.recipes]
    if unknown or not chosen:
        raise ModelError(
            f"{model.name}: no recipe to quantise {', '.join(unknown) or 'any part'}; there is one for "
            f"{', '.join(model.recipes) or 'no part'}"
        )
    quantisation_tools()  # or say at once that they can't be had
    say("running the fp32 model on the pictures")
    watch = Watch(keep=_CALIBRATION_CALLS)
    reference = gate.answers(ModelOpener(settings, open_session=watch.open_session), f"{model.name}@{FLOAT}", pictures)
    for part in chosen:
        file = float_file(model, part)
        source = opener.shelf.verified(model, file)
        fresh = source.with_name(f".{part}.{os.getpid()}.onnx")
        try:
            say(f"{part}: quantising")
            make_int8(source, fresh, model.recipes[part], watch.feeds.get(source.name, ()), say)
            say(f"{part}: judging")
            yield adopt(settings, model, part, fresh, pictures, reference)
        finally:
            fresh.unlink(missing_ok=True)


def adopt(
    settings: ModelSettings,
    model: Model,
    part: str,
    candidate: Path,
    pictures: Sequence[NDArray[np.uint8]],
    reference: gate.Answers | None = None,
) -> Outcome:
    """Judges a quantised file of a part against the fp32 one and moves it into its place. RefusedError with the numbers otherwise.

    reference: what the fp32 model said to the same pictures, where that is known already.
    """
    shelf = Shelf(settings.folder)
    name, source = f"{model.name}@{FLOAT}", shelf.verified(model, float_file(model, part))
    if reference is None:
        reference = gate.answers(ModelOpener(settings), name, pictures)
    stand_in = Watch(stand_ins={source: candidate})
    try:
        theirs = gate.answers(ModelOpener(settings, open_session=stand_in.open_session), name, pictures)
    except ModelError as error:
        raise RefusedError(f"{model.name} {part}: the int8 file was refused, it does not run: {error}") from error
    verdict = gate.judge(model, reference, theirs)
    if verdict.failed:
        raise RefusedError(f"{model.name} {part}: the int8 file was refused: {verdict}; fp32 stays in use")
    outcome = Outcome(part, verdict, source.stat().st_size, candidate.stat().st_size)
    file = next(f for f in shelf.files_of(model, part) if f.precision == INT8)
    recipe = model.recipes[part]
    origin = f"{recipe.method} int8 of {sha256_of(source)[:16]}, onnxruntime {onnxruntime_version()}"
    judged = {key: round(value, 4) for key, value in verdict.measured.items()}
    record = Record(sha256_of(candidate), outcome.int8_bytes, origin, judged | {"pictures": len(pictures)})
    candidate.replace(shelf.path(model, file))
    shelf.remember(model, file, record)
    return outcome


def float_file(model: Model, part: str) -> ModelFile:
    """The fp32 file of a part. ModelError when the catalogue has none."""
    found = [file for file in model.files_of(part) if file.precision == FLOAT]
    if not found:
        raise ModelError(f"{model.name}: the catalogue has no fp32 file of {part}")
    return found[0]


def make_int8(
    source: Path, target: Path, recipe: Recipe, feeds: Iterable[Feeds] = (), say: Callable[[str], None] = _log.info
) -> None:
    """Writes the int8 file of an fp32 one. feeds: inputs as the network gets them, for ``static``. ModelError with the reason."""
    tools = quantisation_tools()
    excluded = nodes_named(source, recipe.exclude)
    lacking = [end for end in recipe.exclude if not any(node.endswith(end) for node in excluded)]
    if lacking:
        say(f"{source.name}: no node is called {', '.join(lacking)}, which should stay float; the gate will tell")
    options: dict[str, Any] = {"per_channel": True, "nodes_to_exclude": excluded, "reduce_range": sums_overflow()}
    # the library tells its users how to call it better, by warnings and on the root logger; what counts is the gate
    with _quiet():
        try:
            if recipe.method == "matmul":
                tools.quantize_dynamic(
                    str(source),
                    str(target),
                    op_types_to_quantize=list(_MATMUL),
                    weight_type=tools.QuantType.QInt8,
                    extra_options={"MatMulConstBOnly": True},
                    **options,
                )
            else:
                kept = list(feeds)
                if not kept:
                    raise ModelError(f"{source.name}: static quantisation needs pictures to calibrate on")
                tools.quantize_static(
                    modernised(source),
                    str(target),
                    _reader(tools, kept),
                    op_types_to_quantize=list(_STATIC),
                    weight_type=tools.QuantType.QInt8,
                    activation_type=tools.QuantType.QUInt8,
                    **options,
                )
        except ModelError:
            raise
        except Exception as error:  # the library raises whatever its parts raise
            raise ModelError(f"{source.name} can't be quantised: {error}") from error


def sums_overflow() -> bool:
    """Whether this CPU loses what two products of 8 bits hold beyond 16 bits, as x86 before VNNI does (vpmaddubsw): measured.

    An int8 network then answers nonsense, unless its weights are held to 7 bits.
    """
    import onnx  # noqa: PLC0415  only quantising needs it
    from onnx import TensorProto, helper, numpy_helper  # noqa: PLC0415

    depth, most, least = 64, 255, 127
    weights = numpy_helper.from_array(np.full((depth, depth), least, np.int8), "weights")
    graph = helper.make_graph(
        [helper.make_node("MatMulInteger", ["values", "weights"], ["sums"])],
        "probe",
        [helper.make_tensor_value_info("values", TensorProto.UINT8, [1, depth])],
        [helper.make_tensor_value_info("sums", TensorProto.INT32, [1, depth])],
        [weights],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", _OPSET)], ir_version=8)
    with tempfile.TemporaryDirectory() as scratch:
        path = Path(scratch) / "probe.onnx"
        onnx.save(model, str(path))
        (sums,) = Session(path).run({"values": np.full((1, depth), most, np.uint8)}, ("sums",))
    return bool((sums != depth * most * least).any())


def modernised(source: Path) -> Any:
    """An onnx model that static quantisation can take: per-channel scales need opset 13, and constants must not be inputs."""
    import onnx  # noqa: PLC0415  only quantising needs it
    from onnx import version_converter  # noqa: PLC0415

    model = onnx.load(str(source), load_external_data=False)
    constants = {constant.name for constant in model.graph.initializer}
    inputs = [node for node in model.graph.input if node.name not in constants]
    del model.graph.input[:]
    model.graph.input.extend(inputs)
    opset = max(each.version for each in model.opset_import if each.domain in ("", "ai.onnx"))
    return version_converter.convert_version(model, _OPSET) if opset < _OPSET else model


def nodes_named(source: Path, ends: Sequence[str]) -> list[str]:
    """Names of the nodes of an ONNX file that end like one of these: exporters put what they like in front."""
    if not ends:
        return []
    import onnx  # noqa: PLC0415  only quantising needs it

    graph = onnx.load(str(source), load_external_data=False).graph
    return [node.name for node in graph.node if node.name.endswith(tuple(ends))]


def _reader(tools: Any, feeds: Sequence[Feeds]) -> Any:
    """A CalibrationDataReader over kept inputs; its base class comes with the library."""

    class Reader(tools.CalibrationDataReader):  # type: ignore[misc]
        def __init__(self) -> None:
            self._left = iter(feeds)

        def get_next(self) -> Feeds | None:
            return next(self._left, None)

    return Reader()


class _quiet:  # noqa: N801  used like a function
    """Keeps the library's advice out of our log."""

    def __enter__(self) -> None:
        self._level = logging.getLogger().level
        logging.getLogger().setLevel(logging.ERROR)

    def __exit__(self, *_: object) -> None:
        logging.getLogger().setLevel(self._level)


def describe(outcome: Outcome) -> dict[str, Any]:
    """An outcome as plain values."""
    return dataclasses.asdict(outcome)
