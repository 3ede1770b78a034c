"""Changes that somebody asks a running world for: JSON documents in, things carried about in the world."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from irsd.core.errors import DecodeError
from irsd.sim.furniture import person
from irsd.sim.rearrange import CATALOGUE
from irsd.sim.world import World


def apply(world: World, payload: bytes) -> dict[str, Any]:
    """Do what one ``irs/sim/change/1`` document says; returns the id of the thing. DecodeError says what is wrong with it.

    ``{"remove": ID}``, ``{"move": ID, "to": [x, y]}``, ``{"bring": NAME, "to": [x, y, z, yaw]}``, ``{"walk": [[x, y], ..]}`` (somebody
    at "speed_m_s"); z, yaw may be left out. IDs are those of ``irs-world --truth`` and of earlier answers.
    """
    try:
        document = json.loads(payload)
        if not isinstance(document, dict):
            raise ValueError("no object")
        return {"id": _apply(world, document)}
    except (ValueError, KeyError, TypeError) as error:
        raise DecodeError(f"no change: {error}") from error


def _apply(world: World, document: dict[str, Any]) -> int:
    rng = np.random.default_rng(len(world.building.things))
    if "remove" in document:
        world.remove(int(document["remove"]))
        return int(document["remove"])
    if "move" in document:
        world.move(int(document["move"]), *_numbers(document["to"], 2))
        return int(document["move"])
    if "bring" in document:
        if document["bring"] not in CATALOGUE:
            raise ValueError(f"{document['bring']!r} can't be brought: {', '.join(sorted(CATALOGUE))} can")
        return world.place(CATALOGUE[document["bring"]](rng), *_numbers(document["to"], 2))
    if "walk" in document:
        path = [_numbers(point, 2)[:2] for point in document["walk"]]
        if len(path) < 2:
            raise ValueError("a walk has two points at least")
        return world.walk(person(rng), path, float(document.get("speed_m_s", 1.0)))
    raise ValueError("one of remove, move, bring, walk is needed")


def _numbers(values: Any, least: int) -> list[float]:
    numbers = [float(v) for v in values]
    if not least <= len(numbers) <= 4 or not np.isfinite(numbers).all():
        raise ValueError(f"{values!r} is no place")
    return numbers
