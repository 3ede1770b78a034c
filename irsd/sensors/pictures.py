"""Picture bytes to pixels: raw rows, JPEG, PNG. A file's size is read from its header and held against its length first.

Decoders allocate what a header claims, so a hundred bytes could ask for gigabytes; and libjpeg fills a cut file with grey and
only prints a warning. Both are caught here.
"""

from __future__ import annotations

import struct
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from irsd.core import png
from irsd.core.errors import DecodeError

MAX_PIXELS = 16 * 2**20
"""Larger pictures are refused."""

_MAX_PIXELS_PER_BYTE = 1100
"""Deflate packs at most 1032 bytes into one, JPEG at most 512 pixels: a header that claims more is lying."""

# encoding -> channels, and OpenCV's conversion to BGR (None: it is BGR)
_RAW: dict[str, tuple[int, int | None]] = {
    "bgr8": (3, None),
    "8UC3": (3, None),
    "rgb8": (3, cv2.COLOR_RGB2BGR),
    "rgba8": (4, cv2.COLOR_RGBA2BGR),
    "bgra8": (4, cv2.COLOR_BGRA2BGR),
    "mono8": (1, cv2.COLOR_GRAY2BGR),
    "8UC1": (1, cv2.COLOR_GRAY2BGR),
}

_MAX_SCANS = 64  # of a progressive JPEG, each of which costs as much as the whole picture; encoders make about ten
_JPEG_MAGIC = b"\xff\xd8\xff"
_JPEG_SIZES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}  # the SOFn markers
_JPEG_BARE = frozenset(range(0xD0, 0xD9)) | {0x01}  # markers without a length


def bgr_of_raw(data: NDArray[np.uint8], height: int, width: int, step: int, encoding: str) -> NDArray[np.uint8]:
    """bgr uint8 [H, W, 3] of raw rows, each ``step`` bytes long. Raises DecodeError."""
    if encoding not in _RAW:
        raise DecodeError(f"Image: encoding {encoding[:40]!r} is not one of {', '.join(_RAW)}")
    channels, conversion = _RAW[encoding]
    if not height or not width:
        raise DecodeError(f"Image: {width} x {height} pixels are no picture")
    if width * height > MAX_PIXELS:
        raise DecodeError(f"Image: {width} x {height} pixels are more than {MAX_PIXELS}")
    if step < width * channels:
        raise DecodeError(f"Image: step {step} is less than {width} pixels of {channels} bytes")
    needed = (height - 1) * step + width * channels
    if data.size < needed:
        raise DecodeError(f"Image: {width} x {height} {encoding} needs {needed} bytes, there are {data.size}")
    rows: NDArray[Any] = np.ndarray((height, width, channels), np.uint8, data.data, 0, (step, channels, 1))
    if conversion is None:
        return np.array(rows, order="C")
    return np.asarray(cv2.cvtColor(np.ascontiguousarray(rows), conversion), np.uint8)


def bgr_of_file(data: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """bgr uint8 [H, W, 3] of a JPEG or PNG file [N] as bytes; 16-bit channels are reduced to 8, orientation tags ignored."""
    return np.asarray(_decoded(data, cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION), np.uint8)


def numbers_of_png(data: NDArray[np.uint8]) -> NDArray[np.uint16]:
    """uint16 [H, W] of a one-channel PNG of 8 or 16 bits. Raises DecodeError for anything else."""
    if bytes(data[:8]) != png.MAGIC:
        raise DecodeError("ids image: not a PNG (numbers do not survive lossy compression)")
    pixels = _decoded(data, cv2.IMREAD_UNCHANGED)
    if pixels.ndim != 2 or pixels.dtype not in (np.uint8, np.uint16):
        raise DecodeError(f"ids image: expected one channel of 8 or 16 bits, got {pixels.dtype} {pixels.shape}")
    return pixels.astype(np.uint16, copy=False)


def _decoded(data: NDArray[np.uint8], flags: int) -> NDArray[Any]:
    width, height = _claimed_size(data)
    if not 0 < width * height <= min(MAX_PIXELS, _MAX_PIXELS_PER_BYTE * data.size):
        raise DecodeError(f"CompressedImage: {data.size} bytes claim {width} x {height} pixels")
    try:
        pixels = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error as error:
        raise DecodeError(f"CompressedImage: {error}") from error
    if pixels is None or pixels.shape[:2] != (height, width):
        raise DecodeError(f"CompressedImage: {data.size} bytes of {width} x {height} pixels can't be decoded")
    return np.asarray(pixels)


def _claimed_size(data: NDArray[np.uint8]) -> tuple[int, int]:
    """(width, height) by the file's header. Raises DecodeError for other formats and for files that are cut off."""
    head = bytes(data[:24])
    if head.startswith(png.MAGIC):
        try:
            return png.png_size(bytes(data), MAX_PIXELS, _MAX_PIXELS_PER_BYTE)
        except DecodeError as error:
            raise DecodeError(f"CompressedImage: {error}") from error
    if head.startswith(_JPEG_MAGIC):
        if b"\xff\xd9" not in bytes(data[-64:]):
            raise DecodeError(f"CompressedImage: JPEG is cut off after {data.size} bytes")
        if bytes(data).count(b"\xff\xda") > _MAX_SCANS:
            raise DecodeError(f"CompressedImage: JPEG of more than {_MAX_SCANS} scans")
        return _jpeg_size(bytes(data))
    raise DecodeError(f"CompressedImage: starts with {head[:8].hex()}, which is neither JPEG nor PNG")


def _jpeg_size(data: bytes) -> tuple[int, int]:
    """Walks the segments up to the frame header; each step moves on by at least two bytes."""
    position = 2
    while position + 9 <= len(data):
        if data[position] != 0xFF:
            break
        marker = data[position + 1]
        if marker == 0xFF:
            position += 1
            continue
        if marker in _JPEG_BARE:
            position += 2
            continue
        if marker in _JPEG_SIZES:
            height, width = struct.unpack_from(">HH", data, position + 5)
            return width, height
        position += 2 + max(2, struct.unpack_from(">H", data, position + 2)[0])
    raise DecodeError("CompressedImage: JPEG without a frame header")
