"""What irsd's own eyes add to fusion's instances: things that only the LiDAR saw, and names by shape and picture together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from irsd.core.types import InstanceState, InstanceUpdate, Prototype, Rooms
from irsd.instances.memory import InstanceMemory
from irsd.instances.proposals import NS_PER_S, Proposals, ProposalSettings
from irsd.mapping.mapper import Mapper
from irsd.perception.naming import Namer


class AllRound:
    """Owner of the map's parts and of the names. Called by the map thread after every scan and for every step of the graph."""

    def __init__(self, settings: ProposalSettings, namer: Namer, mapper: Mapper, memory: InstanceMemory) -> None:
        self._settings, self._namer, self._mapper, self._memory = settings, namer, mapper, memory
        self._proposals = Proposals(settings, memory.take_id)
        self._due_ns = 0
        self._resting = False

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
            over = () if self._resting else self._proposals.withdraw()
            self._resting = True
            return replace(update, ended=tuple(sorted({*update.ended, *over})))
        self._resting = False
        update = self._proposals.join(update, rooms, self._mapper.rows_at, self._memory.claimed, stamp_ns)
        floors = {} if rooms is None else {i: f.floor_z_m for i, f in zip(rooms.ids, rooms.footprints, strict=True)}
        here_m = self._mapper.levels.floor_z_m
        self._namer.learn(taught)
        named = self._namer.name(update.changed, update.ended, lambda room: floors.get(room, here_m))
        return replace(update, changed=named)

    def restore(self, states: Sequence[InstanceState]) -> None:
        """Stored things that only the LiDAR had seen."""
        self._proposals.restore(states)
