"""Parametric furniture at real sizes, each made of boxes and cylinders. +x is an item's front; sizes vary with the generator."""

from __future__ import annotations

import numpy as np

from irsd.sim.parts import Colour, Item, Part, box, cylinder

WOODS: tuple[Colour, ...] = ((150, 104, 62), (181, 139, 92), (104, 70, 44), (196, 164, 122))
FABRICS: tuple[Colour, ...] = ((74, 96, 128), (122, 62, 58), (86, 104, 78), (128, 124, 118), (60, 60, 66))
WHITE: Colour = (226, 226, 222)
STEEL: Colour = (168, 172, 176)
BLACK: Colour = (28, 28, 32)
DARK: Colour = (62, 62, 66)

Rng = np.random.Generator


def pick(rng: Rng, choices: tuple[Colour, ...]) -> Colour:
    """One of the colours."""
    return choices[int(rng.integers(len(choices)))]


def _legs(dx: float, dy: float, height: float, side: float, colour: Colour) -> tuple[Part, ...]:
    """Four square legs inside the corners of a dx by dy rectangle about the origin."""
    x, y = dx / 2 - side, dy / 2 - side
    return tuple(
        box(sx * x - side / 2, sx * x + side / 2, sy * y - side / 2, sy * y + side / 2, 0.0, height, colour)
        for sx in (-1, 1)
        for sy in (-1, 1)
    )


def _slab(dx: float, dy: float, z0: float, z1: float, colour: Colour) -> Part:
    """A box dx by dy about the origin."""
    return box(-dx / 2, dx / 2, -dy / 2, dy / 2, z0, z1, colour)


# --------------------------------------------------------------------------------------- tables and seats
def table(rng: Rng, dx: float, dy: float, height: float = 0.74, label: str = "table") -> Item:
    """A table with four legs."""
    wood = pick(rng, WOODS)
    names = {
        "table": ("dining table", "wooden table"),
        "desk": ("office desk", "writing desk"),
        "coffee table": ("low table",),
        "lab bench": ("laboratory bench", "workbench"),
    }
    parts = (_slab(dx, dy, height - 0.035, height, wood), *_legs(dx, dy, height - 0.035, 0.05, wood))
    return Item(label, names[label], parts)


def lab_bench(rng: Rng, dx: float, dy: float) -> Item:
    """A bench 0.9 m high with cupboards below and a dark top."""
    return Item(
        "lab bench",
        ("laboratory bench", "workbench"),
        (_slab(dx - 0.06, dy - 0.04, 0.05, 0.86, WHITE), _slab(dx, dy, 0.86, 0.90, DARK)),
    )


def chair(rng: Rng) -> Item:
    """A chair with a back, seat 0.45 m high."""
    wood = pick(rng, WOODS)
    legs = _legs(0.42, 0.42, 0.43, 0.035, wood)
    return Item(
        "chair",
        ("seat", "dining chair"),
        (*legs, _slab(0.42, 0.42, 0.43, 0.47, wood), box(-0.21, -0.18, -0.2, 0.2, 0.47, 0.9, wood)),
    )


def office_chair(rng: Rng) -> Item:
    """A swivel chair."""
    fabric = pick(rng, FABRICS)
    parts = (
        cylinder(0, 0, 0.26, 0.03, 0.08, BLACK),
        cylinder(0, 0, 0.03, 0.08, 0.42, STEEL),
        _slab(0.46, 0.46, 0.42, 0.5, fabric),
        box(-0.25, -0.2, -0.21, 0.21, 0.5, 0.98, fabric),
    )
    return Item("office chair", ("swivel chair", "desk chair"), parts)


def stool(rng: Rng) -> Item:
    """A round lab stool."""
    seat = cylinder(0, 0, 0.17, 0.6, 0.65, BLACK)
    return Item(
        "stool", ("lab stool",), (cylinder(0, 0, 0.2, 0, 0.03, STEEL), cylinder(0, 0, 0.03, 0.03, 0.6, STEEL), seat)
    )


def sofa(rng: Rng) -> Item:
    """A sofa for two or three."""
    fabric, dy = pick(rng, FABRICS), float(rng.uniform(1.6, 2.0))
    half = dy / 2
    parts = (
        box(-0.42, 0.42, -half, half, 0.06, 0.42, fabric),
        box(-0.42, -0.2, -half, half, 0.42, 0.82, fabric),
        box(-0.2, 0.42, -half, -half + 0.17, 0.42, 0.6, fabric),
        box(-0.2, 0.42, half - 0.17, half, 0.42, 0.6, fabric),
    )
    return Item("sofa", ("couch", "settee"), parts)


def bed(rng: Rng) -> Item:
    """A bed 2.05 m long, head to the wall (the front is its foot)."""
    half = float(rng.uniform(0.6, 0.8))
    wood, fabric = pick(rng, WOODS), pick(rng, FABRICS)
    parts = (
        box(-1.03, -0.97, -half, half, 0, 0.95, wood),
        box(-0.97, 1.02, -half, half, 0.08, 0.3, wood),
        box(-0.95, 1.0, -half + 0.03, half - 0.03, 0.3, 0.48, WHITE),
        box(-0.4, 1.01, -half + 0.02, half - 0.02, 0.48, 0.54, fabric),
        box(-0.9, -0.5, -half + 0.1, half - 0.1, 0.48, 0.58, (238, 236, 228)),
    )
    return Item("bed", ("double bed",), parts)


def nightstand(rng: Rng) -> Item:
    """A bedside cabinet."""
    return Item("nightstand", ("bedside table", "night table"), (_slab(0.4, 0.42, 0, 0.5, pick(rng, WOODS)),))


# --------------------------------------------------------------------------------------- storage and white goods
def wardrobe(rng: Rng) -> Item:
    """A wardrobe 2 m high."""
    wood, dy = pick(rng, WOODS), float(rng.uniform(1.0, 1.4))
    doors = (box(0.27, 0.3, -dy / 2, -0.01, 0.06, 1.98, wood), box(0.27, 0.3, 0.01, dy / 2, 0.06, 1.98, wood))
    return Item("wardrobe", ("closet", "cupboard"), (box(-0.3, 0.27, -dy / 2, dy / 2, 0, 2.0, wood), *doors))


def shelf(rng: Rng, dy: float = 0.9, height: float = 1.8, label: str = "bookshelf") -> Item:
    """An open shelf, its boards full of things (one item: shelf and content)."""
    wood, half = pick(rng, WOODS), dy / 2
    parts = [box(-0.15, 0.15, s * half - 0.012, s * half + 0.012, 0, height, wood) for s in (-1, 1)]
    parts.append(box(-0.15, -0.13, -half, half, 0, height, wood))
    for z in np.linspace(0.08, height, 5):
        parts.append(box(-0.13, 0.15, -half, half, z - 0.02, z, wood))
    for z in np.linspace(0.08, height, 5)[:-1]:
        y = -half + 0.04
        while y < half - 0.12:
            wide, tall = float(rng.uniform(0.03, 0.1)), float(rng.uniform(0.18, 0.32))
            colour = (int(rng.integers(40, 210)), int(rng.integers(40, 210)), int(rng.integers(40, 210)))
            parts.append(box(-0.12, float(rng.uniform(0.02, 0.1)), y, y + wide, z, z + tall, colour))
            y += wide + float(rng.choice([0.005, 0.005, 0.12]))
    names = {"bookshelf": ("bookcase", "shelf"), "shelf": ("rack", "storage shelf")}
    return Item(label, names[label], tuple(parts))


def fridge(rng: Rng) -> Item:
    """A fridge with its handle."""
    handle = box(0.32, 0.345, 0.2, 0.23, 0.8, 1.3, STEEL)
    return Item("fridge", ("refrigerator",), (_slab(0.64, 0.6, 0.02, 1.75, WHITE), handle))


def stove(rng: Rng) -> Item:
    """A cooker with four plates."""
    plates = tuple(cylinder(sx * 0.14, sy * 0.14, 0.085, 0.9, 0.91, BLACK) for sx in (-1, 1) for sy in (-1, 1))
    door = box(0.3, 0.31, -0.26, 0.26, 0.2, 0.7, BLACK)
    return Item("stove", ("oven", "cooker"), (_slab(0.6, 0.6, 0, 0.9, STEEL), door, *plates))


def kitchen_sink(rng: Rng) -> Item:
    """A sink unit: cupboard, steel basin rim and tap."""
    tap = (cylinder(-0.22, 0, 0.02, 0.92, 1.2, STEEL), box(-0.22, -0.02, -0.015, 0.015, 1.17, 1.2, STEEL))
    rim = (
        box(-0.28, 0.28, -0.36, 0.36, 0.88, 0.92, STEEL),
        box(-0.13, 0.22, -0.3, 0.3, 0.921, 0.925, DARK),
    )
    return Item("sink", ("kitchen sink", "washbasin"), (_slab(0.58, 0.78, 0, 0.88, pick(rng, WOODS)), *rim, *tap))


def counter(rng: Rng, dy: float) -> Item:
    """A kitchen cabinet with a worktop."""
    return Item(
        "cabinet",
        ("kitchen cabinet", "cupboard"),
        (_slab(0.58, dy - 0.02, 0, 0.88, pick(rng, WOODS)), _slab(0.6, dy, 0.88, 0.91, (120, 116, 110))),
    )


def microwave(rng: Rng) -> Item:
    """A microwave oven."""
    door = box(0.17, 0.18, -0.23, 0.12, 0.03, 0.27, BLACK)
    return Item("microwave", ("microwave oven",), (_slab(0.34, 0.5, 0, 0.29, STEEL), door))


def coffee_machine(rng: Rng) -> Item:
    """A coffee machine."""
    parts = (
        _slab(0.34, 0.28, 0, 0.06, BLACK),
        box(-0.17, -0.02, -0.14, 0.14, 0.06, 0.38, BLACK),
        box(-0.02, 0.17, -0.14, 0.14, 0.28, 0.38, STEEL),
    )
    return Item("coffee machine", ("coffee maker", "espresso machine"), parts)


# --------------------------------------------------------------------------------------- screens and machines
def television(rng: Rng, dy: float) -> Item:
    """A TV panel on its foot, the screen towards the front."""
    height = dy * 0.57
    parts = (
        _slab(0.2, 0.5, 0, 0.02, BLACK),
        box(-0.02, 0.02, -0.06, 0.06, 0.02, 0.1, BLACK),
        box(-0.03, 0.03, -dy / 2, dy / 2, 0.08, 0.08 + height, BLACK),
        box(0.03, 0.034, -dy / 2 + 0.02, dy / 2 - 0.02, 0.1, 0.06 + height, (44, 66, 98)),
    )
    return Item("tv", ("television", "television set"), parts)


def tv_stand(rng: Rng, dy: float) -> Item:
    """A low cabinet that carries a TV."""
    return Item("tv stand", ("tv cabinet", "sideboard"), (_slab(0.36, dy, 0.03, 0.5, pick(rng, WOODS)),))


def monitor(rng: Rng) -> Item:
    """A computer monitor on its foot."""
    parts = (
        _slab(0.18, 0.24, 0, 0.015, BLACK),
        box(-0.03, 0.0, -0.03, 0.03, 0.015, 0.16, BLACK),
        box(0.0, 0.03, -0.29, 0.29, 0.1, 0.45, BLACK),
        box(0.03, 0.033, -0.275, 0.275, 0.115, 0.435, (70, 110, 150)),
    )
    return Item("monitor", ("computer screen", "display"), parts)


def keyboard(rng: Rng) -> Item:
    """A keyboard (small: seen only from near)."""
    return Item("keyboard", (), (_slab(0.15, 0.44, 0, 0.025, DARK),))


def printer(rng: Rng) -> Item:
    """A floor-standing office printer."""
    return Item(
        "printer",
        ("copier", "photocopier"),
        (_slab(0.56, 0.58, 0.02, 0.72, WHITE), _slab(0.5, 0.56, 0.72, 0.98, DARK)),
    )


def microscope(rng: Rng) -> Item:
    """A microscope 0.42 m high."""
    parts = (
        _slab(0.26, 0.2, 0, 0.05, DARK),
        box(-0.12, -0.05, -0.05, 0.05, 0.05, 0.34, WHITE),
        box(-0.12, 0.1, -0.045, 0.045, 0.3, 0.38, WHITE),
        cylinder(0.06, 0, 0.03, 0.2, 0.3, BLACK),
        _slab(0.16, 0.16, 0.13, 0.15, BLACK),
        cylinder(-0.08, 0, 0.03, 0.38, 0.46, BLACK),
    )
    return Item("microscope", ("optical microscope",), parts)


def fume_hood(rng: Rng) -> Item:
    """A fume hood: cupboard, work space with sash, and hood up to 2.3 m."""
    parts = (
        _slab(0.8, 1.3, 0, 0.88, WHITE),
        box(-0.4, -0.34, -0.65, 0.65, 0.88, 2.3, WHITE),
        box(-0.34, 0.36, -0.65, -0.58, 0.88, 1.7, WHITE),
        box(-0.34, 0.36, 0.58, 0.65, 0.88, 1.7, WHITE),
        box(-0.34, 0.38, -0.65, 0.65, 1.7, 2.3, STEEL),
        box(0.34, 0.36, -0.58, 0.58, 1.25, 1.7, (150, 186, 190)),
    )
    return Item("fume hood", ("fume cupboard", "laboratory hood"), parts)


def gas_cylinder(rng: Rng) -> Item:
    """A gas bottle 1.5 m high."""
    parts = (cylinder(0, 0, 0.115, 0, 1.35, (46, 96, 64)), cylinder(0, 0, 0.05, 1.35, 1.5, STEEL))
    return Item("gas cylinder", ("gas bottle",), parts)


# --------------------------------------------------------------------------------------- bathroom
def toilet(rng: Rng) -> Item:
    """A toilet with its cistern at the back."""
    parts = (
        box(-0.34, -0.16, -0.19, 0.19, 0.35, 0.8, WHITE),
        box(-0.34, 0.12, -0.12, 0.12, 0, 0.38, WHITE),
        Part((-0.16, -0.18, 0.36), (0.32, 0.18, 0.43), WHITE, round=True),
    )
    return Item("toilet", ("lavatory",), parts)


def bathtub(rng: Rng) -> Item:
    """A bathtub along the wall."""
    half, white = 0.8, WHITE
    parts = (
        box(-0.36, 0.36, -half, half, 0, 0.15, white),
        box(-0.36, -0.3, -half, half, 0.15, 0.56, white),
        box(0.3, 0.36, -half, half, 0.15, 0.56, white),
        box(-0.3, 0.3, -half, -half + 0.06, 0.15, 0.56, white),
        box(-0.3, 0.3, half - 0.06, half, 0.15, 0.56, white),
    )
    return Item("bathtub", ("bath", "tub"), parts)


def washbasin(rng: Rng) -> Item:
    """A washbasin on its column, tap at the back."""
    parts = (
        cylinder(-0.05, 0, 0.09, 0, 0.7, WHITE),
        box(-0.22, 0.22, -0.28, 0.28, 0.7, 0.84, WHITE),
        cylinder(-0.17, 0, 0.018, 0.84, 0.98, STEEL),
    )
    return Item("sink", ("washbasin", "hand basin"), parts)


# --------------------------------------------------------------------------------------- small things and walls
def plant(rng: Rng) -> Item:
    """A potted plant."""
    green, height = (58, int(rng.integers(100, 140)), 54), float(rng.uniform(0.8, 1.2))
    pot = (cylinder(0, 0, 0.15, 0, 0.3, (150, 86, 60)), cylinder(0, 0, 0.02, 0.3, 0.55, (92, 70, 46)))
    leaves = (
        cylinder(0, 0, 0.22, 0.5, 0.75, green),
        cylinder(0.05, 0.04, 0.17, 0.75, height, green),
        cylinder(-0.12, 0.06, 0.11, 0.6, height - 0.1, green),
    )
    return Item("plant", ("potted plant", "houseplant"), pot + leaves)


def trash_can(rng: Rng) -> Item:
    """A waste bin."""
    return Item("trash can", ("waste bin", "garbage can", "bin"), (cylinder(0, 0, 0.15, 0, 0.42, DARK),))


def floor_lamp(rng: Rng) -> Item:
    """A standing lamp."""
    parts = (
        cylinder(0, 0, 0.14, 0, 0.03, BLACK),
        cylinder(0, 0, 0.015, 0.03, 1.35, STEEL),
        cylinder(0, 0, 0.18, 1.3, 1.6, (240, 226, 180)),
    )
    return Item("lamp", ("floor lamp", "standing lamp"), parts)


def cardboard_box(rng: Rng) -> Item:
    """A cardboard box."""
    dx, dy, dz = (float(v) for v in rng.uniform((0.3, 0.3, 0.25), (0.45, 0.5, 0.45)))
    return Item("box", ("cardboard box", "carton"), (_slab(dx, dy, 0, dz, (176, 138, 92)),))


def flat_on_wall(label: str, synonyms: tuple[str, ...], dy: float, dz: float, colours: tuple[Colour, Colour]) -> Item:
    """A picture, whiteboard or mirror: a thin frame with a panel in front; its origin is its lower edge."""
    frame, panel = colours
    parts = (
        _slab(0.02, dy, 0, dz, frame),
        box(0.01, 0.014, -dy / 2 + 0.03, dy / 2 - 0.03, 0.03, dz - 0.03, panel),
    )
    return Item(label, synonyms, parts)


# --------------------------------------------------------------------------------------- who walks by
def person(rng: Rng) -> Item:
    """Somebody standing upright."""
    cloth, height = pick(rng, FABRICS), float(rng.uniform(1.6, 1.85))
    parts = (
        cylinder(0, 0.1, 0.08, 0, 0.8, DARK),
        cylinder(0, -0.1, 0.08, 0, 0.8, DARK),
        cylinder(0, 0, 0.2, 0.8, height - 0.3, cloth),
        cylinder(0, 0, 0.11, height - 0.3, height, (214, 172, 140)),
    )
    return Item("person", ("human", "man", "woman"), parts)
