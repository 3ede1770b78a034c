"""What the makers of contract fixtures and the tests that read them share. Needs numpy only.

``fixtures/<family>/`` holds tiny ONNX files (real architecture, random weights), a cut-down tokenizer.json where the family reads
texts, and ``reference.npz``: what the reference pipeline (Hugging Face processor, torch model, post-processing) makes of the inputs.
``manifest.json`` there holds the sha256 of each file. ``make fixtures`` makes all of it; ``test_fixtures.py`` checks it.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

FIXTURES = Path(__file__).parent / "fixtures"
MANIFEST = "manifest.json"
MAX_BYTES = 5_000_000
TOLERANCE = 1e-3  # the largest difference from the reference that a test may find

# name: (width, height). The sliver is longer than 8:1; the tiny one has fewer pixels than any network's input.
PICTURES: dict[str, tuple[int, int]] = {
    "landscape": (640, 480),
    "portrait": (360, 480),
    "odd": (333, 217),
    "tiny": (7, 5),
    "sliver": (4, 90),
}

ODD_TEXTS: tuple[str, ...] = (
    "a photo of a cat",
    "Office Chair",
    "  fire   extinguisher\t",
    "door's handle, 2nd floor!",
    "café table №5",
    "植物",
    "🪴 plant",
    "e\u0301clair",
    'TV-monitor/screen (24")',
    "",
    "123 4567",
    "a <|endoftext|> b",
    "bedside table " * 40,
)

OPEN_CLIP_TEXTS = tuple(text for text in ODD_TEXTS if "<|" not in text)  # special tokens have other names there

DETECTOR_PROMPTS: tuple[str, ...] = ("chair", "bedside table", "café", "TV", "trash can")

# What segmenters are asked for, in pixels of these pictures.
BOXES: dict[str, list[list[float]]] = {
    "landscape": [[40.5, 60, 300, 400], [0, 0, 640, 480], [500, 10, 560, 470.25]],
    "odd": [[3, 5, 320, 200], [100, 100, 110, 140]],
}
POINTS: dict[str, list[list[float]]] = {"landscape": [[320, 240], [10, 470]], "odd": [[30.5, 20]]}


def picture(width: int, height: int, seed: int = 0) -> NDArray[np.uint8]:
    """A picture uint8 [height, width, 3] with shades, edges and fine grain, from integers alone: the same bytes everywhere."""
    y, x = np.mgrid[:height, :width].astype(np.int64)
    channels = []
    for channel in range(3):
        k = seed * 3 + channel + 1
        shade = (x * (5 + k) // (2 + k) + y * (3 + 2 * k) // (1 + k)) % 256
        blocks = ((x // (11 + 7 * k) + y // (13 + 5 * k)) % 2) * 90
        grain = ((x * x * 7 + y * y * 13 + x * y * (3 + k)) >> 2) % 48
        channels.append(np.clip(shade // 2 + blocks + grain, 0, 255))
    return np.stack(channels, 2).astype(np.uint8)


def pictures() -> dict[str, NDArray[np.uint8]]:
    """All test pictures by name."""
    return {name: picture(*size, seed) for seed, (name, size) in enumerate(PICTURES.items())}


def probe(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """A megabyte of float [C, H, W] in some kilobytes: its shape, 512 of its values, the mean of each row and each column."""
    values = pixels.reshape(-1)
    chosen = values[np.linspace(0, values.size - 1, 512).astype(np.int64)]
    wide = pixels.astype(np.float64)
    return np.concatenate([pixels.shape, chosen, wide.mean(2).ravel(), wide.mean(1).ravel()]).astype(np.float32)


def unpacked(bits: NDArray[np.uint8], view: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """bool [n, H, W]: masks of a picture [H, W, 3] that were stored by ``np.packbits``."""
    size = view.shape[:2]
    count = bits.size * 8 // (size[0] * size[1])
    return np.unpackbits(bits, count=count * size[0] * size[1]).reshape(count, *size).astype(np.bool_)


def mask_agreement(found: NDArray[np.bool_], wanted: NDArray[np.bool_]) -> float:
    """The share of pixels on which masks agree."""
    return float((found == wanted).mean())


def sha256(data: bytes) -> str:
    """Hexadecimal sha256."""
    return hashlib.sha256(data).hexdigest()


def digest(array: NDArray[Any]) -> str:
    """sha256 of the array's shape, type and bytes: equal means equal in every bit."""
    head = f"{array.shape}{array.dtype.str}".encode()
    return sha256(head + np.ascontiguousarray(array).tobytes())


def reference(family: str) -> dict[str, NDArray[Any]]:
    """The reference pipeline's results for a family, by name."""
    with np.load(FIXTURES / family / "reference.npz", allow_pickle=False) as stored:
        return {name: stored[name] for name in stored.files}


def families() -> list[str]:
    """Names of the families that have fixtures."""
    return sorted(path.name for path in FIXTURES.iterdir() if path.is_dir())


def checksums(family: str) -> dict[str, str]:
    """sha256 of each file of a family, as found, but of its manifest."""
    paths = sorted(path for path in (FIXTURES / family).iterdir() if path.name != MANIFEST)
    return {path.name: sha256(path.read_bytes()) for path in paths}


def write_manifest(family: str, environment: dict[str, str]) -> None:
    """What made the family's files, and their checksums."""
    manifest = {"made_with": environment, "sha256": checksums(family)}
    (FIXTURES / family / MANIFEST).write_text(json.dumps(manifest, indent=1) + "\n")
