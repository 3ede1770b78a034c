"""Write the two pixel networks as int8 ONNX.

python -m training.export_pixels --data DIR --segmenter A.pt --image B.pt --out irsd/models/nano

Static quantisation by onnxruntime (QDQ, weights per channel and of 7 bit, because CPUs without VNNI add 8-bit products in 16 bit),
with calibration pictures from the training renders; the nets' first and last layers stay float. ``training.fit_segmenter`` comes after.
"""

from __future__ import annotations

import argparse
import tempfile
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import onnx
import torch
from onnxruntime.quantization import CalibrationDataReader, CalibrationMethod, QuantFormat, QuantType, quantize_static
from onnxruntime.quantization.shape_inference import quant_pre_process

from irsd.perception.nano_image import CHANNELS, MEASURES, SIDE, network_inputs
from irsd.perception.nano_map import COLUMNS, ROWS, map_picture
from irsd.perception.nano_segmenter import image_input
from training.image_net import ImageNet, geometry_of
from training.render_data import Frame, Frames, sight_of, spoiled
from training.segment_net import SegmentNet, Whole

_CALIBRATION = 24  # pictures


class _Reader(CalibrationDataReader):
    def __init__(self, feeds: Iterator[dict[str, np.ndarray]]) -> None:
        self._feeds = feeds

    def get_next(self) -> dict[str, np.ndarray] | None:
        return next(self._feeds, None)


def segmenter_feeds(frames: list[Frame]) -> Iterator[dict[str, np.ndarray]]:
    """What the segmenter is given of frames, a little spoiled."""
    rng = np.random.default_rng(5)
    for frame in frames:
        rgb = spoiled(frame.rgb(), rng)
        yield {"image": image_input(rgb), "map": map_picture(sight_of(frame.points), rgb.shape[:2])[None]}


def image_feeds(frames: list[Frame]) -> Iterator[dict[str, np.ndarray]]:
    """What the image encoder is given of the things in frames."""
    rng = np.random.default_rng(6)
    for frame in frames:
        size = np.bincount(frame.thing.reshape(-1), minlength=2)
        numbers = [k for k in range(1, len(size)) if size[k] > 100][:6]
        if numbers:
            masks = np.stack([frame.thing == k for k in numbers])
            crops, measures = network_inputs(
                spoiled(frame.rgb(), rng), masks, sight_of(frame.points), geometry_of(frame)
            )
            yield {"crops": crops, "measures": measures}


def export(net: torch.nn.Module, inputs: dict[str, torch.Tensor], outputs: list[str], path: Path, free: bool) -> None:
    """A float ONNX file; ``free``: the first dimension may have any size."""
    axes = {name: {0: "n"} for name in (*inputs, *outputs)} if free else None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        torch.onnx.export(
            net.eval(), tuple(inputs.values()), str(path), input_names=list(inputs), output_names=outputs, opset_version=17,
            dynamo=False, dynamic_axes=axes,
        )  # fmt: skip


def quantised(source: Path, target: Path, feeds: Iterator[dict[str, np.ndarray]], keep: tuple[str, ...]) -> None:
    """The file with int8 weights and activations, but for nodes whose name begins with one of ``keep``."""
    ready = source.with_suffix(".ready.onnx")
    quant_pre_process(str(source), str(ready))
    nodes = [node.name for node in onnx.load(ready).graph.node]
    quantize_static(
        str(ready), str(target), _Reader(feeds), quant_format=QuantFormat.QDQ, per_channel=True, reduce_range=True,
        activation_type=QuantType.QUInt8, weight_type=QuantType.QInt8, calibrate_method=CalibrationMethod.MinMax,
        nodes_to_exclude=[name for name in nodes if name.startswith(keep)],
        op_types_to_quantize=["Conv", "Gemm", "MatMul", "Add", "Concat", "Resize", "Relu"],
    )  # fmt: skip


def load(net: torch.nn.Module, path: Path) -> torch.nn.Module:
    """The moving average of a checkpoint."""
    net.load_state_dict(torch.load(path)["average"])
    return net


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, required=True, help="renders for calibration")
    parser.add_argument("--segmenter", type=Path)
    parser.add_argument("--image", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--float-out", type=Path, help="where to leave the float files, to compare with")
    arguments = parser.parse_args()
    torch.manual_seed(0)
    frames = Frames(arguments.data).frames
    some = [
        frames[k] for k in np.random.default_rng(4).choice(len(frames), min(_CALIBRATION, len(frames)), replace=False)
    ]
    arguments.out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as scratch:
        folder = arguments.float_out or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        if arguments.segmenter is not None:
            path = folder / "segmenter.onnx"
            inputs = {"image": torch.zeros(1, 3, 2 * ROWS, 2 * COLUMNS), "map": torch.zeros(1, 3, ROWS, COLUMNS)}
            export(Whole(load(SegmentNet(), arguments.segmenter)), inputs, ["heads", "parts"], path, free=False)
            quantised(
                path,
                arguments.out / "segmenter.onnx",
                segmenter_feeds(some),
                ("/net/head", "/net/stem", "/net/down.0/down.0.0"),
            )
        if arguments.image is not None:
            path = folder / "image_encoder.onnx"
            inputs = {"crops": torch.zeros(2, CHANNELS, SIDE, SIDE), "measures": torch.zeros(2, MEASURES)}
            export(load(ImageNet(), arguments.image), inputs, ["embedding"], path, free=True)
            quantised(path, arguments.out / "image_encoder.onnx", image_feeds(some), ("/size", "/head"))


if __name__ == "__main__":
    main()
