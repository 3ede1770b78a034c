"""Chances of candidates: the curve rises, several share one chance, and the fit finds a curve that made the data."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nav_bridge.calibration import CURVE, CURVE_OF_CHANCES, chance, isotonic, with_chances
from nav_bridge.resolution import Ambiguous, Candidate, NotFound, Resolved


def candidate(number: int, evidence: float, rejected: str = "") -> Candidate:
    return Candidate(f"I{number}", "chair", "R1", 0.0, rejected=rejected, evidence=evidence)


@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.booleans())
def test_more_evidence_is_no_less_a_chance(a: float, b: float, own: bool) -> None:
    low, high = sorted((a, b))
    assert 0.0 <= chance(low, own) <= chance(high, own) < 1.0
    assert all(x < y for (x, _), (y, _) in itertools.pairwise(CURVE_OF_CHANCES if own else CURVE))


def test_a_chance_is_no_vote() -> None:
    """Half of many votes for one name is nearly sure; an eye that gives it an even chance is right every other time."""
    voted, seen = candidate(1, 0.5), replace(candidate(2, 0.5), by_chance=True)
    by_votes, by_chances = (with_chances(Resolved(c, (), (c,))) for c in (voted, seen))
    assert isinstance(by_votes, Resolved)
    assert isinstance(by_chances, Resolved)
    assert by_votes.target.score > 0.85
    assert 0.3 < by_chances.target.score < 0.6


def test_what_is_out_has_no_chance() -> None:
    target, out = candidate(1, 0.9), candidate(2, 0.8, "not in a kitchen")
    resolved = with_chances(Resolved(target, (), (target, out)))
    assert isinstance(resolved, Resolved)
    assert resolved.target.score == pytest.approx(chance(0.9), abs=1e-3)
    assert [c.score for c in resolved.considered] == [resolved.target.score, 0.0]
    nothing = NotFound("nothing", (out,))
    assert with_chances(nothing) == nothing


@given(st.lists(st.floats(0.05, 1.0), min_size=1, max_size=8), st.booleans())
def test_several_share_one_chance(evidence: list[float], doubt: bool) -> None:
    several = tuple(candidate(k, e) for k, e in enumerate(evidence, 1))
    asked = with_chances(Ambiguous(several, "which?", several), doubt=doubt)
    assert isinstance(asked, Ambiguous)
    whole = chance(max(evidence)) * (0.5 if doubt else 1.0)
    assert sum(c.score for c in asked.candidates) == pytest.approx(whole, abs=1e-3 * len(evidence))
    best = max(asked.candidates, key=lambda c: c.evidence)
    assert best.score == max(c.score for c in asked.candidates)


def test_the_fit_finds_the_curve_that_made_the_data() -> None:
    rng = np.random.default_rng(3)
    evidence = rng.uniform(0.0, 1.0, 6000)
    right = (rng.random(6000) < evidence**2).astype(np.float64)
    steps = isotonic(evidence, right)
    assert all(a[0] < b[0] and a[1] <= b[1] + 0.02 for a, b in itertools.pairwise(steps))
    assert sum(count for _, _, count in steps) == 6000
    assert max(abs(share - at**2) for at, share, count in steps if count >= 150) < 0.1
