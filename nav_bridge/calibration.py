"""From evidence to chance: how often a candidate of this much evidence, left alone or chosen, is the one that was meant.

The evidence of a candidate is a product of grades and no probability; a curve makes it one. There are two, because a detector's
labels are shares of many votes, of which the most is nearly always right, and those of irsd's own eyes are chances already. Both
are fitted (isotonic regression, pool adjacent violators) on the sentences of ``benchmarks/goto.py --calibrate``;
docs/calibration.md has the tables.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nav_bridge.resolution import Ambiguous, Candidate, NotFound, Resolution, Resolved

# (evidence, chance), both rising; between the knots straight.
CURVE: tuple[tuple[float, float], ...] = (
    (0.0, 0.0), (0.451, 0.879), (0.651, 0.976), (0.768, 0.978), (0.808, 0.986), (0.854, 0.991), (0.901, 0.995), (1.0, 0.995),
)  # fmt: skip
CURVE_OF_CHANCES: tuple[tuple[float, float], ...] = (
    (0.0, 0.0), (0.369, 0.352), (0.536, 0.489), (0.664, 0.636), (0.75, 0.818), (0.804, 0.824), (0.907, 0.971), (1.0, 0.975),
)  # fmt: skip
_UNSURE = 0.5  # what a chance is worth where the sentence speaks of something that is not known here


def chance(evidence: float, by_chance: bool = False) -> float:
    """0..1: how often candidates of this evidence are meant; by_chance: whose labels are chances, not votes."""
    knots = np.array(CURVE_OF_CHANCES if by_chance else CURVE)
    return float(np.interp(evidence, knots[:, 0], knots[:, 1]))


def chance_of(candidate: Candidate) -> float:
    """0..1: how often candidates like this one, left alone or chosen, are meant."""
    return chance(candidate.evidence, candidate.by_chance)


def with_chances(resolution: Resolution, *, doubt: bool = False) -> Resolution:
    """The resolution with the score of each candidate set: the chance that it is the one meant; 0 for those that are out.

    Of several that fit, the best one's chance is shared by their evidence. doubt: the sentence names something that is not known.
    """
    if isinstance(resolution, NotFound):
        return resolution
    if isinstance(resolution, Resolved):
        target = _scored(resolution.target, 1.0)
        alternates = tuple(_scored(c, 1.0) for c in resolution.alternates)
        return replace(
            resolution,
            target=target,
            alternates=alternates,
            considered=_same(resolution.considered, (target, *alternates)),
        )
    weight = _UNSURE if doubt else 1.0
    most = max((chance_of(c) for c in resolution.candidates), default=0.0)
    total = max(sum(c.evidence for c in resolution.candidates), 1e-9)
    shared = tuple(replace(c, score=round(weight * most * c.evidence / total, 3)) for c in resolution.candidates)
    return Ambiguous(shared, resolution.question, _same(resolution.considered, shared))


def _scored(candidate: Candidate, weight: float) -> Candidate:
    return replace(candidate, score=round(weight * chance_of(candidate), 3))


def _same(considered: Sequence[Candidate], scored: Sequence[Candidate]) -> tuple[Candidate, ...]:
    scores = {c.instance: c.score for c in scored}
    return tuple(replace(c, score=scores.get(c.instance, 0.0)) for c in considered)


def isotonic(
    evidence: NDArray[np.float64], right: NDArray[np.float64], least: int = 25
) -> tuple[tuple[float, float, int], ...]:
    """Rising steps (mean evidence, share right, how many) through points [N], by pooling adjacent violators.

    least: steps of fewer points are joined with the next. The share is Laplace's, so that no step claims to be certain.
    """
    steps: list[list[float]] = []  # [sum of evidence, sum right, count]

    def join() -> None:
        last = steps.pop()
        steps[-1] = [a + b for a, b in zip(steps[-1], last, strict=True)]

    for k in np.argsort(evidence, kind="stable"):
        steps.append([float(evidence[k]), float(right[k]), 1.0])
        while len(steps) > 1 and steps[-2][1] / steps[-2][2] >= steps[-1][1] / steps[-1][2]:
            join()
    rising, steps = steps, []
    for step in rising:
        steps.append(step)
        if len(steps) > 1 and steps[-2][2] < least:
            join()
    if len(steps) > 1 and steps[-1][2] < least:
        join()
    return tuple((s[0] / s[2], (s[1] + 1.0) / (s[2] + 2.0), int(s[2])) for s in steps)
