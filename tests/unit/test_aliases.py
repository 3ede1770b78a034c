from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from irsd.core.errors import ModelError
from irsd.perception.aliases import AliasTable

TABLE = AliasTable.load()


@pytest.mark.parametrize(
    ("name", "canonical"),
    [
        ("tv", "television"),
        ("the TV", "television"),
        ("Fridges", "refrigerator"),
        ("a bin", "trash can"),
        ("trash-can", "trash can"),
        ("Book Shelves", "bookcase"),
        ("bookshelf", "bookcase"),
        ("couches", "sofa"),
        ("AC", "air conditioner"),
        ("knives", "knife"),
        ("glasses", "glasses"),
        ("glass", "glass"),
        ("der Kühlschrank", "refrigerator"),
        ("Kuehlschrank", "refrigerator"),
        ("KÜHLSCHRANK", "refrigerator"),
        ("le canapé", "sofa"),
        ("l'armoire", "wardrobe"),
        ("sillas", "chair"),
        ("il frigorifero", "refrigerator"),
        ("洗衣机", "washing machine"),
        ("テレビ", "television"),
        ("холодильник", "refrigerator"),
        ("кроватью", "bed"),
        ("у холодильника", "у холодильника"),  # a phrase is not a name
    ],
)
def test_a_name_is_folded_to_its_canonical_form(name: str, canonical: str) -> None:
    assert TABLE.canonical(name) == canonical


@pytest.mark.parametrize(
    ("name", "canonical"),
    [
        ("Lab", "laboratory"),
        ("the sitting room", "living room"),
        ("WC", "toilet"),
        ("hallway", "corridor"),
        ("Badezimmer", "bathroom"),
        ("salle à manger", "dining room"),
        ("cocina", "kitchen"),
        ("camera da letto", "bedroom"),
        ("会议室", "meeting room"),
        ("寝室", "bedroom"),
        ("спальне", "bedroom"),
        ("кухню", "kitchen"),
        ("the Reactor Rooms", "reactor room"),
    ],
)
def test_a_kind_of_room_is_folded_to_its_canonical_form(name: str, canonical: str) -> None:
    assert TABLE.canonical_room(name) == canonical


def test_an_unknown_name_is_folded_but_not_known() -> None:
    assert TABLE.canonical("The Elephants") == "elephant"
    assert not TABLE.known("elephant")
    assert not TABLE.known("")
    assert TABLE.canonical("") == ""
    assert TABLE.senses("elephant") == ()
    assert not TABLE.known_room("reactor room")
    assert TABLE.find_room_kind("reactor room") is None


def test_what_is_a_kind_of_what() -> None:
    assert TABLE.is_a("coffee table", "table")
    assert TABLE.is_a("Couchtisch", "tables")
    assert not TABLE.is_a("table", "coffee table")
    assert not TABLE.is_a("coffee table", "dining table")
    assert TABLE.is_a("tv", "television")
    assert TABLE.is_a("armchair", "furniture")
    assert TABLE.is_a("gaming chair", "chair")  # unknown, but its last word is known
    assert not TABLE.is_a("chair leg", "chair")
    assert not TABLE.is_a("elephant", "furniture")


def test_a_word_may_have_several_senses_and_the_usual_one_comes_first() -> None:
    assert TABLE.senses("screen")[0] == "display"
    assert {"monitor", "projection screen"} < set(TABLE.senses("screen"))
    assert TABLE.senses("шкаф") == ("wardrobe", "cabinet")


def test_every_entry_means_itself_and_kinds_make_no_circle() -> None:
    assert len(set(TABLE.things)) == len(TABLE.things) > 250
    for name in TABLE.things:
        assert TABLE.canonical(name) == name
        assert name not in TABLE.ancestors(name)
    for room in TABLE.rooms:
        assert TABLE.canonical_room(room) == room
        kind = TABLE.find_room_kind(room)
        assert kind is not None
        assert [thing for thing in kind.objects if thing not in TABLE.things] == []


@settings(max_examples=200, deadline=None)
@given(st.text(max_size=20) | st.sampled_from(TABLE.things).map(str.upper))
def test_folding_twice_changes_nothing(name: str) -> None:
    once = TABLE.canonical(name)
    assert TABLE.canonical(once) == once or not TABLE.known(name)
    assert isinstance(TABLE.ancestors(name), tuple)


@pytest.mark.parametrize(
    "document",
    [
        {},
        {"objects": [{}], "rooms": []},
        {"objects": [{"name": "a", "parents": ["b"]}], "rooms": []},
        {"objects": ["a"], "rooms": []},
        {"objects": [{"name": 3}], "rooms": []},
    ],
)
def test_a_wrong_table_is_a_model_error(document: dict) -> None:
    with pytest.raises(ModelError):
        AliasTable(document)
