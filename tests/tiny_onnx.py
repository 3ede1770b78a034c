"""ONNX files written byte by byte: real networks of a few nodes, so that tests need neither the onnx package nor stand-ins."""

from __future__ import annotations

from pathlib import Path

import numpy as np

FLOAT = 1


def varint(value: int) -> bytes:
    out = b""
    while value > 127:
        out, value = out + bytes([value & 127 | 128]), value >> 7
    return out + bytes([value])


def number(field: int, value: int) -> bytes:
    return varint(field << 3) + varint(value)


def block(field: int, *parts: bytes) -> bytes:
    body = b"".join(parts)
    return varint(field << 3 | 2) + varint(len(body)) + body


def value_info(field: int, name: str, shape: tuple[int | str, ...]) -> bytes:
    """An input (field 11) or output (12) of floats; a free dimension has a name."""
    dims = b"".join(block(1, number(1, d) if isinstance(d, int) else block(2, d.encode())) for d in shape)
    return block(field, block(1, name.encode()), block(2, block(1, number(1, FLOAT), block(2, dims))))


def node(kind: str, inputs: tuple[str, ...], output: str) -> bytes:
    return block(1, *(block(1, name.encode()) for name in inputs), block(2, output.encode()), block(4, kind.encode()))


def tensor(name: str, values: np.ndarray) -> bytes:
    dims = b"".join(number(1, d) for d in values.shape)
    return block(5, dims, number(2, FLOAT), block(8, name.encode()), block(9, values.astype("<f4").tobytes()))


def write(path: Path, *graph: bytes) -> Path:
    """A file of nodes, tensors, inputs and outputs."""
    path.write_bytes(number(1, 8) + block(7, *graph, block(2, b"g")) + block(8, block(1, b""), number(2, 13)))
    return path


def image_encoder(path: Path, weights: np.ndarray, side_px: int = 8) -> Path:
    """pixel_values [n, 3, side, side] -> image_embeds [n, D]: the mean colour times weights [3, D]."""
    return write(
        path,
        node("GlobalAveragePool", ("pixel_values",), "mean"),
        node("Flatten", ("mean",), "colour"),
        node("MatMul", ("colour", "w"), "image_embeds"),
        tensor("w", weights),
        value_info(11, "pixel_values", ("n", 3, side_px, side_px)),
        value_info(12, "image_embeds", ("n", weights.shape[1])),
    )


def slow_image_encoder(path: Path, size: int = 1000, rounds: int = 60) -> Path:
    """As ``image_encoder`` with D = 3, after ``rounds`` products of size x size zeros, which change nothing and take long."""
    return write(
        path,
        node("GlobalAveragePool", ("pixel_values",), "mean"),
        node("Flatten", ("mean",), "colour"),
        node("ReduceMax", ("colour",), "top"),
        node("Mul", ("zeros", "top"), "m0"),
        *(node("MatMul", (f"m{k}", "zeros"), f"m{k + 1}") for k in range(rounds)),
        node("ReduceMax", (f"m{rounds}",), "nothing"),
        node("Add", ("colour", "nothing"), "image_embeds"),
        tensor("zeros", np.zeros((size, size))),
        value_info(11, "pixel_values", ("n", 3, 8, 8)),
        value_info(12, "image_embeds", ("n", 3)),
    )
