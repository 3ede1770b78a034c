"""irsctl rooms and config check: work on files, no irsd needed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click
import cv2
import numpy as np
from numpy.typing import NDArray

from irsd.config import load_config, load_yaml_mapping
from irsd.core.errors import ConfigError
from irsd.core.types import RoomSegmentation
from irsd.ctl.draw import ROOM_PALETTE
from irsd.rooms.segment import segment_map

FREE_GREY = 250
USUAL_RESOLUTION_M = 0.05  # the default of the usual mapping packages


def rooms(map_file: Path, resolution_m: float | None, out: Path, as_json: bool) -> int:
    """Writes the label image, ``<out>.geojson`` and ``<out>.picture.png``; prints what was found."""
    image, resolution_m, origin_xy = load_map(map_file, resolution_m)
    segmentation = segment_map(np.ascontiguousarray(image[::-1]), resolution_m)  # grids have their lowest y in row 0
    labels = segmentation.labels[::-1].astype(np.uint16)
    out.parent.mkdir(parents=True, exist_ok=True)
    _write_png(out, labels)
    geojson = out.with_suffix(".geojson")
    geojson.write_text(json.dumps(to_geojson(segmentation, origin_xy), indent=1) + "\n")
    picture = out.with_suffix(".picture.png")
    _write_png(picture, paint(image, labels))
    found = {
        "rooms": len(segmentation.rooms),
        "openings": len(segmentation.openings),
        "labels": str(out),
        "geojson": str(geojson),
        "picture": str(picture),
    }
    if as_json:
        click.echo(json.dumps(found))
    else:
        click.echo(f"{found['rooms']} rooms, {found['openings']} openings: wrote {out}, {geojson}, {picture}")
    return 0


def load_map(path: Path, resolution_m: float | None) -> tuple[NDArray[np.uint8], float, tuple[float, float]]:
    """(uint8 [H, W] with free floor >= 250, metres per pixel, origin x, y) of a map_server yaml or a bare picture."""
    origin = (0.0, 0.0)
    free_from = FREE_GREY
    negate = False
    if path.suffix in (".yaml", ".yml"):
        meta = load_yaml_mapping(path)
        missing = {"image", "resolution"} - set(meta)
        if missing:
            raise ConfigError(f"{path}: not a map_server file, {', '.join(sorted(missing))} missing")
        resolution_m = resolution_m or float(meta["resolution"])
        x, y, *_ = meta.get("origin", (0.0, 0.0))
        origin, negate = (float(x), float(y)), bool(meta.get("negate", 0))
        free_from = int(np.ceil((1.0 - float(meta.get("free_thresh", 0.196))) * 255))
        path = path.parent / str(meta["image"])
    if resolution_m is None:
        click.echo(
            f"{path}: a bare picture has no scale, taking {USUAL_RESOLUTION_M} m per pixel; --resolution sets it",
            err=True,
        )
        resolution_m = USUAL_RESOLUTION_M
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise ConfigError(f"{path}: not a picture that can be read (png or pgm)")
    image = 255 - image if negate else image
    free = image >= min(free_from, FREE_GREY)
    return np.where(free, 255, np.minimum(image, FREE_GREY - 1)).astype(np.uint8), resolution_m, origin


def to_geojson(segmentation: RoomSegmentation, origin_xy: tuple[float, float]) -> dict[str, Any]:
    """Rooms as polygons and openings as lines, in the map's metres."""
    ox, oy = (o - f for o, f in zip(origin_xy, segmentation.frame.origin_xy_m, strict=True))
    features: list[dict[str, Any]] = []
    for number, room in enumerate(segmentation.rooms, 1):
        ring = [[round(float(x) + ox, 3), round(float(y) + oy, 3)] for x, y in room.polygon_xy]
        geometry = {"type": "Polygon", "coordinates": [[*ring, ring[0]]]}
        features.append(
            {
                "type": "Feature",
                "geometry": geometry,
                "properties": {"kind": "room", "id": f"R{number}", "area_m2": round(room.area_m2, 2)},
            }
        )
    for opening in segmentation.openings:
        line = [[round(float(x) + ox, 3), round(float(y) + oy, 3)] for x, y in opening.segment_xy]
        properties = {
            "kind": "opening",
            "rooms": [f"R{k}" for k in opening.rooms],
            "width_m": round(opening.width_m, 2),
        }
        features.append(
            {"type": "Feature", "geometry": {"type": "LineString", "coordinates": line}, "properties": properties}
        )
    return {"type": "FeatureCollection", "features": features}


def paint(image: NDArray[np.uint8], labels: NDArray[np.uint16]) -> NDArray[np.uint8]:
    """The map with its rooms tinted: bgr uint8 [H, W, 3]."""
    palette = np.array([c[::-1] for c in ROOM_PALETTE], np.uint8)
    out = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
    inside = labels > 0
    out[inside] = palette[(labels[inside] - 1) % len(palette)]
    return np.asarray(out, np.uint8)


def config_check(file: Path, as_json: bool) -> int:
    """Exit code 0 for a good file, 1 with every problem named."""
    try:
        load_config(file)
    except ConfigError as error:
        click.echo(json.dumps({"ok": False, "error": str(error)}) if as_json else str(error), err=not as_json)
        return 1
    click.echo(json.dumps({"ok": True}) if as_json else f"{file}: good")
    return 0


def _write_png(path: Path, image: NDArray[Any]) -> None:
    if not cv2.imwrite(str(path), image):
        raise ConfigError(f"{path}: can't be written as a picture")
