"""What masks are like as a rule, learned from those of instances that were seen often: how true their meanings are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from irsd.instances.associate import Rules, Things
from irsd.instances.voxels import Ints

_FEW = 3  # comparisons from which an instance teaches anything
_ENOUGH = 30.0  # comparisons before the rule is believed
_MEMORY = 2000.0  # after so many comparisons older ones begin to be forgotten
_LEAST_SPREAD = 0.02


@dataclass(slots=True)
class Habits:
    """Weighted sums over instances, each counted when it was seen again."""

    weight: float = 0.0
    cosine: float = 0.0
    square: float = 0.0

    def learn(self, things: Things, slots: Ints) -> None:
        """slots: int64 [k] instances that were seen since the last call."""
        n = things.matches[slots].astype(np.float64)
        slots, n = slots[n >= _FEW], n[n >= _FEW]
        if not len(n):
            return
        keep = min(1.0, _MEMORY / max(self.weight, 1.0))
        self.weight = keep * self.weight + float(n.sum())
        self.cosine = keep * self.cosine + float(things.likeness[slots].sum())
        self.square = keep * self.square + float(things.likeness2[slots].sum())

    def taught(self, rules: Rules) -> Rules:
        """The rules with what was learned.

        A mask's cosine to the mean of those before it is about the root of its truth, the squared cosine to what it shows.
        """
        if self.weight < _ENOUGH:
            return rules
        mean, square = self.cosine / self.weight, self.square / self.weight
        spread = float(np.sqrt(max(square - mean * mean, 0.0)))
        return rules._replace(usual_s=mean - 3.0 * max(spread, _LEAST_SPREAD), truth=max(min(square, 1.0), 0.25))
