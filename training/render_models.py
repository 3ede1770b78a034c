"""Things with surfaces, ready to be placed: the makers' furniture with materials drawn at random, the catalogues' with their own."""

from __future__ import annotations

import io
import pickle
import zipfile
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import cv2
import numpy as np
from numpy.typing import NDArray

from training import sweethome
from training.furniture.solids import Model
from training.render_textures import SIDE, Bank, Texture
from training.sweethome import mount_of

Rng = np.random.Generator
MOST_TRIANGLES = 40_000


@dataclass(frozen=True, slots=True)
class Surface:
    """texture: number in the bank; colour: float32 [3], 0..1, multiplies the texture (128 = as is); glow: share of own light."""

    texture: int
    colour: NDArray[np.float32]
    gloss: float
    glow: float


@dataclass(frozen=True, slots=True)
class Body:
    """A thing in its own frame (front +x, z up): triangles [T, 3, 3], uv [T, 3, 2] in repeats, surface [T] into surfaces."""

    name: str
    mount: str
    bottom_m: float
    triangles: NDArray[np.float32]
    uv: NDArray[np.float32]
    surface: NDArray[np.int32]
    surfaces: tuple[Surface, ...]


def projected(triangles: NDArray[np.float32], repeat_m: float) -> NDArray[np.float32]:
    """uv [T, 3, 2] of each triangle along the two axes that it faces least, one repeat in ``repeat_m``."""
    normal = np.abs(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]))
    axes = np.array([[1, 2], [0, 2], [0, 1]])[normal.argmax(1)]
    return np.asarray(np.take_along_axis(triangles, axes[:, None].repeat(3, 1), 2) / repeat_m, np.float32)


def fitted(triangles: NDArray[np.float32]) -> NDArray[np.float32]:
    """uv of a flat picture in the plane y, z: one repeat over all of it."""
    low, high = triangles.reshape(-1, 3).min(0), triangles.reshape(-1, 3).max(0)
    at = (triangles - low) / np.maximum(high - low, 1e-6)
    return np.stack([at[..., 1], 1 - at[..., 2]], -1).astype(np.float32) * 0.998


# kinds of texture, ranges of hue (0..1), saturation and value, gloss, glow
_WOODS = (("wood", "wood", "wood", "plain"), (0.04, 0.11), (0.15, 0.7), (0.2, 0.95), 0.1, 0.0)
_ANY = (("plain", "plain", "speckle"), (0, 1), (0.0, 0.8), (0.15, 1.0), 0.1, 0.0)
_WHITE = (("plain",), (0, 1), (0.0, 0.12), (0.75, 1.0), 0.2, 0.0)
_DARK = (("plain",), (0, 1), (0.0, 0.2), (0.03, 0.25), 0.3, 0.0)
_CLOTH = (("weave", "weave", "plain", "speckle", "stripes", "checks"), (0, 1), (0.0, 0.7), (0.15, 1.0), 0.0, 0.0)
_METALS = (("plain", "plain", "speckle"), (0.5, 0.7), (0.0, 0.15), (0.15, 0.85), 0.6, 0.0)
_LOOKS = {
    "wood": _WOODS, "metal": _METALS, "plastic_dark": _DARK, "plastic": _ANY, "fabric": _CLOTH, "enamel": _WHITE,
    "ceramic": (("plain", "plain", "speckle"), (0, 1), (0.0, 0.4), (0.5, 1.0), 0.4, 0.0),
    "glass": (("plain",), (0.45, 0.6), (0.0, 0.3), (0.5, 0.95), 0.6, 0.1),
    "glass_dark": _DARK, "leather": (("plain", "speckle"), (0.0, 0.12), (0.1, 0.7), (0.05, 0.9), 0.2, 0.0),
    "sheet": (("plain", "weave", "weave", "stripes", "drawing"), (0, 1), (0.0, 0.4), (0.5, 1.0), 0.0, 0.0),
    "stone": (("marble", "marble", "speckle", "plain"), (0.0, 0.2), (0.0, 0.25), (0.2, 0.95), 0.3, 0.0),
    "screen": (("plain", "plain", "photograph", "drawing"), (0, 1), (0.0, 0.2), (0.02, 0.4), 0.4, 0.3),
    "cardboard": (("plain", "speckle"), (0.07, 0.1), (0.3, 0.55), (0.45, 0.8), 0.0, 0.0),
    "mirror": (("photograph", "plain"), (0.5, 0.6), (0.0, 0.1), (0.6, 0.95), 0.8, 0.1),
    "lampshade": (("plain", "weave"), (0.08, 0.16), (0.0, 0.4), (0.7, 1.0), 0.0, 0.4),
    "carpet": (("drawing", "weave", "stripes", "drawing", "checks"), (0, 1), (0.0, 0.6), (0.2, 0.9), 0.0, 0.0),
    "book": (("plain", "spines", "drawing"), (0, 1), (0.1, 0.8), (0.2, 0.9), 0.1, 0.0),
    "artwork": (("photograph", "photograph", "drawing", "model"), (0, 1), (0.0, 0.0), (1.0, 1.0), 0.1, 0.1),
    "whiteboard": _WHITE, "leaf": (("speckle", "plain", "wood"), (0.2, 0.4), (0.3, 0.8), (0.2, 0.7), 0.1, 0.0),
    "terracotta": (("plain",), (0.03, 0.06), (0.4, 0.7), (0.4, 0.7), 0.0, 0.0),
    "wicker": (("weave",), (0.07, 0.12), (0.2, 0.6), (0.3, 0.8), 0.0, 0.0),
    "red": (("plain",), (0.97, 1.0), (0.7, 0.95), (0.5, 0.9), 0.3, 0.0),
}  # fmt: skip


def surface(material: str, bank: Bank, rng: Rng) -> Surface:
    """A look that such a material may have; now and then any look."""
    kinds, hue, saturation, value, gloss, glow = _LOOKS.get(material, _ANY)
    if rng.random() < 0.12:
        kinds, hue, saturation, value = tuple(bank.of_kind), (0, 1), (0.0, 1.0), (0.1, 1.0)
    kind = str(rng.choice(kinds))
    texture = int(rng.choice(bank.of_kind[kind] or bank.of_kind["plain"]))
    own = kind in ("photograph", "drawing", "model", "stripes", "checks", "spines")
    hsv = [
        rng.uniform(*hue) * 360,
        0.0 if own else rng.uniform(*saturation),
        rng.uniform(0.5, 1.0) if own else rng.uniform(*value),
    ]
    colour = cv2.cvtColor(np.array([[hsv]], np.float32), cv2.COLOR_HSV2RGB)[0, 0]
    return Surface(texture, colour, gloss * rng.uniform(0, 1.3), glow * rng.uniform(0, 1.5))


def of_model(model: Model, bank: Bank, rng: Rng) -> Body:
    """The maker's model: pieces of one material look alike, mostly."""
    looks: dict[str, Surface] = {}
    parts, uv, number, surfaces = [], [], [], []
    several = rng.random() < 0.25
    for piece in model.pieces:
        material = str(piece.material)
        if material not in looks or material in ("book", "artwork") or (several and rng.random() < 0.5):
            looks[material] = surface(material, bank, rng)
        flat = material in ("artwork", "screen", "carpet", "mirror")
        solid = np.asarray(piece.triangles, np.float32)
        if flat and material != "carpet":
            uv.append(fitted(solid))
        elif flat:
            uv.append(fitted(solid[..., [2, 0, 1]]))
        else:
            uv.append(projected(solid, float(np.exp(rng.uniform(np.log(0.15), np.log(1.5))))))
        parts.append(solid)
        number.append(np.full(len(solid), len(surfaces), np.int32))
        surfaces.append(looks[material])
    return Body(
        model.name,
        model.mount,
        model.bottom_m,
        np.concatenate(parts),
        np.concatenate(uv),
        np.concatenate(number),
        tuple(surfaces),
    )


# ------------------------------------------------------------------------------------------------ the catalogues
@dataclass(frozen=True, slots=True)
class Drawn:
    """A catalogue's model as read: texture numbers count within ``CatalogueModels.textures``, -1 for none."""

    name: str
    mount: str
    bottom_m: float
    triangles: NDArray[np.float32]
    uv: NDArray[np.float32]
    surface: NDArray[np.int32]
    looks: tuple[tuple[tuple[float, float, float], int], ...]


def catalogue(cache: Path) -> tuple[list[Drawn], list[Texture]]:
    """All indoor models of the catalogues and their textures; read once (two minutes), then from ``cache``."""
    if cache.exists():
        with cache.open("rb") as stream:
            return pickle.load(stream)  # our own file
    textures: dict[tuple[str, str], int] = {}
    pictures: list[Texture] = []
    drawn = []
    for entry in sweethome.entries():
        if entry.category in sweethome.OUTDOORS:
            continue
        model = _read(entry, textures, pictures)
        if model is not None:
            drawn.append(model)
    cache.parent.mkdir(parents=True, exist_ok=True)
    with cache.open("wb") as stream:
        pickle.dump((drawn, pictures), stream)
    return drawn, pictures


def of_drawn(drawn: Drawn, bank: Bank, rng: Rng) -> Body:
    """The catalogue's model, now and then in other colours."""
    first = bank.of_kind["model"][0] if bank.of_kind["model"] else 0
    turn = rng.uniform(0.75, 1.25, 3) if rng.random() < 0.6 else np.ones(3)
    surfaces = []
    for colour, texture in drawn.looks:
        if rng.random() < 0.15:
            surfaces.append(surface(str(rng.choice(list(_LOOKS))), bank, rng))
            continue
        number = int(rng.choice(bank.of_kind["plain"])) if texture < 0 else first + texture
        own = (0.5, 0.5, 0.5) if texture >= 0 else colour
        surfaces.append(
            Surface(number, np.clip(np.array(own) * turn, 0.02, 1).astype(np.float32), rng.uniform(0, 0.4), 0.0)
        )
    return Body(drawn.name, drawn.mount, drawn.bottom_m, drawn.triangles, drawn.uv, drawn.surface, tuple(surfaces))


def _read(entry: sweethome.Entry, textures: dict[tuple[str, str], int], pictures: list[Texture]) -> Drawn | None:
    with zipfile.ZipFile(entry.archive) as archive:
        lines = archive.read(entry.member).decode("latin1")
        folder = PurePosixPath(entry.member).parent
        library = next((line.split(None, 1)[1].strip() for line in io.StringIO(lines) if line.startswith("mtllib")), "")
        looks = _looks(archive, folder, library, entry.archive.name, textures, pictures)
    vertices, maps, rows, map_rows, number = [], [], [], [], []
    names: dict[str, int] = {"": 0}
    current = 0
    for line in io.StringIO(lines):
        word = line.split()
        if not word:
            continue
        if word[0] == "v":
            vertices.append([float(v) for v in word[1:4]])
        elif word[0] == "vt":
            maps.append([float(v) for v in word[1:3]])
        elif word[0] == "usemtl":
            current = names.setdefault(" ".join(word[1:]), len(names))
        elif word[0] == "f":
            corners = [c.split("/") for c in word[1:]]
            at = [int(c[0]) for c in corners]
            at = [c - 1 if c > 0 else len(vertices) + c for c in at]
            uv = [int(c[1]) if len(c) > 1 and c[1] else 0 for c in corners]
            uv = [c - 1 if c > 0 else (len(maps) + c if c < 0 else -1) for c in uv]
            for k in range(1, len(at) - 1):
                rows.append((at[0], at[k], at[k + 1]))
                map_rows.append((uv[0], uv[k], uv[k + 1]))
                number.append(current)
    if not rows or len(rows) > MOST_TRIANGLES:
        return None
    solid = sweethome.upright(np.array(vertices)[np.array(rows)], entry)
    uv = np.array([*maps, [0.0, 0.0]], np.float32)[np.array(map_rows)]
    uv[..., 1] = 1 - uv[..., 1]
    missing = (np.array(map_rows) < 0).any(1)
    uv[missing] = projected(solid[missing], 0.5)
    default = ((0.7, 0.7, 0.7), -1)
    return Drawn(
        "sh3d:" + entry.name, mount_of(entry), entry.elevation_m, solid, uv, np.array(number, np.int32),
        tuple(looks.get(name, default) for name in names),
    )  # fmt: skip


def _looks(archive, folder, library, archive_name, textures, pictures):
    """Materials of a model's library by name: colour and texture."""
    looks: dict[str, tuple[tuple[float, float, float], int]] = {}
    try:
        text = archive.read(str(folder / library)).decode("latin1")
    except KeyError:
        return looks
    name = ""
    for line in io.StringIO(text):
        word = line.split()
        if not word:
            continue
        if word[0] == "newmtl":
            name = " ".join(word[1:])
            looks[name] = ((0.7, 0.7, 0.7), -1)
        elif word[0] == "Kd" and name:
            looks[name] = (tuple(float(v) for v in word[1:4]), looks[name][1])
        elif word[0] == "map_Kd" and name:
            member = str(folder / word[-1])
            key = (archive_name, member)
            if key not in textures:
                try:
                    image = cv2.imdecode(np.frombuffer(archive.read(member), np.uint8), cv2.IMREAD_COLOR)
                except KeyError:
                    image = None
                if image is None:
                    continue
                textures[key] = len(pictures)
                pictures.append(cv2.resize(image, (SIDE, SIDE), interpolation=cv2.INTER_AREA)[..., ::-1].copy())
            looks[name] = (looks[name][0], textures[key])
    return looks
