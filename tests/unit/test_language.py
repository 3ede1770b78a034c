"""The goal grammar against tables of sentences, in eight languages."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from irsd.perception.aliases import AliasTable
from nav_bridge.language import GoalSpec, parse

NAMES = AliasTable.load()


def goal(text: str) -> GoalSpec:
    return parse(text, NAMES)


def things(spec: GoalSpec) -> list[str]:
    return [NAMES.canonical(thing.name) for thing in spec.things]


@pytest.mark.parametrize(
    ("text", "thing", "room"),
    [
        ("TV in the laboratory", "television", "laboratory"),
        ("go to the fridge in the kitchen, please", "refrigerator", "kitchen"),
        ("could you please take me to the printer", "printer", ""),
        ("where is the trash can?", "trash can", ""),
        ("bedroom TV", "television", "bedroom"),
        ("the bedroom's lamp", "lamp", "bedroom"),
        ("the plant that is standing in the hallway", "plant", "corridor"),
        ("ladle hanging in the kitchen", "kitchen utensils", "kitchen"),
        ("chest of drawers", "chest of drawers", ""),
        ("kitchen cabinet", "kitchen cabinet", ""),
        ("Geh bitte zum Kühlschrank in der Küche", "refrigerator", "kitchen"),
        ("der Fernseher im Wohnzimmer", "television", "living room"),
        ("la télévision dans le salon", "television", "living room"),
        ("la mesa del comedor", "dining table", ""),
        ("el sofá en la sala de estar", "sofa", "living room"),
        ("il cestino in camera da letto", "trash can", "bedroom"),
        ("найди холодильник на кухне", "refrigerator", "kitchen"),
        ("шкаф в спальне", "wardrobe", "bedroom"),
        ("带我去厨房的冰箱", "refrigerator", "kitchen"),
        ("卧室里的电视", "television", "bedroom"),
        ("寝室のテレビ", "television", "bedroom"),
        ("キッチンにある冷蔵庫に行って", "refrigerator", "kitchen"),
    ],
)
def test_thing_and_room(text: str, thing: str, room: str) -> None:
    spec = goal(text)
    assert things(spec) == [thing]
    assert (NAMES.canonical_room(spec.room) if spec.room else "") == room
    assert spec.relations == ()


@pytest.mark.parametrize(
    ("text", "kind", "anchors"),
    [
        ("chair next to the dining table", "near", ["dining table"]),
        ("chair at the desk", "at", ["desk"]),
        ("cup on top of the dining table", "on", ["dining table"]),
        ("cabinet under the TV", "under", ["television"]),
        ("picture above the sofa", "above", ["sofa"]),
        ("sofa in front of the television", "front", ["television"]),
        ("nightstand with a photo on it", "has_on", ["photo frame"]),
        ("lamp between the bed and the wardrobe", "between", ["bed", "wardrobe"]),
        ("chair closest to the window", "nearest", ["window"]),
        ("desk without a lamp", "without", ["lamp"]),
        ("plant in the corner of the office", "corner", []),
        ("dumbbell on the floor", "floor", []),
        ("Stuhl neben dem Schreibtisch", "near", ["desk"]),
        ("la poubelle à côté du canapé", "near", ["sofa"]),
        ("la lámpara encima de la mesa", "over", ["table"]),
        ("la sedia vicino al letto", "near", ["bed"]),
        ("стул рядом с кроватью", "near", ["bed"]),
        ("沙发旁边的垃圾桶", "near", ["sofa"]),
        ("テーブルの上の花瓶", "over", ["table"]),
    ],
)
def test_relation(text: str, kind: str, anchors: list[str]) -> None:
    spec = goal(text)
    assert [r.kind for r in spec.relations] == [kind]
    assert [NAMES.canonical(a.name) for a in spec.relations[0].anchors] == anchors
    assert len(spec.things) == 1


@pytest.mark.parametrize(
    ("text", "choice", "rank"),
    [
        ("the chair", "", 1),
        ("any chair", "any", 1),
        ("a chair", "any", 1),
        ("nearest chair", "nearest", 1),
        ("the chair nearest to me", "nearest", 1),
        ("the second chair", "ordinal", 2),
        ("the biggest table", "largest", 1),
        ("der nächste Stuhl", "nearest", 1),
        ("最近的椅子", "nearest", 1),
    ],
)
def test_choice(text: str, choice: str, rank: int) -> None:
    assert (goal(text).choice, goal(text).rank) == (choice, rank)


@pytest.mark.parametrize(
    ("text", "best"),
    [
        ("where can I cook", "stove"),
        ("something to sit on", "sofa"),
        ("I want to wash my hands", "sink"),
        ("place where I can throw away trash", "trash can"),
        ("somewhere to sleep", "bed"),
        ("I am thirsty", "water dispenser"),
        ("etwas zum Sitzen", "sofa"),
        ("哪里可以做饭", "stove"),
    ],
)
def test_purpose(text: str, best: str) -> None:
    spec = goal(text)
    assert things(spec)[0] == NAMES.canonical(best)
    assert spec.choice == "any"
    assert spec.function


def test_purpose_keeps_the_room() -> None:
    assert goal("something to sit on in the kitchen").room == "kitchen"


def test_negation() -> None:
    assert goal("the trash can that is not in the bedroom").not_rooms == ("bedroom",)
    assert goal("TV but not the one in the bedroom").not_rooms == ("bedroom",)
    assert goal("chair not at the desk").relations[0].negated


def test_attributes() -> None:
    assert goal("orange chair").things[0].attributes == (("colour", "orange"),)
    assert goal("la silla azul").things[0].attributes == (("colour", "blue"),)
    assert goal("红色的椅子").things[0].attributes == (("colour", "red"),)
    assert goal("small round table").things[0].attributes == (("size", "small"), ("kind", "round"))


def test_rooms_and_nothing() -> None:
    assert goal("go to the kitchen").room_is_goal
    assert goal("").things == ()
    assert goal("?!").things == ()
    unknown = goal("piano bench")
    assert unknown.things[0].name == "piano bench"


@given(st.text(max_size=60))
def test_any_text_parses(text: str) -> None:
    spec = goal(text)
    assert spec.text == text
    assert spec.rank >= 1


WORDS = (
    "the",
    "a",
    "tv",
    "in",
    "on",
    "next",
    "to",
    "of",
    "not",
    "with",
    "kitchen",
    "table",
    "nearest",
    "between",
    "and",
)
WORDS += ("it", "where", "can", "i", "sit", "s")


@given(st.lists(st.sampled_from(WORDS), max_size=9))
def test_any_order_of_its_own_words_parses(tokens: list[str]) -> None:
    spec = goal(" ".join(tokens))
    assert all(thing.name for thing in spec.things)
