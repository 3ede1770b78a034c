"""How many of a kind stand in a home or on a floor of offices: what a name is worth before anything has been looked at.

The networks were trained on as many toilets as chairs. A building holds one of the first and eight of the second, so that what looks
about equally like both is a chair. The numbers are what anyone would guess of five rooms, written down before any name was scored.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

_PER_HOME = {
    20.0: "object",  # pieces of walls, and what nobody has a word for
    8.0: "chair, picture",
    5.0: "book, door, window",
    4.0: "pillow, plant, light switch",
    3.0: (
        "cabinet, kitchen cabinet, shelf, lamp, ceiling lamp, bottle, cup, trash can, curtain, box, radiator, photo frame"
    ),
    2.0: "nightstand, bed, bowl, towel, rug, shoes",
    1.5: "wardrobe, bookcase, chest of drawers, television, mirror, vase, office chair, table lamp",
    1.2: "sofa",
    0.8: "stove, oven, microwave",
    0.7: (
        "computer, washing machine, shower, backpack, air conditioner, seasoning jars, range hood, chandelier, "
        "dishwasher, coffee machine"
    ),
    0.5: "telephone, bathtub, suitcase, fan, shoe rack, tablet",
    0.4: "printer, ball, bicycle, ottoman, notice board",
    0.3: "bench, whiteboard, fire extinguisher, dumbbell, security camera",
    0.2: "fireplace, ladder, robot vacuum",
    0.1: (
        "treadmill, piano, workbench, exercise ball, weight bench, copier, fume hood, microscope, centrifuge, gas cylinder"
    ),
}
_COUNTS = {name: count for count, names in _PER_HOME.items() for name in names.split(", ")}


def commonness(names: Sequence[str]) -> NDArray[np.float64]:
    """[n] how many of each a home has; 1 for names that nothing is said of: a site that lists an incubator has one."""
    return np.array([_COUNTS.get(name, 1.0) for name in names])
