"""What usually stands on what: a television on its stand, a microscope on a workbench.

In a map such pairs touch, and a robot is sent to one of the two; so both kinds of training scenes hold many of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from training.furniture import decor, electronics, household, kitchen, shelves, tableware, workplace
from training.furniture.solids import Model, Triangles

Rng = np.random.Generator
Maker = Callable[[Rng], Model]

_SCREEN = (electronics.television, electronics.television, electronics.television, electronics.old_television)
_AT_HOME = (
    electronics.speaker,
    electronics.game_console,
    electronics.router,
    decor.photo_frame,
    household.vase,
    household.plant,
)
_COOKING = (kitchen.microwave, kitchen.microwave, kitchen.toaster, kitchen.kettle, kitchen.coffee_machine)
_WORK = (
    electronics.monitor,
    electronics.monitor,
    electronics.laptop,
    electronics.keyboard,
    electronics.printer,
    decor.table_lamp,
)
_RESEARCH = (workplace.microscope, workplace.microscope, workplace.centrifuge, electronics.monitor, tableware.bottle)
_BEDSIDE = (decor.table_lamp, decor.table_lamp, tableware.alarm_clock, decor.photo_frame)
_MEAL = (tableware.tableware, tableware.bowl, household.vase, tableware.plate, tableware.bottle, shelves.book_pile)

# (share that carries something, what its middle carries, what its ends carry) by carrier
USUAL: dict[str, tuple[float, tuple[Maker, ...], tuple[Maker, ...]]] = {
    "TV stand": (0.75, _SCREEN, _AT_HOME),
    "sideboard": (0.5, _SCREEN, _AT_HOME),
    "console table": (0.3, _SCREEN, _AT_HOME),
    "chest of drawers": (0.4, _SCREEN, _AT_HOME),
    "desk": (0.7, _WORK, _WORK),
    "workbench": (0.7, _RESEARCH, _RESEARCH),
    "kitchen cabinet": (0.5, _COOKING, _COOKING),
    "nightstand": (0.6, _BEDSIDE, _BEDSIDE),
    "dining table": (0.4, _MEAL, _MEAL),
    "coffee table": (0.4, _MEAL, _MEAL),
}


def upon(rng: Rng, name: str, solid: Triangles) -> Iterator[tuple[Model, float, float, float, float]]:
    """What stands on a carrier of that name, solid [T, 3, 3] in its own frame (front +x): (model, x, y, z, yaw) in that frame.

    It faces where its carrier faces, stands on the carrier's highest level and mostly on its back half.
    """
    if name not in USUAL or rng.random() > USUAL[name][0]:
        return
    _, middle, ends = USUAL[name]
    corners = solid.reshape(-1, 3)
    low, high = corners.min(0), corners.max(0)
    end = 0.0
    for makers, side in ((middle, 0), (ends, -1), (ends, 1)):
        if side and rng.random() < 0.6:
            continue
        model = makers[int(rng.integers(len(makers)))](rng)
        own = model.triangles().reshape(-1, 3)
        deep, wide = own[:, 0].max() - own[:, 0].min(), np.abs(own[:, 1]).max()
        if model.mount != "top" or deep > high[0] - low[0] + 0.1:
            continue
        room = (high[1] - low[1]) / 2 - wide
        if side == 0:
            y, end = (high[1] + low[1]) / 2 + float(rng.normal(0, 0.08)) * max(room, 0.0), wide + 0.03
        elif room < end + wide:
            continue
        else:
            y = (high[1] + low[1]) / 2 + side * float(rng.uniform(end + wide, room))
        slack = (high[0] - low[0] - deep) / 2
        x = (
            (low[0] + high[0]) / 2
            - (own[:, 0].max() + own[:, 0].min()) / 2
            + float(rng.uniform(-1, 0.8)) * max(slack, 0)
        )
        yield model, float(x), float(y), float(high[2]) - float(own[:, 2].min()), float(rng.normal(0, 0.05))
