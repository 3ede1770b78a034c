"""The 3D models of Debian's package sweethome3d-furniture: names, real sizes and triangles.

Five catalogues, CC-BY 3.0 and CC0 (``irsd/models/nano/NOTICE.md``). The program's own catalogue, in the package sweethome3d, is GPL-2+ and left
out. Models are turned so that +x is their front, as everywhere here, and stand on z = 0 in metres.
"""

from __future__ import annotations

import io
import re
import zipfile
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

CATALOGUES = Path("/usr/share/sweethome3d/furniture")
OUTDOORS = ("Exterior", "Vehicles", "Characters", "Staircases", "Doors and windows")


@dataclass(frozen=True, slots=True)
class Entry:
    """One model: catalogue file, member path of its .obj, name, category, size (depth, width, height) and elevation in metres."""

    archive: Path
    member: str
    name: str
    category: str
    size_m: tuple[float, float, float]
    elevation_m: float
    creator: str


def entries() -> list[Entry]:
    """All furniture of the catalogues that are installed, in a fixed order. FileNotFoundError tells what to install."""
    archives = [(path, "PluginFurnitureCatalog.properties") for path in sorted(CATALOGUES.glob("*.sh3f"))]
    if not archives:
        raise FileNotFoundError("no models: apt-get install sweethome3d-furniture")
    return [entry for path, member in archives for entry in _catalogue(path, member)]


def _catalogue(path: Path, member: str) -> list[Entry]:
    with zipfile.ZipFile(path) as archive:
        text = archive.read(member).decode("latin1")
    fields: dict[int, dict[str, str]] = defaultdict(dict)
    for key, number, value in re.findall(r"^(\w+)#(\d+)\s*=\s*(.*?)\s*$", text, re.M):
        fields[int(number)][key] = value
    found = []
    for _, field in sorted(fields.items()):
        if "model" not in field or not field["model"].endswith(".obj"):
            continue
        size = tuple(float(field[k]) / 100 for k in ("depth", "width", "height"))
        name = field["name"].encode("latin1").decode("unicode_escape")
        found.append(
            Entry(
                path,
                field["model"].lstrip("/"),
                name,
                field.get("category", ""),
                size,
                float(field.get("elevation", 0)) / 100,
                field.get("creator", ""),
            )  # type: ignore[arg-type]
        )
    return found


def mount_of(entry: Entry) -> str:
    """Where a catalogue's model belongs, from its elevation, height and name."""
    name = entry.name.lower()
    if any(word in name for word in ("ceiling", "pendant", "chandelier", "hanging")):
        return "ceiling"
    if entry.elevation_m > 0.05:
        return "wall"
    return "top" if max(entry.size_m) < 0.45 else "floor"


def collection(cache: Path, max_triangles: int) -> list[tuple[Entry, NDArray[np.float32]]]:
    """All indoor models of at most max_triangles, read once and kept in a file (reading .obj text takes minutes)."""
    indoor = [entry for entry in entries() if entry.category not in OUTDOORS]
    if not cache.exists():
        solids = [triangles(entry) for entry in indoor]
        part = cache.with_suffix(".part.npz")
        np.savez(part, **{f"m{k}": solid for k, solid in enumerate(solids) if 0 < len(solid) <= max_triangles})
        part.rename(cache)
    with np.load(cache) as kept:
        return [(entry, kept[f"m{k}"]) for k, entry in enumerate(indoor) if f"m{k}" in kept]


def triangles(entry: Entry) -> NDArray[np.float32]:
    """float32 [T, 3, 3], metres, front +x, standing on z = 0, scaled to the catalogue's size."""
    with zipfile.ZipFile(entry.archive) as archive:
        text = archive.read(entry.member).decode("latin1")
    vertices, index = [], []
    for line in io.StringIO(text):
        if line.startswith("v "):
            vertices.append([float(v) for v in line.split()[1:4]])
        elif line.startswith("f "):
            corner = [int(c.split("/")[0]) for c in line.split()[1:]]
            corner = [c - 1 if c > 0 else len(vertices) + c for c in corner]
            index += [(corner[0], corner[k], corner[k + 1]) for k in range(1, len(corner) - 1)]
    if not index:
        return np.empty((0, 3, 3), np.float32)
    return upright(np.array(vertices)[np.array(index)], entry)


def upright(solid: NDArray[np.float64], entry: Entry) -> NDArray[np.float32]:
    """Triangles [T, 3, 3] of an .obj (x right, y up, z to the viewer = front) as everywhere here, at the catalogue's size."""
    solid = solid[..., [2, 0, 1]]
    low, high = solid.reshape(-1, 3).min(0), solid.reshape(-1, 3).max(0)
    scale = np.array(entry.size_m) / np.maximum(high - low, 1e-6)
    centre = np.array([*((low + high) / 2)[:2], low[2]])
    return np.asarray((solid - centre) * scale, np.float32)
