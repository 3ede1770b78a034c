"""The memory of instances: the only writer of what fusion knows. A view is observed, changes are collected.

Evidence decides, not single pictures: a voxel counts for an instance only where it lay in its mask in a fair share of the
pictures that showed both; each voxel has one owner; two instances become one only on relative evidence; what was seen too
seldom for how often it could have been seen is never published. Work per picture is bounded by what the picture shows.
"""

from __future__ import annotations

from array import array
from collections import deque
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from irsd.core.types import CameraView, InstanceState, InstanceUpdate, KnownThings, Rooms
from irsd.instances.associate import add_meanings, match
from irsd.instances.attic import Attic
from irsd.instances.departures import NO_MAP, Departures, Surroundings
from irsd.instances.habits import Habits
from irsd.instances.judge import Contact, Judge
from irsd.instances.known import known_things
from irsd.instances.lift import LiftedView
from irsd.instances.record import NO_ROWS, Embed, Instance, Names
from irsd.instances.rim import rim_weights
from irsd.instances.room_changes import may_have_moved
from irsd.instances.room_prior import room_of, rooms_of_all
from irsd.instances.roster import Roster
from irsd.instances.settings import FusionSettings
from irsd.instances.settle import Settled, absorb, main_points, release, settle
from irsd.instances.stored import restored
from irsd.instances.voxel_memory import VoxelMemory
from irsd.instances.voxels import FULL, Floats, Ints, Rows, Weights, add_evidence

__all__ = ["FusionSettings", "InstanceMemory"]

_RECENT = 5  # pictures within which a mask shows that a thing is there
_CHECKED = 32  # unconfirmed instances looked at per collect
_RESTORED = 256  # stored instances whose voxels are in memory at a time


class InstanceMemory:
    """Owner of the instances. ``observe`` every view in time order, ``collect`` what changed whenever it is wanted."""

    def __init__(self, settings: FusionSettings, embed: Embed, surroundings: Surroundings = NO_MAP) -> None:
        """surroundings: the map of which the masks are."""
        self.settings = settings
        self._blind = True  # until a picture tells what it saw beside its masks
        self._rules, self._limits = settings.rules(self._blind), settings.limits(self._blind)
        self._habits = Habits()
        self._names = Names(embed)
        self._voxels = VoxelMemory(settings.voxel_m)
        self._roster = Roster()
        self._attic = Attic(self._voxels, self._roster, settings.rest_views)
        self._touched: dict[int, None] = {}
        self._waiting: deque[int] = deque()
        self._views = 0
        self._rooms: Rooms | None = None
        self._change = Departures(
            settings.change, self._names, self._voxels, self._roster, surroundings, self._state, self._drop, self._rows
        )
        self._ended: list[int] = []
        self._merged: list[tuple[int, int]] = []

    def __len__(self) -> int:
        return len(self._roster)

    @property
    def next_id(self) -> int:
        """The number that the next instance gets."""
        return self._roster.next_id

    def reserve(self, next_id: int) -> None:
        """Numbers below this one are not given out."""
        self._roster.next_id = max(self._roster.next_id, next_id)

    def take_id(self) -> int:
        """A number that no instance has or will get."""
        self._roster.next_id += 1
        return self._roster.next_id - 1

    # ------------------------------------------------------------------------------------------------ observing
    def observe(self, view: CameraView, lifted: LiftedView, rooms: Rooms | None) -> None:
        """Fuse one picture's masks. rooms: the rooms as known now; None or room 0 = unknown, which restricts nothing."""
        self._views += 1
        self.follow_rooms(rooms)
        if self._blind and len(lifted.seen_map):
            self._blind = False
            self._rules, self._limits = self.settings.rules(False), self.settings.limits(False)
        masks = [m for m in lifted.masks if len(m.points_map)]
        points = np.concatenate([m.points_map for m in masks]) if masks else np.zeros((0, 3), np.float32)
        offset = np.zeros(len(masks) + 1, np.int64)
        offset[1:] = np.cumsum([len(m.points_map) for m in masks])
        self._attic.show(points, self._views)
        self._attic.show(lifted.seen_map, self._views)
        rows, starts = self._voxels.gather(points, offset)
        weights = self._weights(view, lifted, rows, starts)
        shown = self._voxels.sight(rows, lifted.seen_map, self._views)
        vectors = [self._names.vector(m.labels[0][0]) if m.embedding is None else m.embedding for m in masks]
        meanings, dims = self._roster.meanings(vectors)
        mask_rooms = rooms_of_all(
            self._rooms if self.settings.room_prior else None, points, offset, self.settings.cross_share
        )
        things = self._roster.things
        found = match(self._voxels.cells, things, rows, weights, starts, shown, meanings, dims, mask_rooms, self._rules)
        slots = found.slots
        things.used[found.missed] = self._views
        self._touched.update((self._roster.by_slot[slot].id, None) for slot in found.missed.tolist())
        self._compare(found.pairs, slots)
        for k in np.flatnonzero(slots < 0).tolist():
            slots[k] = self._create(view.stamp_ns, masks[k].points_map).slot
        for slot, mask in zip(slots.tolist(), masks, strict=True):
            self._add_observation(self._roster.by_slot[slot], mask.labels, view.stamp_ns)
        # What was matched by what is known of it adds nothing to that.
        measured = np.array([m.measured for m in masks], np.bool_)
        add_meanings(self._roster.things, slots, meanings, dims * measured)
        self._add_evidence(rows, weights, starts, slots, shown)
        self._change.picture(view.map_T_camera, view.stamp_ns, masks, slots, found.missed, lifted.seen_map)

    def known(self, points_map: Floats, dimension: int) -> KnownThings:
        """The instances that own map points float32 [K, 3], with their embeddings of that ``dimension``."""
        self._attic.show(points_map, self._views)
        return known_things(self._voxels, self._roster, points_map, dimension)

    def claimed(self, points_map: Floats) -> Ints:
        """Ids int64 [K] of the published instances that own map points float32 [K, 3], 0 = nobody's."""
        self._attic.show(points_map, self._views)
        slots = self._voxels.owners(points_map)
        published = [slot for slot in np.unique(slots).tolist() if slot >= 0 and self._roster.by_slot[slot].published]
        return np.where(np.isin(slots, published), self._roster.things.id[slots], 0)

    def _add_observation(self, instance: Instance, labels: Sequence[tuple[str, float]], stamp_ns: int) -> None:
        if instance.last_view != self._views:  # both halves of a split mask are one observation
            self._roster.things.observations[instance.slot] += 1
            self._roster.things.used[instance.slot] = self._views
            instance.seen_in(self._views)
        instance.last_seen_ns = stamp_ns
        for name, score in labels:
            instance.add_label(name, self._names.group(name), score)
        self._touched[instance.id] = None

    def _compare(self, pairs: Rows, slots: Rows) -> None:
        """Note which instances of one meaning a mask covers together, and how often such were seen each in its own mask."""
        by_slot, by_id = self._roster.by_slot, self._roster.by_id
        for a, b in pairs.tolist():
            by_slot[a].compare(by_slot[b], 1, 0)
        matched = {by_slot[slot].id for slot in slots.tolist() if slot >= 0}
        for one in sorted(matched):
            beside = by_id[one].beside
            for other in [i for i in beside if i > one and i in matched]:
                by_id[one].compare(by_id[other], 0, 1)

    def _create(self, stamp_ns: int, points: Floats) -> Instance:
        instance = self._roster.create(stamp_ns, room_of(self._rooms, points))
        self._roster.things.expected[instance.slot] = 1
        self._waiting.append(instance.id)
        return instance

    def _weights(self, view: CameraView, lifted: LiftedView, rows: Rows, starts: Ints) -> Weights:
        """Evidence [P] that voxels are inside their masks."""
        s = self.settings
        if lifted.trimmed or s.plain:
            return np.full(len(rows), FULL, np.uint8)
        return rim_weights(view, self._voxels.cells.point, rows, starts, s.voxel_m, s.edge_px, s.edge_share)

    def _add_evidence(self, rows: Rows, weights: Weights, starts: Ints, slots: Rows, shown: Rows) -> None:
        """Write one picture into the voxels."""
        things = self._roster.things
        cells, counts, doubt = self._voxels.cells, self._voxels.counts, self.settings.doubt
        fresh, ends = add_evidence(cells, counts, rows, weights, starts, slots, shown, things.observations, doubt)
        for k, slot in enumerate(slots.tolist()):
            new = fresh[ends[k] : ends[k + 1]]
            if len(new):
                instance = self._roster.by_slot[slot]
                instance.rows.append(new)
                if not instance.published:
                    things.size[slot] += len(new)

    def watch(self, origin_map: NDArray[np.float64], points_map: Floats, stamp_ns: int) -> Floats:
        """One scan float32 [N, 3] taken from origin_map [3]: finds out, look by look, what is no longer there.

        Returns the points of the map float32 [k, 3] where nothing is any more.
        """
        return self._change.look(origin_map, points_map, stamp_ns)

    def _drop(self, instance: Instance) -> None:
        """Take an instance out with all its claims."""
        release(self._voxels.cells, self._rows(instance), instance.slot)
        self._leave(instance)

    def _rows(self, instance: Instance) -> Rows:
        """All rows that an instance ever claimed, those at rest woken; with repetitions, and with rows that it lost."""
        self._attic.wake(instance, self._views)
        return instance.rows[0] if len(instance.rows) == 1 else np.concatenate([NO_ROWS, *instance.rows])

    # ------------------------------------------------------------------------------------------------ rooms
    def follow_rooms(self, rooms: Rooms | None) -> None:
        """When the rooms changed, the room of every instance that stands where they changed is found anew."""
        if rooms is self._rooms:
            return
        before, self._rooms = self._rooms, rooms
        there = [i for i in self._roster.by_id.values() if len(i.owned if i.outline is None else i.outline)]
        boxes_xy = np.array([self._box_xy(instance) for instance in there], np.float32).reshape(-1, 4)
        for k in np.flatnonzero(may_have_moved(before, rooms, boxes_xy)).tolist():
            if self._roster.move(there[k], room_of(rooms, self._points_of(there[k]))):
                self._touched[there[k].id] = None

    def _points_of(self, instance: Instance) -> Floats:
        outline = instance.outline
        return self._voxels.cells.point[instance.owned] if outline is None else outline

    def _box_xy(self, instance: Instance) -> array[float]:
        source = instance.owned if instance.outline is None else instance.outline
        if instance.boxed is not source:
            points = self._points_of(instance)[:, :2]
            instance.boxed, instance.box_xy = source, array("f", [*points.min(0), *points.max(0)])
        return instance.box_xy

    # ------------------------------------------------------------------------------------------------ collecting
    def collect(self, stamp_ns: int) -> InstanceUpdate:
        """Merge what proved to be one, settle who owns which voxel, and report what changed since the last call."""
        by_id, by_slot = self._roster.by_id, self._roster.by_slot
        if not self.settings.plain:
            self._rules = self._habits.taught(self._rules)
        touched = [i for i in sorted({*self._touched, *self._change.touched}) if i in by_id]
        self._touched.clear()
        self._change.touched.clear()
        stock = {i: self._settle(by_id[i]) for i in touched}
        self._habits.learn(self._roster.things, np.array([by_id[i].slot for i in touched], np.int64))
        for instance_id in touched:
            if instance_id in by_id:
                self._merge_around(by_id[instance_id], stock)
        seen = {*touched, *stock.keys()}
        neighbours = {by_slot[s].id for i in stock if i in by_id for s in stock[i].rivals().tolist() if s in by_slot}
        for instance_id in sorted(neighbours - seen):
            owned = by_id[instance_id].owned
            if not np.array_equal(owned, self._settle(by_id[instance_id]).owned):
                seen.add(instance_id)
        changed: list[InstanceState] = []
        for instance_id in sorted(seen):
            if instance_id in by_id:
                self._publish(by_id[instance_id], changed)
        self._forget()
        self._attic.tidy(self._limits, self._views)
        told, over, found = self._change.tell(stamp_ns)
        changed += told
        ended, self._ended = tuple(sorted(self._ended + over)), []
        merges, self._merged = tuple(self._merged + found), []
        return InstanceUpdate(stamp_ns, tuple(changed), ended, merges)

    def _settle(self, instance: Instance) -> Settled:
        """Find the voxels that the instance owns now."""
        rows = self._rows(instance)
        things, slot = self._roster.things, instance.slot
        things.used[slot] = self._views
        stock = settle(self._voxels.cells, things, rows, instance.ascending, slot, self._limits)
        instance.rows, instance.ascending, instance.owned = [stock.rows], len(stock.rows), stock.owned
        things.level[slot], things.size[slot] = stock.typical, stock.good
        if self._rooms is not None and len(stock.owned):
            things.room[slot] = room_of(self._rooms, self._voxels.cells.point[stock.owned])
        return stock

    def _merge_around(self, instance: Instance, stock: dict[int, Settled]) -> None:
        """Merge the instance with those that claim its voxels, one after the other while any qualifies."""
        by_id, by_slot = self._roster.by_id, self._roster.by_slot
        judge = Judge(self.settings, self._roster.things, self._rules.truth, self._blind)
        while True:
            mine = stock[instance.id]
            met = {
                by_slot[s].id: (both, touch)
                for s, both, touch in zip(mine.others.tolist(), mine.both.tolist(), mine.touch.tolist(), strict=True)
                if (both or touch >= self.settings.touch_voxels) and s in by_slot
            }
            for other_id in sorted(met.keys() | instance.beside.keys()):
                other = by_id[other_id]
                if other_id not in stock:
                    stock[other_id] = self._settle(other)
                contact = Contact(mine.mine, stock[other_id].mine, *met.get(other_id, (0, 0)))
                if judge.are_one(instance, other, contact):
                    pair = sorted((instance, other), key=self._seniority)
                    instance = self._absorb(*pair)
                    stock.pop(pair[1].id)
                    stock[instance.id] = self._settle(instance)
                    break
            else:
                return

    def _seniority(self, instance: Instance) -> tuple[bool, int, int]:
        return not instance.published, -int(self._roster.things.observations[instance.slot]), instance.id

    def _absorb(self, kept: Instance, gone: Instance) -> Instance:
        """All evidence of ``gone`` becomes that of ``kept``."""
        things, by_id = self._roster.things, self._roster.by_id
        rows = self._rows(gone)
        absorb(self._voxels.cells, rows, kept.slot, gone.slot)
        kept.rows.append(rows)
        kept.take_over(gone)
        one, two = kept.slot, gone.slot
        things.observations[one] += things.observations[two]
        things.expected[one] = max(things.expected[one], things.expected[two], things.observations[one])
        if things.dim[two] and things.dim[one] in (0, things.dim[two]):
            add_meanings(things, np.array([one], np.int32), things.mean[two : two + 1], things.dim[two : two + 1])
        for other_id, (together, apart) in self._leave(gone):
            if other_id != kept.id:
                kept.compare(by_id[other_id], together, apart)
        if gone.published:
            self._ended.append(gone.id)
            self._merged.append((kept.id, gone.id))
        return kept

    def _leave(self, gone: Instance) -> list[tuple[int, tuple[int, int]]]:
        """Take an instance out; returns what was noted about it and its neighbours."""
        self._change.forget(gone.id)
        for other_id in gone.beside:
            self._roster.by_id[other_id].beside.pop(gone.id)
        self._roster.remove(gone)
        return list(gone.beside.items())

    def _publish(self, instance: Instance, changed: list[InstanceState]) -> None:
        s, things = self.settings, self._roster.things
        owned = len(instance.owned)
        # Once published, an instance stays until the evidence is clearly gone: no flicker at the threshold.
        slack = 0.5 if instance.published else 1.0
        existence, seen = self._roster.existence(instance.slot), int(things.observations[instance.slot])
        confirmed = (
            (
                seen >= s.min_observations
                or (self._blind and seen >= s.early_observations and existence >= s.early_existence * slack)
            )
            and owned >= s.min_voxels * slack
            and owned >= s.min_owned * slack * things.size[instance.slot]
            and (s.plain or existence >= s.min_existence * slack)
        )
        if confirmed:
            state = self._state(instance)
            if len(state.points_map) and instance.last_view > self._views - _RECENT:
                state = self._change.here(instance, state)
            instance.published = True
            changed.append(state)
        elif instance.published:
            instance.published = False
            self._change.forget(instance.id)
            self._ended.append(instance.id)
            self._waiting.append(instance.id)

    def _forget(self) -> None:
        """Drop unconfirmed instances that nothing has shown for long: label noise must not fill the memory."""
        limit = self._views - self.settings.forget_views
        for _ in range(min(_CHECKED, len(self._waiting))):
            instance = self._roster.by_id.get(self._waiting.popleft())
            if instance is None or instance.published:
                continue
            if instance.last_view >= limit:
                self._waiting.append(instance.id)
                continue
            self._drop(instance)

    def _state(self, instance: Instance) -> InstanceState:
        self._attic.wake(instance, self._views)
        s = self.settings
        points = np.asarray(main_points(self._voxels.cells.point, instance.owned, s.part_m, s.part_share))
        slot = instance.slot
        return InstanceState(
            instance.id,
            points,
            self._roster.direction(slot),
            instance.labels(self._names, self.settings.top_labels),
            int(self._roster.things.room[slot]),
            int(self._roster.things.observations[slot]),
            round(self._roster.existence(slot), 4),
            instance.first_seen_ns,
            instance.last_seen_ns,
            "moved" if instance.moved else "present",
        )

    def states(self) -> tuple[InstanceState, ...]:
        """All published instances, in the order of their ids. Wakes all that is at rest."""
        published = [i for _, i in sorted(self._roster.by_id.items()) if i.published]
        for instance in published:
            self._settle(instance)
        return tuple(self._state(i) for i in published if len(i.owned))

    def restore(self, states: Sequence[InstanceState]) -> None:
        """Resume from stored states: their ids go on, their voxels carry as much evidence as they had pictures."""
        for count, state in enumerate(sorted(states, key=lambda s: s.id), start=1):
            instance = restored(state, self._names, self._voxels, self._roster, self._views)
            self._change.expect(instance)
            if count % _RESTORED == 0:
                self._attic.put_away(self._limits, self._views + 1)
        self._attic.put_away(self._limits, self._views + 1)
