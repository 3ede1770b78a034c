"""What becomes of a goal in words: Resolved, Ambiguous with the candidates, or NotFound with the reason."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Candidate:
    """A node that was considered. instance: its id, that of a room where the goal is a room; score: chance, 0..1, that it is
    the one meant. evidence: what its labels, attributes, room and relations make together, 0..1. rejected: why it is out, "" when it
    is not. answer: what to say to mean this one of several, "" where that is not asked. by_chance: its labels are
    chances of irsd's own eyes, not votes of a detector."""

    instance: str
    label: str
    room: str | None
    score: float
    notes: tuple[str, ...] = ()
    rejected: str = ""
    answer: str = ""
    evidence: float = 0.0
    by_chance: bool = False

    @property
    def is_room(self) -> bool:
        return self.instance.startswith("R")


@dataclass(frozen=True, slots=True)
class Resolved:
    """The goal means target. alternates: others that fulfil an open choice, next best first."""

    target: Candidate
    alternates: tuple[Candidate, ...]
    considered: tuple[Candidate, ...]


@dataclass(frozen=True, slots=True)
class Ambiguous:
    """Several fit (or one, not surely). question: what would tell them apart."""

    candidates: tuple[Candidate, ...]
    question: str
    considered: tuple[Candidate, ...]


@dataclass(frozen=True, slots=True)
class NotFound:
    """Nothing known fits."""

    reason: str
    considered: tuple[Candidate, ...]


Resolution = Resolved | Ambiguous | NotFound
