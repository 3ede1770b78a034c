"""What is a fragment of what, by names."""

from __future__ import annotations

from irsd.allround import Called, called, fragments_of
from irsd.perception.naming import UNKNOWN


def test_nothing_in_a_part_is_a_fragment_where_the_whole_has_no_name() -> None:
    assert fragments_of((UNKNOWN, 0.9), {1: (UNKNOWN, 0.5), 2: ("chair", 0.9)}) == ([], 0)
    assert fragments_of(("bed", 0.9), {}) == ([], 0)


def test_what_has_no_name_is_a_fragment_and_what_has_another_is_a_thing_of_its_own() -> None:
    assert fragments_of(("tv stand", 0.8), {1: (UNKNOWN, 0.5), 2: ("television", 0.5)}) == ([1], 0)


def test_the_only_one_of_the_wholes_name_gets_it_and_two_stand_side_by_side() -> None:
    assert fragments_of(("chair", 0.8), {1: (UNKNOWN, 0.5), 2: ("chair", 0.5)}) == ([1], 2)
    assert fragments_of(("chair", 0.8), {1: (UNKNOWN, 0.5), 2: ("chair", 0.5), 3: ("chair", 0.6)}) == ([], 0)


def test_no_sofa_lies_in_a_bed_unless_the_bed_is_less_likely() -> None:
    assert fragments_of(("bed", 0.8), {1: ("sofa", 0.6), 2: ("pillow", 0.6)}) == ([1], 0)
    assert fragments_of(("bed", 0.5), {1: ("sofa", 0.6)}) == ([], 0)


def test_what_had_a_name_for_some_steps_keeps_it_and_what_flickers_does_not() -> None:
    doubtful, sure = (UNKNOWN, 0.6), ("television", 0.7)
    one = called(None, doubtful)
    assert one == Called(doubtful, 0)
    one = called(called(one, sure), doubtful)
    assert one == Called(doubtful, 1)
    for _ in range(2):
        one = called(one, sure)
    assert called(one, doubtful) == Called(sure, 3)
    assert called(called(one, doubtful), ("monitor", 0.5)) == Called(("monitor", 0.5), 4)
