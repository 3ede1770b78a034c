"""Names by shape and picture: what is likely wins, what is like nothing is an object, and what was taught is recognised."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from irsd.core.types import InstanceState, Prototype
from irsd.perception.commonness import commonness
from irsd.perception.naming import UNKNOWN, Namer, NamingSettings
from irsd.perception.prototypes import MARGIN, Example, liken

Floats = NDArray[np.float32]
NAMES = ("chair", "table", "television")
AXES = np.eye(8, dtype=np.float32)


def embed(names: Sequence[str]) -> Floats:
    known = {name: AXES[k] for k, name in enumerate((*NAMES, UNKNOWN))}
    return np.stack([known[name] for name in names])


class ByHeight:
    """A shape "network" for tests of its user: a cloud as high as k metres lies along axis k. Counts what it encodes."""

    def __init__(self) -> None:
        self.encoded = 0

    def encode(self, clouds: Sequence[Floats], floor_z_m: float) -> Floats:
        self.encoded += len(clouds)
        out = np.zeros((len(clouds), 8), np.float32)
        for k, cloud in enumerate(clouds):
            out[k, int(np.ptp(cloud[:, 2]))] = 1.0
        return out


def thing(number: int, height: float, count: int = 50, image: Floats | None = None) -> InstanceState:
    points = np.zeros((count, 3), np.float32)
    points[:, 2] = np.linspace(0, height, count)
    return InstanceState(number, points, image, ((UNKNOWN, 1.0),), 0, 3, 1.0, 0, 0)


def unit(*parts: float) -> Floats:
    vector = np.zeros(8, np.float32)
    vector[: len(parts)] = parts
    return vector / np.float32(np.linalg.norm(vector))


def floor(room: int) -> float:
    return 0.0


def namer_of(shapes: ByHeight, settings: NamingSettings, scale: float = 20.0, least: float = 0.3) -> Namer:
    return Namer(settings, shapes, embed, NAMES, scale=scale, min_probability=least)


def test_shape_and_picture_are_weighed_and_chances_add_up() -> None:
    namer = namer_of(ByHeight(), NamingSettings(shape_share=0.25))
    assert namer.rank(unit(1.0), None)[0][0] == "chair"
    assert namer.rank(None, unit(0.0, 1.0))[0][0] == "table"
    both = namer.rank(unit(1.0), unit(0.0, 1.0))  # they disagree: the weightier one wins
    assert both[0][0] == "table"
    vectors = embed((*NAMES, UNKNOWN))
    cosines = 20.0 * NamingSettings().both * (0.25 * vectors @ unit(1.0) + 0.75 * vectors @ unit(0.0, 1.0))
    chance = np.exp(cosines) * commonness((*NAMES, UNKNOWN)) ** NamingSettings().commonness
    chance /= chance.sum()
    assert abs(both[0][1] - chance[1]) < 1e-5
    for ranked in (both, namer.rank(unit(1.0), None)):
        assert sum(score for _, score in ranked) <= 1.0


def test_of_two_likely_names_the_commoner_one_is_meant_and_no_prior_outweighs_what_is_seen() -> None:
    namer = namer_of(ByHeight(), NamingSettings())
    alike = namer.rank(unit(1.0, 1.0), None)  # as much a chair as a table; there are more chairs
    assert alike[0][0] == "chair"
    assert alike[1][0] == "table"
    assert namer.rank(unit(0.5, 1.0), None)[0][0] == "table"
    level = namer_of(ByHeight(), NamingSettings(commonness=0.0)).rank(unit(1.0, 1.0), None)
    assert level[0][1] == level[1][1]
    assert commonness(["incubator"])[0] == 1.0


def test_what_is_like_nothing_is_an_object_first_and_its_best_guesses_come_after() -> None:
    namer = namer_of(ByHeight(), NamingSettings(), scale=1.0, least=0.5)
    ranked = namer.rank(unit(1.0, 0.9), None)
    assert ranked[0][0] == UNKNOWN
    assert [name for name, _ in ranked[1:3]] == ["chair", "table"]
    assert ranked[0][1] >= ranked[1][1]
    assert sum(score for _, score in ranked) <= 1.0
    assert namer.rank(None, None) == ((UNKNOWN, 1.0),)
    assert namer.rank(embed([UNKNOWN])[0], None)[0][0] == UNKNOWN


def test_shapes_are_encoded_a_few_at_a_time_and_again_only_when_the_cloud_changed_much() -> None:
    shapes = ByHeight()
    namer = namer_of(shapes, NamingSettings(shapes_per_step=2, changed_share=0.2))
    told = namer.name([thing(k, 1.5) for k in range(1, 6)], (), floor)
    assert [state.labels[0][0] for state in told] == ["table", "table", UNKNOWN, UNKNOWN, UNKNOWN]
    assert [state.id for state in namer.name((), (), floor)] == [3, 4]  # their turn: told again by themselves
    namer.name((), (), floor)
    assert shapes.encoded == 5
    namer.name([thing(1, 1.5, count=55)], (), floor)
    assert shapes.encoded == 5
    assert namer.name([thing(1, 2.5, count=55)], (), floor)[0].labels[0][0] == "television"
    assert shapes.encoded == 6
    namer.name((), (1, 2, 3, 4, 5), floor)
    assert namer.name((), (), floor) == ()


def test_a_part_of_the_map_is_encoded_anew_only_when_it_has_changed_by_much() -> None:
    shapes = ByHeight()
    namer = namer_of(shapes, NamingSettings(changed_share=0.2))
    assert namer.name_of(7, thing(1, 1.5).points_map, 0.0)[0] == "table"
    assert namer.name_of(7, thing(1, 1.5, count=55).points_map, 0.0)[0] == "table"
    assert shapes.encoded == 1
    assert namer.name_of(7, thing(1, 2.5).points_map, 0.0)[0] == "television"
    assert namer.name_of(8, thing(1, 5.5).points_map, 0.0)[0] == UNKNOWN
    assert shapes.encoded == 3
    for number in range(1000, 1300):  # more than are kept
        namer.name_of(number, thing(1, 1.5).points_map, 0.0)
    namer.name_of(7, thing(1, 2.5).points_map, 0.0)
    assert shapes.encoded == 304


def test_a_taught_thing_names_the_next_one_and_no_other() -> None:
    namer = namer_of(ByHeight(), NamingSettings())
    (before,) = namer.name([thing(1, 5.5)], (), floor)
    assert before.labels[0][0] == UNKNOWN  # like none of the names
    example = thing(9, 5.2)
    namer.learn((Prototype("centrifuge", example.points_map, None),))
    names = {state.id: state.labels[0][0] for state in namer.name([thing(2, 1.5), thing(3, 5.8)], (), floor)}
    names |= {state.id: state.labels[0][0] for state in namer.name((), (), floor)}
    assert names == {1: "centrifuge", 2: "table", 3: "centrifuge"}
    namer.learn(())
    assert namer.name([replace(before, last_seen_ns=5)], (), floor)[0].labels[0][0] == UNKNOWN


def test_likeness_to_examples() -> None:
    a, b = unit(1.0), unit(0.0, 1.0)
    examples = (Example("lamp", a, None), Example("lamp", b, b), Example("vase", None, None))
    assert liken(examples, a, None) == {"lamp": (1.0 - MARGIN, 1.0 - MARGIN)}
    assert liken(examples, b, b) == {"lamp": (1.0 - MARGIN, 1.0 - MARGIN)}
    assert liken((), a, b) == {}
    assert liken(examples, None, None) == {}
