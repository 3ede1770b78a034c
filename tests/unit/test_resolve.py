"""Goals on a graph that is known exactly: the right one, an honest question, or not found with the reason."""

from __future__ import annotations

from dataclasses import replace

import navigation_house as house
import numpy as np
import pytest

from irsd.graph.model import GraphSnapshot
from irsd.perception.encoder import LabelEncoder
from nav_bridge import relations as rel
from nav_bridge.evidence import EvidenceSettings, Knowledge
from nav_bridge.language import parse
from nav_bridge.relations import Boxes
from nav_bridge.resolve import Ambiguous, NotFound, Resolution, Resolved, ResolveSettings, resolve


@pytest.fixture(scope="module")
def knowledge() -> Knowledge:
    return Knowledge(LabelEncoder.load(), EvidenceSettings())


def ask(
    text: str, knowledge: Knowledge, graph: GraphSnapshot = house.GRAPH, at: tuple[float, float] = (2.5, 3.0)
) -> Resolution:
    return resolve(parse(text, knowledge.names), graph, knowledge, at, ResolveSettings())


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("TV in the laboratory", "I2"),
        ("TV in the lab", "I2"),
        ("television in the kitchen", "I12"),
        ("the TV that is not in the kitchen", "I2"),
        ("fridge", "I6"),
        ("Kühlschrank", "I6"),
        ("冷蔵庫", "I6"),
        ("bin in the kitchen", "I14"),
        ("trash can in R2", "I14"),
        ("I14", "I14"),
        ("nearest trash can", "I4"),
        ("any trash can", "I4"),
        ("the second trash can", "I14"),
        ("chair at the desk", "I3"),
        ("red chair", "I10"),
        ("blue chair", "I3"),
        ("cup on the dining table", "I13"),
        ("hood above the stove", "I8"),
        ("stove under the range hood", "I7"),
        ("table with a cup on it", "I9"),
        ("screen on the desk", "I5"),
        ("where can I cook", "I7"),
        ("the office chair", "I3"),
        ("chair nearest to the fridge", "I11"),
        ("TV above the dining table", None),
    ],
)
def test_resolved(text: str, wanted: str | None, knowledge: Knowledge) -> None:
    answer = ask(text, knowledge)
    if wanted is None:
        assert not isinstance(answer, Resolved)
        return
    assert isinstance(answer, Resolved), answer
    assert answer.target.instance == wanted


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("the TV", {"I2", "I12"}),
        ("trash can", {"I4", "I14"}),
        ("chair next to the dining table", {"I10", "I11"}),
        ("chair in the kitchen", {"I10", "I11"}),
    ],
)
def test_ambiguous_names_the_candidates(text: str, wanted: set[str], knowledge: Knowledge) -> None:
    answer = ask(text, knowledge)
    assert isinstance(answer, Ambiguous), answer
    assert {c.instance for c in answer.candidates} == wanted
    assert answer.question


@pytest.mark.parametrize(
    "text",
    [
        "elephant",
        "bathtub",
        "washing machine",
        "fire extinguisher",
        "fridge in the laboratory",
        "stove in the bathroom",
        "third TV",
        "",
        "kitchen",
    ],
)
def test_not_found_has_a_reason(text: str, knowledge: Knowledge) -> None:
    answer = ask(text, knowledge)
    assert isinstance(answer, NotFound), answer
    assert answer.reason


def test_a_missing_anchor_is_a_doubt_and_no_guess(knowledge: Knowledge) -> None:
    answer = ask("desk next to the piano", knowledge)
    assert isinstance(answer, Ambiguous)
    assert "piano" in answer.question


def test_empty_graph(knowledge: Knowledge) -> None:
    empty = replace(house.GRAPH, rooms=(), doors=(), instances=())
    assert isinstance(ask("TV", knowledge, empty), NotFound)


def test_slips_and_fragments_do_not_compete(knowledge: Knowledge) -> None:
    slip = house.instance(30, "chair", "R2", (6, 1, 0), (6.4, 1.4, 0.9), (("chair", 0.8), ("refrigerator", 0.02)))
    piece = replace(house.instance(31, "refrigerator", "R2", (9.28, 0.5, 1), (9.32, 0.6, 1.1)), point_count=20)
    graph = replace(house.GRAPH, instances=(*house.THINGS, slip, piece))
    answer = ask("fridge", knowledge, graph)
    assert isinstance(answer, Resolved)
    assert answer.target.instance == "I6"
    gone = replace(house.GRAPH, instances=tuple(replace(t, state="gone") for t in house.THINGS))
    assert isinstance(ask("fridge", knowledge, gone), NotFound)


def test_two_halves_of_one_table_are_one_and_tables_beside_each_other_are_two(knowledge: Knowledge) -> None:
    def two(gap_m: float) -> Resolution:
        west = house.instance(50, "workbench", "R1", (1.0, 1.0, 0), (2.0, 2.0, 0.74))
        east = house.instance(51, "workbench", "R1", (2.0 + gap_m, 1.0, 0.3), (2.9 + gap_m, 1.9, 0.74))
        return ask("workbench", knowledge, replace(house.GRAPH, instances=(*house.THINGS, west, east)))

    one = two(-0.3)
    assert isinstance(one, Resolved)
    assert one.target.instance == "I50"
    for gap_m in (-0.05, 0.0, 0.2):  # boxes of things that touch overlap by what their masks bled
        assert isinstance(two(gap_m), Ambiguous)


def test_what_was_only_glimpsed_does_not_compete_with_what_was_seen_well(knowledge: Knowledge) -> None:
    """The edge of a mask fell on a chair in the other room, in a few pictures of one glance."""
    far = house.instance(30, "refrigerator", "R1", (2.0, 2.0, 0.5), (2.05, 2.05, 0.7))
    well = next(t for t in house.THINGS if t.id == "I6")
    glimpse = replace(far, observations=well.observations // 4, point_count=well.point_count // 20)
    graph = replace(house.GRAPH, instances=(*house.THINGS, glimpse))
    answer = ask("fridge", knowledge, graph)
    assert isinstance(answer, Resolved)
    assert answer.target.instance == "I6"
    assert next(c for c in answer.considered if c.instance == "I30").rejected == "only glimpsed, I6 was seen well"
    alone = replace(graph, instances=tuple(t for t in graph.instances if t.id != "I6"))
    answer = ask("fridge", knowledge, alone)
    assert isinstance(answer, Resolved)
    assert answer.target.instance == "I30", "alone it is what there is"
    for seen, points in ((well.observations, glimpse.point_count), (glimpse.observations, well.point_count)):
        other = replace(glimpse, observations=seen, point_count=points)
        assert isinstance(ask("fridge", knowledge, replace(graph, instances=(*house.THINGS, other))), Ambiguous)


def test_a_second_name_counts_and_a_part_of_a_joined_room_is_told_by_its_things(knowledge: Knowledge) -> None:
    stand = house.instance(
        40, "tv stand", "R1", (4.5, 4.4, 0), (4.9, 5.6, 0.5), (("tv stand", 0.7), ("tv cabinet", 0.1))
    )
    graph = replace(house.GRAPH, instances=(*house.THINGS, stand))
    answer = ask("cabinet under the TV", knowledge, graph)
    assert isinstance(answer, Resolved)
    assert answer.target.instance == "I40"
    joined = replace(house.GRAPH.rooms[1], label="living room", labels=(("living room", 0.7),))
    graph = replace(house.GRAPH, rooms=(house.GRAPH.rooms[0], joined))
    answer = ask("fridge in the kitchen", knowledge, graph)
    assert isinstance(answer, Resolved)
    assert answer.target.instance == "I6"


def one(*center_size_yaw: object) -> Boxes:
    center, size, *yaw = center_size_yaw
    return rel.boxes([(center, size, yaw[0] if yaw else 0.0)])  # type: ignore[list-item]


def test_relations_of_boxes() -> None:
    table = one((0, 0, 0.4), (1.6, 0.8, 0.8))
    cup = one((0.3, 0.1, 0.85), (0.1, 0.1, 0.1))
    mat = one((0, 0, 0.01), (1.0, 0.6, 0.02))
    lamp = one((0, 0, 2.0), (0.4, 0.4, 0.4))
    chair = one((1.2, 0, 0.45), (0.4, 0.4, 0.9))
    far = one((6, 0, 0.45), (0.4, 0.4, 0.9))
    turned = one((1.2, 0, 0.45), (2.0, 0.1, 0.9), 1.5708)
    assert rel.on(cup, table) > 0.9
    assert rel.on(table, cup) == 0.0
    assert rel.on(chair, table) == 0.0
    assert rel.above(lamp, table) > 0.9
    assert rel.above(table, lamp) == 0.0
    assert rel.under(mat, table) > 0.9
    assert rel.near(chair, table) > rel.near(far, table) == 0.0
    assert rel.between(table, chair, one((-1.2, 0, 0.45), (0.4, 0.4, 0.9))) > 0.9
    assert rel.between(far, chair, table) == 0.0
    assert rel.plan_gap(table, chair) == pytest.approx(0.2)
    assert rel.plan_gap(table, turned) == pytest.approx(0.35, abs=1e-3)
    assert rel.plan_gap(one((0, 0, 0), (4, 0.2, 1)), one((0, 0, 0), (0.2, 4, 1))) == 0.0  # crossed: no corner is inside
    square = ((0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (0.0, 4.0))
    assert rel.in_corner(one((0.4, 0.4, 0.5), (0.4, 0.4, 1)), square) > 0.9
    assert rel.in_corner(one((2.0, 2.0, 0.5), (0.4, 0.4, 1)), square) == 0.0
    assert rel.in_corner(table, ()) == 0.0
    eye = np.array([[0.0, -5.0]])
    assert rel.beside(one((-1.2, 0, 0.4), (0.4, 0.4, 0.9)), table, eye, "left") > 0.9
    assert rel.beside(chair, table, eye, "left") == 0.0
    assert rel.beside(chair, table, eye, "right") > 0.9
    assert rel.beside(chair, table, -eye, "left") > 0.9
    assert rel.beside(one((0, 1.2, 0.4), (0.4, 0.4, 0.9)), table, eye, "behind") > 0.9
