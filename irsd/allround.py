"""What irsd's own eyes add to fusion's instances: things that only the LiDAR saw, and names by shape and picture together."""

from __future__ import annotations

from irsd.core.types import InstanceState, InstanceUpdate, Rooms
from irsd.instances.memory import InstanceMemory
from irsd.instances.proposals import NS_PER_S, Proposals, ProposalSettings
from irsd.mapping.mapper import Mapper


class AllRound:
    """Owner of the map's parts and of the names. Called by the map thread after every scan and for every step of the graph."""

    def __init__(self, settings: ProposalSettings, mapper: Mapper, memory: InstanceMemory) -> None:
        self._settings, self._mapper, self._memory = settings, mapper, memory
        self._proposals = Proposals(settings, memory.take_id)
        self._due_ns = 0
        self._hidden = False

    def follow(self, stamp_ns: int) -> None:
        """One scan is in the map."""
        if stamp_ns >= self._due_ns:
            self._due_ns = stamp_ns + round(self._settings.period_s * NS_PER_S)
            self._proposals.take(self._mapper.changed_parts(), stamp_ns)

    def join(self, update: InstanceUpdate, rooms: Rooms | None, stamp_ns: int) -> InstanceUpdate:
        """Fusion's update with the things that only the LiDAR saw."""
        return self._proposals.join(update, rooms, self._mapper.rows_at, self._memory.claimed, stamp_ns)

    def restore(self, states: list[InstanceState]) -> None:
        """Stored things that only the LiDAR had seen."""
        self._proposals.restore(states)
