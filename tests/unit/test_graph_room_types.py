"""Room types on lists of things, written from what such rooms usually hold."""

from __future__ import annotations

import pytest

from irsd.graph.room_types import Evidence, RoomTyper, RoomTypeSettings
from irsd.perception.encoder import LabelEncoder

VOLUME_M3 = {
    **{"bed": 2.0, "wardrobe": 1.5, "sofa": 1.5, "table": 0.8, "chair": 0.25, "desk": 0.8, "picture": 0.02, "tv": 0.1},
    **{"fridge": 1.0, "stove": 0.4, "sink": 0.15, "toilet": 0.25, "mirror": 0.05, "bathtub": 0.8, "lab bench": 1.5},
    **{"microscope": 0.05, "conference table": 2.0, "whiteboard": 0.15, "treadmill": 0.8, "dumbbell": 0.01},
    **{"office chair": 0.3, "monitor": 0.03, "exercise ball": 0.1, "coffee table": 0.3, "cup": 0.001},
}


@pytest.fixture(scope="module")
def encoder() -> LabelEncoder:
    return LabelEncoder.load()


@pytest.fixture(scope="module")
def typer(encoder: LabelEncoder) -> RoomTyper:
    return RoomTyper(RoomTypeSettings(), encoder)


def things(text: str) -> list[Evidence]:
    return [Evidence(((name, 1.0),), VOLUME_M3.get(name, 0.1)) for name in text.split(", ") if name]


@pytest.mark.parametrize(
    ("kind", "inside"),
    [
        ("kitchen", "fridge, stove, sink, table, chair, chair, chair"),
        ("bedroom", "bed, wardrobe, nightstand, picture, picture, picture, tv"),
        ("bathroom", "bathtub, sink, mirror, towel"),
        ("living room", "sofa, coffee table, tv, picture, plant"),
        ("office", "desk, desk, office chair, office chair, monitor, monitor, plant, trash can"),
        ("meeting room", "conference table, office chair, office chair, office chair, whiteboard, tv"),
        ("laboratory", "lab bench, lab bench, microscope, stool, sink, monitor"),
        ("gym", "treadmill, dumbbell, mirror, exercise bike"),
        ("laboratory", "lab bench, tv, oscilloscope, office chair, computer"),
        ("bedroom", "bed"),  # so large that it may speak alone
    ],
)
def test_the_kind_of_room_follows_from_what_stands_in_it(typer: RoomTyper, kind: str, inside: str) -> None:
    assert typer.type_of(things(inside)).label == kind


@pytest.mark.parametrize("inside", ["", "chair, trash can", "picture, picture, plant", "exercise ball, chair, picture"])
def test_too_little_evidence_is_just_a_room(typer: RoomTyper, inside: str) -> None:
    assert typer.type_of(things(inside)).label == "room"


def test_structure_and_people_have_no_say(typer: RoomTyper) -> None:
    assert typer.type_of(things("window, glass door, wall, person")).labels == ()
    with_them = typer.type_of(things("bed, wardrobe, window, door, wall"))
    assert with_them == typer.type_of(things("bed, wardrobe"))


def test_the_order_of_things_does_not_matter(typer: RoomTyper) -> None:
    names = things("bed, desk, monitor, sofa, tv, fridge")
    assert typer.type_of(names) == typer.type_of(names[::-1])


def test_an_uncertain_name_is_shared_among_its_readings(typer: RoomTyper) -> None:
    doubtful = Evidence((("toilet", 0.9), ("stool", 0.1)), 0.3)
    assert typer.type_of([doubtful, *things("sink, mirror")]).labels[0][0] in ("toilet", "bathroom")


def test_a_type_is_kept_while_another_is_not_clearly_better(encoder: LabelEncoder) -> None:
    mixed = things("bed, desk, office chair, monitor, monitor, wardrobe")
    stubborn = RoomTyper(RoomTypeSettings(keep_margin=0.5), encoder)
    fresh = stubborn.type_of(mixed).label
    other = "office" if fresh != "office" else "bedroom"
    assert stubborn.type_of(mixed, last=other).label == other
    assert stubborn.type_of(mixed, last="no longer a type").label == fresh
    assert stubborn.type_of([], last=other).label == "room"


def test_a_site_adds_a_kind_of_its_own(encoder: LabelEncoder) -> None:
    types = ("kitchen", "bedroom", "reactor room: control panel, turbine, cooling pump")
    typer = RoomTyper(RoomTypeSettings(types=types), encoder)
    assert typer.type_of(things("control panel, turbine, pump")).label == "reactor room"


def test_a_site_without_kinds_has_just_rooms(encoder: LabelEncoder) -> None:
    assert RoomTyper(RoomTypeSettings(types=()), encoder).type_of(things("bed")).label == "room"
