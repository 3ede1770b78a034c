"""The journal of edits and what was taught: owned by the graph's builder, kept by the store."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from irsd.core.errors import EditError
from irsd.core.types import Prototype
from irsd.graph.edits import MAX_EDITS, known_prototypes, standing
from irsd.graph.model import Edit


class EditBook:
    """Owner of the journal. What changed since the last ``take_changes`` is what the store has yet to write."""

    def __init__(self) -> None:
        self._edits: dict[int, Edit] = {}
        self._taught: dict[int, Prototype] = {}
        self._changed: dict[int, Edit] = {}
        self._learnt: dict[int, Prototype] = {}

    def restore(self, edits: Sequence[Edit], taught: Mapping[int, Prototype]) -> None:
        """The journal as stored; taught: examples by the number of their edit, those of earlier maps too."""
        self._edits, self._taught = {edit.number: edit for edit in edits}, dict(taught)

    @property
    def edits(self) -> tuple[Edit, ...]:
        """All of them, undone ones too, by number."""
        return tuple(self._edits[n] for n in sorted(self._edits))

    @property
    def next_number(self) -> int:
        return max((*self._edits, *self._taught), default=0) + 1

    @property
    def taught(self) -> dict[int, Prototype]:
        """All examples, by number of their edit, those that do not count too."""
        return dict(self._taught)

    def prototypes(self) -> tuple[Prototype, ...]:
        """What was taught and is not forgotten, oldest first."""
        return tuple(known_prototypes(self.edits, self._taught).values())

    def add(self, edit: Edit, example: Prototype | None) -> None:
        """One more edit; example: what a teach shows. EditError when the journal is full."""
        if len(self._edits) >= MAX_EDITS:
            raise EditError(f"the journal is full ({MAX_EDITS} edits): snapshot the map and start a new one")
        self.put([edit])
        if example is not None:
            self._taught[edit.number] = self._learnt[edit.number] = example

    def put(self, edits: Iterable[Edit]) -> None:
        """Edits as they are now."""
        for edit in edits:
            self._edits[edit.number] = self._changed[edit.number] = edit

    def last_standing(self) -> Edit:
        """The edit that undo takes back. EditError when there is none."""
        found = standing(self._edits.values())
        if not found:
            raise EditError("nothing to undo: no edit stands")
        return found[-1]

    def take_changes(self) -> tuple[tuple[Edit, ...], dict[int, Prototype]]:
        """(edits, examples by number of their edit) that are new or changed since the last call."""
        changed, learnt = self._changed, self._learnt
        self._changed, self._learnt = {}, {}
        return tuple(changed[n] for n in sorted(changed)), learnt
