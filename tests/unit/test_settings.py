"""Settings: nothing is corrected silently, every problem is named with key, value and range."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from irsd.core.grid import GridFrame
from irsd.core.settings import build, setting


@dataclass(frozen=True)
class Inner:
    tau_g: float = setting(0.3, "overlap", lo=0.0, hi=1.0)
    name: str = setting("a", "choice", choices=("a", "b"))


@dataclass(frozen=True)
class Outer:
    inner: Inner = field(default_factory=Inner)
    count: int = setting(2, "how many", lo=1)
    words: tuple[str, ...] = setting((), "names")
    limit: float | None = setting(None, "none for no limit", lo=0)


def test_nothing_given_is_the_defaults() -> None:
    assert build(Outer, {}) == (Outer(), [])


def test_values_are_taken_and_integers_pass_as_floats() -> None:
    made, problems = build(Outer, {"inner": {"tau_g": 1, "name": "b"}, "count": 3, "words": ["x"], "limit": 2})
    assert not problems
    assert made == Outer(Inner(1.0, "b"), 3, ("x",), 2.0)


def test_every_problem_is_named() -> None:
    made, problems = build(
        Outer, {"inner": {"tau_g": 1.5, "name": "c", "tau": 1}, "count": True, "words": "x", "limit": float("nan")}
    )
    assert made is None
    text = "\n".join(problems)
    assert "inner.tau_g = 1.5: must be in 0.0 .. 1.0" in text
    assert "inner.name = 'c': must be one of a, b" in text
    assert "inner.tau = 1: unknown key; known here: name, tau_g" in text
    assert "count = True: must be a whole number" in text
    assert "words = 'x': must be a list" in text
    assert "limit = nan" in text
    assert len(problems) == 6


def test_a_section_that_is_no_section() -> None:
    _, problems = build(Outer, {"inner": 3})
    assert problems == ["inner = 3: must be a section of keys and values"]


def test_grid_cells_and_centres_invert_each_other() -> None:
    frame = GridFrame((-1.0, 2.0), 0.05, 40, 60)
    cells = np.array([[0, 0], [39, 59], [7, 11]])
    assert (frame.cells_of(frame.centres_of(cells)) == cells).all()
    assert frame.inside(np.array([[0, 0], [40, 0], [-1, 3]])).tolist() == [True, False, False]
    assert frame.cells_of(np.zeros((0, 2))).shape == (0, 2)
