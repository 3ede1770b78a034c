"""What irsd's own eyes add to fusion's instances: things that only the LiDAR saw, and names by shape and picture together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from irsd.core.types import InstanceState, InstanceUpdate, Prototype, Rooms
from irsd.instances.memory import InstanceMemory
from irsd.instances.part import ProposalSettings
from irsd.instances.proposals import NS_PER_S, Proposals
from irsd.instances.voxels import Floats, Rows
from irsd.mapping.mapper import Mapper
from irsd.perception.naming import UNKNOWN, Namer

_FURNITURE = (
    "sofa, bed, wardrobe, bookcase, cabinet, kitchen cabinet, chest of drawers, refrigerator, dining table, desk, workbench, bathtub, "
    "piano, fume hood"
)
_LARGE = frozenset(_FURNITURE.split(", "))
# Steps with a name after which a thing is one, even if the next look makes it doubtful: robots are sent to it.
_STEADY = 3


class AllRound:
    """Owner of the map's parts and of the names. Called by the map thread after every scan and for every step of the graph."""

    def __init__(self, settings: ProposalSettings, namer: Namer, mapper: Mapper, memory: InstanceMemory) -> None:
        self._settings, self._namer, self._mapper, self._memory = settings, namer, mapper, memory
        self._proposals = Proposals(settings, memory.take_id)
        self._due_ns = 0
        self._resting = False
        self._called: dict[int, Called] = {}  # all that is told, and fragments as they were called when they ended

    def follow(self, stamp_ns: int) -> None:
        """One scan is in the map."""
        if self._settings.enabled and stamp_ns >= self._due_ns:
            self._due_ns = stamp_ns + round(self._settings.period_s * NS_PER_S)
            self._proposals.take(self._mapper.changed_parts(), stamp_ns)

    def join(
        self, update: InstanceUpdate, rooms: Rooms | None, stamp_ns: int, *, alone: bool, taught: tuple[Prototype, ...]
    ) -> InstanceUpdate:
        """Fusion's update with names, and with the things that only the LiDAR saw. alone: nobody else sees, else all this rests."""
        if not alone:
            over, back = ((), ()) if self._resting else self._proposals.withdraw()
            self._resting = True
            changed = {state.id: state for state in (*back, *update.changed) if state.id not in update.ended}
            ended = tuple(sorted({*update.ended, *over}))
            return replace(update, changed=tuple(changed[i] for i in sorted(changed)), ended=ended)
        self._resting = False
        update = self._proposals.join(update, rooms, self._mapper.rows_at, self._memory.claimed, stamp_ns)
        floors = {} if rooms is None else {i: f.floor_z_m for i, f in zip(rooms.ids, rooms.footprints, strict=True)}
        here_m = self._mapper.levels.floor_z_m
        self._namer.learn(taught)
        named = self._namer.name(update.changed, update.ended, lambda room: floors.get(room, here_m))
        self._join_fragments(named, update.ended, here_m)
        return replace(update, changed=named)

    def _join_fragments(self, named: Sequence[InstanceState], ended: Sequence[int], floor_z_m: float) -> None:
        """Parts of the map get what is a fragment of them, or fall to whom they are the rest of (``fragments_of``)."""
        for state in named:
            self._called[state.id] = called(self._called.get(state.id), state.labels[0])
        for instance_id in ended:
            if instance_id not in self._proposals.absorbed:
                self._called.pop(instance_id, None)
        for part in self._proposals.contested():
            whole = self._namer.name_of(part.number, part.points_map, floor_z_m)
            names = {i: self._called[i].label for i in part.fragments if i in self._called}
            self._proposals.absorb(part.number, *fragments_of(whole, names))

    def alone(self, points_map: Floats) -> Rows:
        """Number int32 [K] of the part of the map of a thing's size at each point [K, 3], 0 where there is none."""
        return self._proposals.alone(self._mapper.rows_at(points_map))

    def restore(self, states: Sequence[InstanceState]) -> None:
        """Stored things that only the LiDAR had seen."""
        self._proposals.restore(states)


@dataclass(frozen=True, slots=True)
class Called:
    """What a thing is called: (name, chance), and in how many steps it was told with a name."""

    label: tuple[str, float]
    times: int


def called(before: Called | None, label: tuple[str, float]) -> Called:
    """What a thing is called that is told with such a first name now: what had a name for some steps keeps the last one."""
    times = before.times if before else 0
    if label[0] != UNKNOWN:
        return Called(label, times + 1)
    return before if before and times >= _STEADY else Called(label, times)


def fragments_of(whole: tuple[str, float], names: Mapping[int, tuple[str, float]]) -> tuple[list[int], int]:
    """(ids that are fragments of a part of the map, id that gets the part or 0): by the first name of the part as a whole and of those
    that lie in it, each with its chance.

    Where the whole has a name, what has none is a fragment of it. So is large furniture of another name that is less likely than the
    whole's: a television stands on its stand, but no sofa lies in a bed. The only one of the whole's own name is the whole; where
    there are more, they stand side by side, and nothing follows.
    """
    name, chance = whole
    alike = [i for i, (own, _) in names.items() if own == name]
    if name == UNKNOWN or len(alike) > 1:
        return [], 0
    found = [
        i
        for i, (own, likely) in names.items()
        if own == UNKNOWN or (own != name and own in _LARGE and name in _LARGE and likely <= chance)
    ]
    return found, alike[0] if alike else 0
