"""All makers of furniture in one place, drawn by weight."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from training.furniture import (
    appliances,
    bathroom,
    beds,
    cabinets,
    decor,
    electronics,
    household,
    kitchen,
    seating,
    shelves,
    sports,
    tables,
    tableware,
    workplace,
)
from training.furniture.solids import Model

Maker = Callable[[np.random.Generator], Model]
# In this order, because what a seed draws depends on it.
_MODULES = (
    seating,
    beds,
    tables,
    cabinets,
    shelves,
    kitchen,
    appliances,
    electronics,
    bathroom,
    workplace,
    sports,
    decor,
    household,
    tableware,
)
MAKERS: tuple[tuple[Maker, float], ...] = tuple(maker for module in _MODULES for maker in module.MAKERS)
_WEIGHTS = np.array([weight for _, weight in MAKERS])


def draw(rng: np.random.Generator) -> Model:
    """A new thing, stretched a little along each axis: no two are alike."""
    maker = MAKERS[int(rng.choice(len(MAKERS), p=_WEIGHTS / _WEIGHTS.sum()))][0]
    return maker(rng)


def names() -> tuple[str, ...]:
    """All names the makers give, sorted."""
    rng = np.random.default_rng(0)
    return tuple(sorted({maker(rng).name for maker, _ in MAKERS for _ in range(3)}))
