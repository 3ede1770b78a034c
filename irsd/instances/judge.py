"""Whether two instances are one thing, on the evidence of all pictures so far."""

from __future__ import annotations

from typing import NamedTuple

from irsd.instances.associate import Things, alike
from irsd.instances.record import Instance
from irsd.instances.settings import FusionSettings

_NAMES = 0.98  # meanings as true as this are those of names, not of what a thing looks like


class Contact(NamedTuple):
    """Voxels: with good evidence for the one, for the other, for both; and those that both claim on any evidence."""

    one: int
    other: int
    both: int
    touch: int


class Judge(NamedTuple):
    """truth: see ``Rules``; blind: pictures do not tell what they saw beside their masks."""

    settings: FusionSettings
    things: Things
    truth: float
    blind: bool

    def are_one(self, a: Instance, b: Instance, contact: Contact) -> bool:
        return self.seen_as_one(a, b) or self.overlap(a, b, contact) or self.are_sides(a, b, contact.touch)

    def seen_as_one(self, a: Instance, b: Instance) -> bool:
        """Masks covered both often enough, compared with how often each had its own mask in one picture."""
        together, apart = a.beside.get(b.id, (0, 0))
        needed = max(self.settings.min_observations, self.settings.merge_ratio * (together + apart))
        often = (
            min(self.things.observations[a.slot], self.things.observations[b.slot]) >= self.settings.min_observations
        )
        return bool(often and not self.settings.plain and together >= needed)

    def overlap(self, a: Instance, b: Instance, contact: Contact) -> bool:
        """The paper's two criteria inside a room on the evidence of all pictures, or the same voxels under two names."""
        s, (one, other, both, _) = self.settings, contact
        overlap, cosine = (s.tau_g, s.tau_s) if s.plain else (s.merge_overlap, s.tau_merge)
        if min(one, other) < s.min_voxels:
            return False
        seldom = min(self.things.observations[a.slot], self.things.observations[b.slot]) < s.min_observations
        if seldom and not s.plain:
            return False  # what one odd mask brought about is no evidence yet
        if both >= s.tau_same * (one + other - both) and not s.plain:
            return True
        if self._parted(a, b) or both < overlap * min(one, other):
            return False
        return bool(alike(self.things, a.slot, b.slot, self.truth) >= cosine)

    def are_sides(self, a: Instance, b: Instance, touch: int) -> bool:
        """Sides of one thing, seen from different places: they touch and mean the same. Names are the same for two of a kind:
        meanings that come from them tell that only of what was not mostly seen each in its own mask.

        Only where misses can't be seen: else the masks that cover both tell it better.
        """
        s = self.settings
        if s.plain or not self.blind or touch < s.touch_voxels or self._parted(a, b):
            return False
        if a.beside.get(b.id, (0, 0))[1] or (self.truth > _NAMES and a.mostly_beside(b)):
            return False
        return bool(alike(self.things, a.slot, b.slot, self.truth) >= s.tau_merge)

    def _parted(self, a: Instance, b: Instance) -> bool:
        """Whether they are in two rooms."""
        one, other = int(self.things.room[a.slot]), int(self.things.room[b.slot])
        return self.settings.room_prior and 0 not in (one, other) and one != other
