"""What a PNG file claims, checked against its bytes before any decoder sees them.

Decoders allocate what a header or a chunk's length claims: a file of two hundred bytes can ask for gigabytes.
"""

from __future__ import annotations

import struct

from irsd.core.errors import DecodeError

MAGIC = b"\x89PNG\r\n\x1a\n"
_HEADER, _CHUNK = struct.Struct(">II"), struct.Struct(">I4s")
_MAX_CHUNKS = 100_000


def png_size(data: bytes | memoryview, max_pixels: int, max_pixels_per_byte: int = 1100) -> tuple[int, int]:
    """(width, height) of a PNG file whose chunks fill it exactly, from IHDR to IEND.

    max_pixels_per_byte: deflate packs at most 1032 bytes into one. Raises DecodeError for anything else, and for more pixels.
    """
    if bytes(data[:8]) != MAGIC:
        raise DecodeError("not a PNG")
    at, chunks, kind = len(MAGIC), 0, b""
    width = height = 0
    while at + 12 <= len(data) and chunks < _MAX_CHUNKS and kind != b"IEND":
        length, kind = _CHUNK.unpack_from(data, at)
        if length > len(data) - at - 12:
            raise DecodeError(f"PNG: a chunk of {length} bytes in a file of {len(data)} (cut off?)")
        if (kind == b"IHDR") != (chunks == 0):
            raise DecodeError("PNG: its header is not at its beginning")
        if chunks == 0:
            width, height = _HEADER.unpack_from(data, at + 8)
        at, chunks = at + 12 + length, chunks + 1
    if kind != b"IEND":
        raise DecodeError(f"PNG: cut off after {len(data)} bytes")
    if not 0 < width * height <= min(max_pixels, max_pixels_per_byte * len(data)):
        raise DecodeError(f"PNG: {len(data)} bytes claim {width} x {height} pixels, at most {max_pixels} are read")
    return width, height
