"""Questions that tell candidates apart: whoever answers one, in the words it offers, is understood to mean that candidate."""

from __future__ import annotations

from dataclasses import replace

import navigation_house as house
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from irsd.graph.model import GraphSnapshot, InstanceNode
from irsd.perception.encoder import LabelEncoder
from nav_bridge.evidence import EvidenceSettings, Knowledge
from nav_bridge.goal import GoalSpec
from nav_bridge.language import parse
from nav_bridge.resolve import Ambiguous, Resolution, Resolved, ResolveSettings, resolve
from nav_bridge.say import say

ENCODER = LabelEncoder.load()
KNOWLEDGE = Knowledge(ENCODER, EvidenceSettings())
AT = (2.5, 3.0)


def asked(text: str, graph: GraphSnapshot) -> Resolution:
    return resolve(parse(text, KNOWLEDGE.names), graph, KNOWLEDGE, AT, ResolveSettings())


def with_things(*things: InstanceNode) -> GraphSnapshot:
    return replace(house.GRAPH, instances=(*house.THINGS, *things))


@pytest.mark.parametrize(
    ("text", "question", "answers"),
    [
        ("the TV", "the one in R1 laboratory or the one in R2 kitchen?", {"television in R1", "television in R2"}),
        ("der Mülleimer", "the one in R", {"trash can in R1", "trash can in R2"}),
        ("chair in the kitchen", "next to", None),
        ("chair next to the dining table", "", None),
    ],
)
def test_every_answer_means_its_candidate(text: str, question: str, answers: set[str] | None) -> None:
    answer = asked(text, house.GRAPH)
    assert isinstance(answer, Ambiguous), answer
    assert question in answer.question or answers is None
    if answers is not None:
        assert {c.answer for c in answer.candidates} == answers
    for candidate in answer.candidates:
        meant = asked(candidate.answer, house.GRAPH)
        assert isinstance(meant, Resolved), (candidate.answer, meant)
        assert meant.target.instance == candidate.instance


def test_the_question_is_about_what_tells_them_apart() -> None:
    boxes = [
        house.instance(50, "box", "R1", (1.0, 1.0, 0.0), (1.3, 1.3, 0.3)),
        house.instance(51, "box", "R1", (3.0, 1.0, 0.0), (4.2, 2.0, 0.9)),
    ]
    answer = asked("box", with_things(*boxes))
    assert isinstance(answer, Ambiguous)
    assert "largest" in answer.question
    boxes[1] = house.instance(51, "box", "R1", (0.2, 5.4, 0.0), (0.5, 5.7, 0.3))
    answer = asked("box", with_things(*boxes))
    assert isinstance(answer, Ambiguous)
    assert "the one next to the desk" in answer.question
    red, blue = (
        replace(box, labels=(("box", 0.7), (f"{c} box", 0.2))) for box, c in zip(boxes, ("red", "blue"), strict=True)
    )
    answer = asked("box", with_things(red, blue))
    assert isinstance(answer, Ambiguous)
    assert "the red one or the blue one" in answer.question


NAMES = ("chair", "box", "plant", "lamp")
PLACES = st.tuples(
    st.floats(0.2, 9.5), st.floats(0.2, 5.5), st.sampled_from(NAMES), st.floats(0.2, 0.8), st.integers(5, 90)
)


@settings(max_examples=60, deadline=None)
@given(st.lists(PLACES, min_size=2, max_size=14))
def test_in_any_building_every_answer_means_its_candidate(things: list[tuple[float, float, str, float, int]]) -> None:
    nodes = [
        house.instance(
            100 + k, name, "R1" if x < 5 else "R2", (x, y, 0.0), (x + size, y + size, size), observations=seen
        )
        for k, (x, y, name, size, seen) in enumerate(things)
    ]
    graph = with_things(*nodes)
    for name in NAMES:
        answer = asked(name, graph)
        if isinstance(answer, Ambiguous):
            assert answer.question
            for candidate in answer.candidates:
                meant = asked(candidate.answer, graph)
                assert isinstance(meant, Resolved), (candidate, meant)
                assert meant.target.instance == candidate.instance, (candidate, meant)


@pytest.mark.parametrize(
    "text",
    [
        "second nearest red chair next to the desk in R2",
        "chair left of the sofa in the kitchen seen from the door",
        "lamp between the bed and the wardrobe",
        "table with the cup on it not in the kitchen",
        "plant in the corner in the kitchen",
        "left chair",
        "front door",
        "chair nearest to the refrigerator",
    ],
)
def test_what_is_said_is_understood_again(text: str) -> None:
    spec = parse(text, KNOWLEDGE.names)
    assert _bare(parse(say(spec, KNOWLEDGE.names), KNOWLEDGE.names)) == _bare(spec)


def _bare(spec: GoalSpec) -> GoalSpec:
    return replace(spec, text="", language="")


def test_many_rivals_are_told_apart_in_little_words() -> None:
    rng = np.random.default_rng(1)
    nodes = [
        house.instance(200 + k, "stool", "R1", (x, y, 0.0), (x + 0.3, y + 0.3, 0.5))
        for k, (x, y) in enumerate(rng.uniform((0.2, 0.2), (4.4, 5.4), (30, 2)))
    ]
    answer = asked("stool", with_things(*nodes))
    assert isinstance(answer, Ambiguous)
    assert len(answer.candidates) == ResolveSettings().max_candidates
    assert len(answer.question) < 400
