"""The memory of instances: the only writer of what fusion knows. A view is observed, changes are collected.

Evidence decides, not single pictures: a voxel counts for an instance only where it lay in its mask in a fair share of the
pictures that showed both; each voxel has one owner; two instances become one only on relative evidence; what was seen too
seldom for how often it could have been seen is never published. Work per picture is bounded by what the picture shows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from irsd.core.settings import setting
from irsd.core.types import CameraView, InstanceState, InstanceUpdate, Rooms
from irsd.instances.associate import (
    Bools,
    Doubles,
    Floats,
    Ints,
    Shared,
    VoxelIndex,
    choose,
    mask_voxels,
    shared_voxels,
    voxel_keys,
)
from irsd.instances.lift import LiftedMask, LiftedView, connected_parts
from irsd.instances.record import Embed, Instance, Names
from irsd.instances.room_prior import may_meet, room_of

_LEAST_COVERED = 3  # voxels of an instance that a mask must cover to say anything about it


@dataclass(frozen=True)
class FusionSettings:
    """Settings of instance fusion."""

    voxel_m: float = setting(0.04, "edge of a voxel of the memory", lo=0.01, hi=0.5)
    tau_g: float = setting(0.3, "least geometric overlap of a mask and an instance", lo=0.0, hi=1.0)
    tau_s: float = setting(0.8, "least cosine of their meanings", lo=-1.0, hi=1.0)
    tau_same: float = setting(0.5, "IoU from which two things are one, whatever their names", lo=0.0, hi=1.0)
    merge_ratio: float = setting(
        0.25, "relative evidence from which a claim counts for matching and merging", lo=0.0, hi=1.0
    )
    doubt: float = setting(
        1.0, "share of earlier sightings without a claim that count against a new claim", lo=0.0, hi=1.0
    )
    cover_share: float = setting(
        0.5, "a mask covers an instance with this share of what is visible of it", lo=0.0, hi=1.0
    )
    own_ratio: float = setting(0.2, "voxels with less relative evidence belong to nobody", lo=0.0, hi=1.0)
    room_prior: bool = setting(True, "match only inside a room, unless a mask crosses its border")
    cross_share: float = setting(
        0.1, "a mask with this share of points in another room crosses the border", lo=0.0, hi=1.0
    )
    min_observations: int = setting(3, "pictures that must have seen an instance before it is published", lo=1, hi=1000)
    min_existence: float = setting(0.12, "least share of the pictures that should have seen it", lo=0.0, hi=1.0)
    min_voxels: int = setting(5, "voxels an instance must own to be published", lo=1, hi=100_000)
    min_owned: float = setting(0.3, "least share of its good voxels that an instance must own", lo=0.0, hi=1.0)
    visible_share: float = setting(
        0.5, "a picture that shows this share of an instance should have seen it", lo=0.0, hi=1.0
    )
    part_m: float = setting(0.12, "edge of the cells that join the parts of an instance", lo=0.01, hi=1.0)
    part_share: float = setting(0.1, "parts with a smaller share of the largest part are not published", lo=0.0, hi=1.0)
    forget_views: int = setting(400, "pictures after which an unconfirmed instance is forgotten", lo=10, hi=1_000_000)
    top_labels: int = setting(5, "labels given with an instance", lo=1, hi=100)


class InstanceMemory:
    """Owner of the instances. ``observe`` every view in time order, ``collect`` what changed whenever it is wanted."""

    def __init__(self, settings: FusionSettings, embed: Embed) -> None:
        self.settings = settings
        self._names = Names(embed)
        self._index = VoxelIndex()
        self._instances: dict[int, Instance] = {}
        self._touched: dict[int, None] = {}
        self._next_id = 1
        self._views = 0
        self._rooms: Rooms | None = None
        self._ended: list[int] = []
        self._merged: list[tuple[int, int]] = []

    def __len__(self) -> int:
        return len(self._instances)

    # ------------------------------------------------------------------------------------------------ observing
    def observe(self, view: CameraView, lifted: LiftedView, rooms: Rooms | None) -> None:
        """Fuse one picture's masks. rooms: the rooms as known now; None or room 0 = unknown, which restricts nothing."""
        self._views += 1
        self.follow_rooms(rooms)
        seen = self._index.find(np.unique(voxel_keys(lifted.seen_map, self.settings.voxel_m)))
        seen = seen[seen >= 0]
        masks = [m for m in lifted.masks if len(m.points_map)]
        mask, key, point = mask_voxels([m.points_map for m in masks], self.settings.voxel_m)
        rows = self._index.find(key)
        seen = np.union1d(seen, rows[rows >= 0])
        shared = shared_voxels(self._index, mask, rows, len(masks), seen, self.settings.merge_ratio)
        vectors = [self._names.vector(m.labels[0][0]) if m.embedding is None else m.embedding for m in masks]
        meanings = [np.asarray(vector, np.float64) for vector in vectors]
        ids = choose(
            shared,
            self._cosines(meanings, shared.ids),
            self._allowed(masks, shared),
            self.settings.tau_g,
            self.settings.tau_s,
            self.settings.tau_same,
        )
        self._expect(seen, ids)
        self._compare(shared, ids)
        for k in np.flatnonzero(ids == 0).tolist():
            ids[k] = self._create(view.stamp_ns, masks[k])
        for k, lifted_mask in enumerate(masks):
            self._add_observation(self._instances[int(ids[k])], lifted_mask, meanings[k], view.stamp_ns)
        self._add_evidence(ids[mask] if masks else mask, key, point, seen)

    def _cosines(self, meanings: Sequence[Doubles], ids: Ints) -> Doubles:
        """[m, c] cosine of masks and instances; 0 where their vectors come from different spaces."""
        out = np.zeros((len(meanings), len(ids)))
        for c, instance in enumerate(ids.tolist()):
            mean = self._instances[instance].direction()
            for m, vector in enumerate(meanings):
                if mean is not None and len(vector) == len(mean):
                    out[m, c] = float(vector @ mean)
        return out

    def _add_observation(self, instance: Instance, mask: LiftedMask, meaning: Doubles, stamp_ns: int) -> None:
        if instance.last_view != self._views:  # both halves of a split mask are one observation
            instance.observations += 1
            instance.last_view = self._views
        instance.last_seen_ns = stamp_ns
        instance.add_meaning(meaning)
        for name, score in mask.labels:
            instance.add_label(name, self._names.group(name), score)
        self._touched[instance.id] = None

    def _expect(self, seen: Ints, ids: Ints) -> None:
        """Count the picture for the instances that it shows well enough that they should have been detected."""
        owner = self._index.owner[seen]
        shown, count = np.unique(owner[owner > 0], return_counts=True)
        matched = set(ids.tolist())
        for instance_id, voxels in zip(shown.tolist(), count.tolist(), strict=True):
            instance = self._instances[instance_id]
            if instance_id in matched or voxels >= self.settings.visible_share * instance.size > 0:
                instance.expected += 1
                self._touched[instance_id] = None

    def _compare(self, shared: Shared, ids: Ints) -> None:
        """Note which instances of one meaning a mask covers together, and which were seen apart, each in its own mask."""
        covered = (shared.voxels >= self.settings.cover_share * shared.visible) & (shared.voxels >= _LEAST_COVERED)
        matched = ids[ids > 0]
        pairs = [(shared.ids[np.flatnonzero(row)], 1, 0) for row in covered] + [(np.unique(matched), 0, 1)]
        for some, together, apart in pairs:
            if len(some) < 2:
                continue
            means = [self._instances[i].direction() for i in some.tolist()]
            for a, b in combinations(range(len(some)), 2):
                one, other = means[a], means[b]
                if one is None or other is None or len(one) != len(other) or one @ other < self.settings.tau_s:
                    continue
                self._instances[int(some[a])].compare(self._instances[int(some[b])], together, apart)

    def _create(self, stamp_ns: int, mask: LiftedMask) -> int:
        instance = Instance(self._next_id, stamp_ns, expected=1.0, room=room_of(self._rooms, mask.points_map))
        self._instances[instance.id] = instance
        self._next_id += 1
        return instance.id

    def _add_evidence(self, ids: Ints, key: Ints, point: Floats, seen: Ints) -> None:
        """Write one picture into the index.

        ids, key, point: per unique (mask, voxel) [P]; seen: unique rows that the picture shows, the masks' known ones included.
        """
        unique_key, first = np.unique(key, return_index=True)
        self._index.insert(unique_key)
        rows = self._index.find(key)
        fresh = rows[first]
        self._index.point[fresh] = point[first]
        self._index.views[np.union1d(seen, fresh)] += 1
        order = np.lexsort((ids, rows))
        rows, ids = rows[order], ids[order]
        keep = np.ones(len(rows), np.bool_)
        keep[1:] = (np.diff(rows) != 0) | (np.diff(ids) != 0)
        rows, ids = rows[keep], ids[keep]
        # Everything shown of the instances in this picture was seen once more; hits are added to the claims below.
        owner = self._index.owner[seen]
        self._index.seen[seen] += np.isin(owner, np.unique(ids)) & (owner > 0)
        claimed = self._index.slot_of(rows, ids)
        new = claimed < 0
        at = np.searchsorted(seen, rows) if len(seen) else np.zeros(len(rows), np.int64)
        # ``claim`` counts the picture itself, so take back what the line above gave to the same claims.
        self._index.seen[rows[~new], claimed[~new]] -= seen[np.minimum(at[~new], len(seen) - 1)] == rows[~new]
        observations = np.array([self._instances[i].observations for i in ids.tolist()], np.float32)
        before = self.settings.doubt * (np.minimum(self._index.views[rows], observations).astype(np.float32) - 1)
        self._index.claim(rows, ids, np.maximum(before, 0))
        for instance in np.unique(ids[new]).tolist():
            mine = rows[new & (ids == instance)]
            self._instances[instance].rows.append(mine)
            self._instances[instance].size += 0 if self._instances[instance].published else len(mine)

    # ------------------------------------------------------------------------------------------------ rooms
    def follow_rooms(self, rooms: Rooms | None) -> None:
        """When the rooms changed, every instance's room is found anew (not per picture: rooms change seldom)."""
        if rooms is self._rooms:
            return
        self._rooms = rooms
        for instance in self._instances.values():
            room = room_of(self._rooms, self._index.point[instance.owned])
            if len(instance.owned) and room != instance.room:
                instance.room = room
                self._touched[instance.id] = None

    def _allowed(self, masks: Sequence[LiftedMask], shared: Shared) -> Bools:
        rooms = self._rooms if self.settings.room_prior else None
        instance_rooms = np.array([self._instances[i].room for i in shared.ids.tolist()], np.int64)
        return may_meet(rooms, [m.points_map for m in masks], instance_rooms, self.settings.cross_share)

    # ------------------------------------------------------------------------------------------------ collecting
    def collect(self, stamp_ns: int) -> InstanceUpdate:
        """Merge what proved to be one, settle who owns which voxel, and report what changed since the last call."""
        touched = [i for i in sorted(self._touched) if i in self._instances]
        self._touched.clear()
        for instance_id in touched:
            if instance_id in self._instances:
                self._merge_around(self._instances[instance_id])
        neighbours: set[int] = set()
        for instance_id in touched:
            if instance_id in self._instances:
                neighbours |= self._settle(self._instances[instance_id])
        for instance_id in sorted(neighbours - set(touched)):
            self._settle(self._instances[instance_id])
        changed: list[InstanceState] = []
        for instance_id in sorted(neighbours | set(touched)):
            if instance_id in self._instances:
                self._publish(self._instances[instance_id], changed)
        self._forget()
        ended, self._ended = tuple(sorted(self._ended)), []
        merges, self._merged = tuple(self._merged), []
        return InstanceUpdate(stamp_ns, tuple(changed), ended, merges)

    def _live_rows(self, instance: Instance) -> tuple[Ints, Ints]:
        """(rows, slots) that the instance holds now; claims that gave way are dropped from its list for good."""
        rows = instance.rows[0] if len(instance.rows) == 1 else np.unique(np.concatenate(instance.rows))
        slot = self._index.slot_of(rows, np.full(len(rows), instance.id, np.int64))
        if (slot < 0).any():
            rows, slot = rows[slot >= 0], slot[slot >= 0]
        instance.rows = [rows]
        return rows, slot

    def _merge_around(self, instance: Instance) -> None:
        """Merge the instance with those that claim its voxels, one after the other while any qualifies."""
        while True:
            rows, slot = self._live_rows(instance)
            good = self._index.ratio(rows) >= self.settings.merge_ratio
            owner = np.where(good, self._index.owner[rows], 0)
            mine = good[np.arange(len(rows)), slot]
            others, both = np.unique(owner[mine], return_counts=True)
            shared = dict(zip(others.tolist(), both.tolist(), strict=True))
            for other_id in sorted((set(shared) | set(instance.beside)) - {0, instance.id}):
                other = self._instances[other_id]
                if self._seen_as_one(instance, other) or self._are_one(
                    instance, int(mine.sum()), other, shared.get(other_id, 0)
                ):
                    instance = self._absorb(
                        *sorted((instance, other), key=lambda i: (not i.published, -i.observations, i.id))
                    )
                    break
            else:
                return

    def _seen_as_one(self, a: Instance, b: Instance) -> bool:
        """Masks covered both often enough, compared with how often each had its own mask in one picture."""
        together, apart = a.beside.get(b.id, (0, 0))
        return together >= max(self.settings.min_observations, self.settings.merge_ratio * (together + apart))

    def _are_one(self, a: Instance, a_size: int, b: Instance, both: int) -> bool:
        """The paper's two criteria inside a room on the evidence of all pictures, or the same voxels under two names."""
        rows, slot = self._live_rows(b)
        b_size = int((self._index.ratio(rows)[np.arange(len(rows)), slot] >= self.settings.merge_ratio).sum())
        if min(a_size, b_size) < self.settings.min_voxels:
            return False
        if both >= self.settings.tau_same * (a_size + b_size - both):
            return True
        parted = self.settings.room_prior and 0 not in (a.room, b.room) and a.room != b.room
        if parted or both < self.settings.tau_g * min(a_size, b_size):
            return False
        mean = a.direction()
        return mean is not None and bool(self._cosines([mean], np.array([b.id]))[0, 0] >= self.settings.tau_s)

    def _absorb(self, kept: Instance, gone: Instance) -> Instance:
        """All evidence of ``gone`` becomes that of ``kept``."""
        rows, slot = self._live_rows(gone)
        hits, seen = self._index.hits[rows, slot].copy(), self._index.seen[rows, slot].copy()
        have = self._index.slot_of(rows, np.full(len(rows), kept.id, np.int64))
        both, only = have >= 0, have < 0
        self._index.hits[rows[both], have[both]] += hits[both]
        self._index.seen[rows[both], have[both]] += seen[both]
        self._index.owner[rows[only], slot[only]] = kept.id
        self._index.release(rows[both], gone.id)
        kept.rows.append(rows[only])
        kept.take_over(gone)
        for other_id, (together, apart) in self._leave(gone):
            if other_id != kept.id:
                kept.compare(self._instances[other_id], together, apart)
        if gone.published:
            self._ended.append(gone.id)
            self._merged.append((kept.id, gone.id))
        self._touched[kept.id] = None
        return kept

    def _leave(self, gone: Instance) -> list[tuple[int, tuple[int, int]]]:
        """Take an instance out; returns what was noted about it and its neighbours."""
        for other_id in gone.beside:
            self._instances[other_id].beside.pop(gone.id)
        del self._instances[gone.id]
        return list(gone.beside.items())

    def _settle(self, instance: Instance) -> set[int]:
        """Find the voxels that the instance owns now; returns who else claims voxels of it."""
        rows, slot = self._live_rows(instance)
        owners = self._index.owners(rows, self.settings.own_ratio)
        good = self._index.ratio(rows)[np.arange(len(rows)), slot] >= self.settings.own_ratio
        instance.owned = rows[owners == instance.id]
        instance.size = float(good.sum())
        instance.room = room_of(self._rooms, self._index.point[instance.owned])
        return set(np.unique(self._index.owner[rows]).tolist()) - {0, instance.id}

    def _publish(self, instance: Instance, changed: list[InstanceState]) -> None:
        s = self.settings
        owned = len(instance.owned)
        # Once published, an instance stays until the evidence is clearly gone: no flicker at the threshold.
        slack = 0.5 if instance.published else 1.0
        confirmed = (
            instance.observations >= s.min_observations
            and owned >= s.min_voxels * slack
            and owned >= s.min_owned * slack * instance.size
            and instance.existence >= s.min_existence * slack
        )
        if confirmed:
            instance.published = True
            changed.append(self._state(instance))
        elif instance.published:
            instance.published = False
            self._ended.append(instance.id)

    def _forget(self) -> None:
        """Drop unconfirmed instances that nothing has shown for long: label noise must not fill the memory."""
        limit = self._views - self.settings.forget_views
        old = [i for i in self._instances.values() if not i.published and i.last_view < limit]
        for instance in old:
            rows, _ = self._live_rows(instance)
            self._index.release(rows, instance.id)
            self._leave(instance)

    def _state(self, instance: Instance) -> InstanceState:
        points = self._index.point[instance.owned]
        part = connected_parts(points, self.settings.part_m)
        size = np.bincount(part)
        points = points[size[part] >= self.settings.part_share * size.max()]
        meaning = instance.direction()
        return InstanceState(
            instance.id,
            points,
            None if meaning is None else meaning.astype(np.float32),
            instance.labels(self._names, self.settings.top_labels),
            instance.room,
            instance.observations,
            round(instance.existence, 4),
            instance.first_seen_ns,
            instance.last_seen_ns,
        )

    def states(self) -> tuple[InstanceState, ...]:
        """All published instances, in the order of their ids."""
        return tuple(self._state(i) for _, i in sorted(self._instances.items()) if i.published and len(i.owned))

    def restore(self, states: Sequence[InstanceState]) -> None:
        """Resume from stored states: their ids go on, their voxels carry as much evidence as they had pictures."""
        for state in sorted(states, key=lambda s: s.id):
            instance = Instance(state.id, state.first_seen_ns, state.last_seen_ns, self._views, state.observations)
            instance.expected = state.observations / max(state.existence, 1e-3)
            instance.room, instance.published = state.room, True
            if state.embedding is not None:
                instance.meaning = state.embedding.astype(np.float64) * state.observations
            for name, share in state.labels:
                instance.add_label(name, self._names.group(name), share * state.observations)
            keys, first = np.unique(voxel_keys(state.points_map, self.settings.voxel_m), return_index=True)
            rows = self._index.insert(keys)
            self._index.point[rows] = state.points_map[first]
            self._index.claim(rows, np.full(len(rows), state.id), np.zeros(len(rows), np.float32))
            slot = self._index.slot_of(rows, np.full(len(rows), state.id))
            for evidence in (self._index.hits, self._index.seen):
                evidence[rows, slot] = state.observations
            self._index.views[rows] = np.maximum(self._index.views[rows], state.observations)
            instance.rows, instance.owned, instance.size = [rows], rows, float(len(rows))
            self._instances[state.id] = instance
            self._next_id = max(self._next_id, state.id + 1)
