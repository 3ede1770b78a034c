"""Change in the memory: what the watch finds gone leaves it, takes its points of the map along, and is known again elsewhere."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from irsd.core.geometry import Pose
from irsd.core.jit import kernel
from irsd.core.types import InstanceState
from irsd.instances.change import ChangeSettings, ChangeWatch, Sight
from irsd.instances.departed import Departed, KnownPlaces, same_size
from irsd.instances.lift import LiftedMask
from irsd.instances.record import Instance, Names
from irsd.instances.roster import Roster
from irsd.instances.settle import release
from irsd.instances.voxel_memory import VoxelMemory
from irsd.instances.voxels import CLAIMS, Cells, Floats, Ints, Rows

_BESIDE_M = 0.05
_PUSH_NS = 10_000_000_000  # how long before a part was found free it may have been pushed aside
_PUSHED_SHARE = 0.3
_FRESH_SHARE = 0.7  # of the map at the place of a new thing must be newer than the last sight of the old one


class Surroundings(Protocol):
    """What change asks the map for; the pipeline's ``Mapper`` is one."""

    def loose_points(self, low: Floats, high: Floats) -> Floats:
        """Points [K, 3] of the map in a box that can be carried away."""

    def made_ns(self, points: Floats) -> Ints:
        """When the map first held points [n, 3]: int64 [n]; those that it does not hold are as old as time."""


class NoMap:
    """Surroundings of which nothing is known but that all in them is new."""

    def loose_points(self, low: Floats, high: Floats) -> Floats:
        return np.zeros((0, 3), np.float32)

    def made_ns(self, points: Floats) -> Ints:
        return np.full(len(points), np.iinfo(np.int64).max)


NO_MAP = NoMap()


class Departures:
    """Owner of what is known about change; writes into the memory's voxels and roster when something is gone or was moved."""

    def __init__(
        self,
        settings: ChangeSettings,
        names: Names,
        voxels: VoxelMemory,
        roster: Roster,
        surroundings: Surroundings,
        state_of: Callable[[Instance], InstanceState],
        drop: Callable[[Instance], None],
        rows_of: Callable[[Instance], Rows],
    ) -> None:
        """The memory's own: state_of, an instance as told of; drop, to take one out with all its claims; rows_of, all its rows."""
        self._names, self._voxels, self._roster = names, voxels, roster
        self._map, self._state_of, self._drop, self._rows_of = surroundings, state_of, drop, rows_of
        self._step_m = settings.step_m
        self._watch = ChangeWatch(settings)
        self._departed = Departed(settings)
        self._places = KnownPlaces(round(settings.look_period_s * 1e9))
        self._pushed: dict[int, tuple[Floats, int]] = {}  # points of what has lost a part, before it did, and when
        self._ended: list[int] = []
        self._merged: list[tuple[int, int]] = []
        self.touched: list[int] = []

    # ------------------------------------------------------------------------------------------------ being told
    def picture(
        self, map_T_camera: Pose, stamp_ns: int, masks: Sequence[LiftedMask], slots: Rows, missed: Rows, seen: Floats
    ) -> None:
        """A picture's masks and the slots they went to, slots that it shows without any, and the points float32 [V, 3] that it saw."""
        by_slot = self._roster.by_slot
        detected = []
        for slot, mask in zip(slots.tolist(), masks, strict=True):
            instance = by_slot[slot]
            if instance.published and self._names.group(mask.labels[0][0]) == instance.main_group():
                detected.append(instance.id)
        self._watch.picture(map_T_camera, stamp_ns, detected, [by_slot[slot].id for slot in missed.tolist()])
        self._places.look(seen, stamp_ns)

    def here(self, instance: Instance, state: InstanceState) -> InstanceState:
        """An instance was just seen; returns its state, which is that of a departed one where it proved to be that."""
        old = self._departed.recognise(state)
        if old is not None and self._is_new_there(state, old):
            self._reunite(instance, old)
            state = self._state_of(instance)
        pushed = self._pushed.get(instance.id)
        if pushed is not None and self._was_pushed(*pushed, state.points_map):
            del self._pushed[instance.id]
            instance.moved = True
            state = self._state_of(instance)
        self._watch.place(instance.id, state.points_map, state.existence)
        return state

    def expect(self, instance: Instance) -> None:
        """An instance of a stored map: what is seen at its place speaks for or against it from now on."""
        if len(instance.owned):
            self._watch.expect(instance.id, self._voxels.cells.point[instance.owned])

    def forget(self, instance_id: int) -> None:
        """An instance ended, or is not told of any more."""
        self._watch.forget(instance_id)
        self._pushed.pop(instance_id, None)

    # ------------------------------------------------------------------------------------------------ finding out
    def look(self, origin_map: NDArray[np.float64], points_map: Floats, stamp_ns: int) -> Floats:
        """See ``InstanceMemory.watch``."""
        verdict = self._watch.look(origin_map, points_map, stamp_ns)
        free = [np.zeros((0, 3), np.float32)]
        if verdict.sight is not None:
            by_id = self._roster.by_id
            free += [self._depart(by_id[i], verdict.sight, stamp_ns) for i in verdict.gone if i in by_id]
            free += [self._shrink(by_id[i], verdict.sight, stamp_ns) for i in verdict.partly if i in by_id]
        return np.concatenate(free)

    def tell(self, stamp_ns: int) -> tuple[list[InstanceState], list[int], list[tuple[int, int]]]:
        """(states of what has just gone, ids that ended, (kept, absorbed) of what was found again) since the last call."""
        told, over = self._departed.tell(stamp_ns)
        ended, self._ended = self._ended, []
        merged, self._merged = self._merged, []
        return told, over + ended, merged

    def _depart(self, instance: Instance, sight: Sight, stamp_ns: int) -> Floats:
        """An instance is gone; returns the points of the map that went with it."""
        state = self._state_of(instance)
        rows = self._rows_of(instance)
        points = self._voxels.cells.point[main_claims(self._voxels.cells, rows, instance.slot)]
        self._drop(instance)
        self._departed.leave(state, stamp_ns)
        since = [i for i in self._roster.by_id.values() if i.published and i.first_seen_ns > state.last_seen_ns]
        present = [self._state_of(i) for i in since if i.somewhere]
        found = self._departed.recognised_by(state, [new for new in present if self._is_new_there(new, state)])
        if found is not None:
            self._reunite(self._roster.by_id[found.id], state)
        return np.concatenate([points, emptied(sight, self._map, points)])

    def _shrink(self, instance: Instance, sight: Sight, stamp_ns: int) -> Floats:
        """A part of an instance is gone, or it was pushed aside; returns the points of the map that are free now."""
        self._rows_of(instance)
        points = self._voxels.cells.point[instance.owned]
        self._pushed.setdefault(instance.id, (self._watch.home(instance.id), stamp_ns))
        release(self._voxels.cells, instance.owned[sight.of(points) > 0], instance.slot)
        self.touched.append(instance.id)
        return emptied(sight, self._map, points)

    def _is_new_there(self, new: InstanceState, old: InstanceState) -> bool:
        """Whether there was nothing at the place of a new thing while the old one stood at its own."""
        fresh = self._map.made_ns(new.points_map) > old.last_seen_ns
        return bool(fresh.mean() >= _FRESH_SHARE) and self._places.known(new.points_map, new.first_seen_ns)

    def _was_pushed(self, before: Floats, at_ns: int, after: Floats) -> bool:
        """Whether points [n, 3] are those of the same body a step away: as large as before, a part of them new in the map."""
        aside = float(np.linalg.norm(after.mean(0) - before.mean(0))) > self._step_m
        fresh = self._map.made_ns(after) > at_ns - _PUSH_NS
        return aside and bool(fresh.mean() >= _PUSHED_SHARE) and same_size(before, after)

    def _reunite(self, instance: Instance, old: InstanceState) -> None:
        """A new instance proved to be a departed one: it goes on under that one's id."""
        self._departed.back(old.id)
        if instance.published:
            self._ended.append(instance.id)
            self._merged.append((old.id, instance.id))
        self._watch.rename(instance.id, old.id)
        self._roster.rename(instance, old.id)
        things, slot = self._roster.things, instance.slot
        points = self._voxels.cells.point[instance.owned]
        away_m = float(np.linalg.norm(points.mean(0) - old.points_map.mean(0)))
        instance.first_seen_ns, instance.moved = old.first_seen_ns, old.state == "moved" or away_m > self._step_m
        things.observations[slot] += old.observations
        things.expected[slot] += old.observations / max(old.existence, 1e-3)
        self.touched.append(old.id)


def emptied(sight: Sight, surroundings: Surroundings, points: Floats) -> Floats:
    """The points of the map about points [n, 3] that a scan passed through."""
    if not len(points):
        return points
    found = surroundings.loose_points(points.min(0) - np.float32(_BESIDE_M), points.max(0) + np.float32(_BESIDE_M))
    return found[sight.of(found) > 0]


@kernel
def main_claims(cells: Cells, rows: Rows, slot: int) -> Rows:
    """Those of rows [n] on which no other claim has a larger share than that of the slot."""
    out, n = np.empty(len(rows), np.int32), 0
    for row in rows:
        mine = best = 0.0
        for c in range(CLAIMS):
            share = cells.hits[row, c] / max(float(cells.seen[row, c]), 1.0)
            if cells.owner[row, c] == slot:
                mine = share
            elif cells.owner[row, c] >= 0:
                best = max(best, share)
        if mine > 0.0 and mine >= best:
            out[n] = row
            n += 1
    return out[:n]
