"""What the LiDAR shows all round: parts of the map that stand alone become instances, where no picture made one.

A part keeps its number while the map grows (it goes to the part that holds most of its voxels) and gets an id when it is told for the
first time, once it has kept its size for a while. Voxels that a published instance of the camera owns are that one's: a part that is
mostly claimed ends in it, and what of the part nobody claimed completes those who claim the rest, because a mask of few pixels
covers a thing less well than the map does. Where several claim a part and as a whole it can be named better than they can, it has
them (``contested``, ``absorb``). The camera's instances are never changed otherwise.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from irsd.core.types import InstanceState, InstanceUpdate, LooseChange, Rooms
from irsd.instances.part import Contested, Part, ProposalSettings
from irsd.instances.pieces import across, diagonal, pieces_of
from irsd.instances.room_prior import room_of
from irsd.instances.voxels import Floats, Ints, Rows, voxel_keys

NS_PER_S = 1_000_000_000
_KEY_M = 0.08  # cells by which parts are found again after a restart


class Proposals:
    """Owner of the parts. ``take`` every change of the map, ``join`` whenever the camera's instances are told."""

    def __init__(self, settings: ProposalSettings, take_id: Callable[[], int]) -> None:
        """take_id: a fresh id that no instance has or will get."""
        self.settings, self._take_id = settings, take_id
        self._parts: dict[int, Part] = {}
        self._next = 1
        self._owner = np.zeros(1024, np.int32)  # by voxel row: number of the part, 0 = none
        self._dirty: dict[int, None] = {}
        self._waiting: dict[int, None] = {}  # parts that have not kept their size for long enough
        self._camera: dict[int, InstanceState] = {}  # the camera's instances as fusion told them
        self._parts_of: dict[int, set[int]] = {}  # instance -> parts of which it claims something
        self._contested: dict[int, None] = {}  # parts that were judged in the last step and have fragments
        self._absorbed: dict[int, int] = {}  # instance -> number of the part that has it
        self._back: dict[int, None] = {}  # instances to be told again, no part has them any more
        self._ended: list[tuple[int, int]] = []  # ids that end, and into which instance (0: none)
        self._restored: dict[int, InstanceState] = {}
        self._restored_keys, self._restored_of = np.zeros(0, np.int64), np.zeros(0, np.int64)
        self._rooms: Rooms | None = None

    def __len__(self) -> int:
        return len(self._parts)

    # ------------------------------------------------------------------------------------------------ the map
    def take(self, change: LooseChange, stamp_ns: int) -> None:
        """Parts of the map anew."""
        self._reserve(change)
        for number in np.unique(self._owner[change.gone]).tolist():
            if number:
                self._lose(self._parts[number], change.gone)
        pieces = self._pieces(change)
        votes: list[tuple[int, int, int]] = []  # -voxels in common, number of the part, piece
        for k, (rows, _) in enumerate(pieces):
            owners, counts = np.unique(self._owner[rows], return_counts=True)
            votes += [(-int(c), int(o), k) for o, c in zip(owners, counts, strict=True) if o]
        heir: dict[int, int] = {}
        taken: set[int] = set()
        for _, number, k in sorted(votes):
            if k not in heir and number not in taken:
                heir[k] = number
                taken.add(number)
        for k, (rows, points) in enumerate(pieces):
            self._set(heir.get(k), rows, points, stamp_ns)
        for number in {number for _, number, _ in votes} - taken:
            part = self._parts.get(number)
            if part is not None and not (self._owner[part.rows] == number).any():
                heirs = self._owner[part.rows]
                self._end(part, into=self._parts[int(np.bincount(heirs).argmax())] if heirs.any() else None)

    def _pieces(self, change: LooseChange) -> list[tuple[Rows, Floats]]:
        out = []
        for a, b in zip(change.offset[:-1].tolist(), change.offset[1:].tolist(), strict=True):
            rows, points = change.rows[a:b], change.points_map[a:b]
            if b - a < self.settings.min_voxels and not self._owner[rows].any():
                continue  # specks, most of which stay specks
            if b - a < self.settings.part_voxels or diagonal(points) <= self.settings.heap_m:
                out.append((rows, points))
                continue
            piece = pieces_of(points, self.settings.link_m, self.settings.part_voxels)
            out += [(rows[piece == k], points[piece == k]) for k in range(int(piece.max(initial=-1)) + 1)]
        return out

    def _set(self, number: int | None, rows: Rows, points: Floats, stamp_ns: int) -> None:
        part = self._parts.get(number) if number is not None else None
        if part is None:
            part = Part(self._next, rows, points, stamp_ns, stamp_ns, len(rows))
            self._next += 1
            self._parts[part.number] = part
            self._recall(part)
        else:
            self._owner[part.rows[self._owner[part.rows] == part.number]] = 0
            part.rows, part.points = rows, points
        for other in np.unique(self._owner[rows]).tolist():
            if other and other != part.number:
                self._dirty[other] = None
        self._owner[rows] = part.number
        if abs(len(rows) - part.size) > self.settings.settle_share * part.size:
            part.size, part.since_ns = len(rows), stamp_ns
        self._dirty[part.number] = None

    def _lose(self, part: Part, gone: Rows) -> None:
        self._owner[gone[self._owner[gone] == part.number]] = 0
        mine = self._owner[part.rows] == part.number
        part.rows, part.points = part.rows[mine], part.points[mine]
        self._dirty[part.number] = None

    def _reserve(self, change: LooseChange) -> None:
        most = max(int(change.rows.max(initial=0)), int(change.gone.max(initial=0))) + 1
        if most > len(self._owner):
            self._owner = np.pad(self._owner, (0, max(most, 2 * len(self._owner)) - len(self._owner)))

    def _end(self, part: Part, into: Part | None = None) -> None:
        del self._parts[part.number]
        self._dirty.pop(part.number, None)
        self._waiting.pop(part.number, None)
        self._release(part)
        self._give_back(part, part.absorbed)
        if part.told is not None:
            self._ended.append((part.id, into.id if into is not None and into.told is not None else 0))

    # ------------------------------------------------------------------------------------------------ the camera
    def join(
        self,
        update: InstanceUpdate,
        rooms: Rooms | None,
        rows_at: Callable[[Floats], Rows],
        owners: Callable[[Floats], Ints],
        stamp_ns: int,
    ) -> InstanceUpdate:
        """The camera's update with what the map adds to it.

        rows_at: voxel rows [K] of points [K, 3], -1 = none; owners: ids [K] of the camera's published instances that own them, 0 =
        none.
        """
        told = {state.id: state for state in update.changed}
        self._camera.update(told)
        for instance_id in update.ended:
            self._camera.pop(instance_id, None)
            if instance_id in self._absorbed:
                self._parts[self._absorbed.pop(instance_id)].absorbed.discard(instance_id)
        self._touch(update, rows_at)
        moved = self._follow_rooms(rooms)
        again: set[int] = {*told, *self._back}
        self._contested, self._back = {}, {}
        due, self._dirty = sorted({*self._dirty, *self._settled(stamp_ns)}), {}
        out: list[InstanceState] = []
        for number in due:
            part = self._parts.get(number)
            if part is not None:
                again |= self._judge(part, owners, rooms, stamp_ns, out)
        out += [part.told for part in moved if part.told is not None and part.number not in due]
        again |= self._back.keys()
        free = sorted(i for i in again if i in self._camera and i not in self._absorbed)
        changed = [self._complete(self._camera[i]) for i in free]
        over, self._ended = self._ended, []
        return replace(
            update,
            changed=tuple(sorted([*changed, *out], key=lambda state: state.id)),
            ended=tuple(sorted({*update.ended, *(i for i, _ in over)})),
            merged=(*update.merged, *((into, i) for i, into in over if into)),
        )

    def withdraw(self) -> tuple[tuple[int, ...], tuple[InstanceState, ...]]:
        """Nothing of this is told any more, for now; returns the ids that end, and the camera's instances that are whole again."""
        over = [i for i, _ in self._ended]
        self._ended = []
        for part in self._parts.values():
            if part.told is not None:
                over.append(part.id)
                part.told = None
            self._release(part)
            self._waiting[part.number] = None
            self._give_back(part, set(part.absorbed))
        back, self._back = [self._camera[i] for i in self._back], {}
        return tuple(sorted(over)), tuple(back)

    def _touch(self, update: InstanceUpdate, rows_at: Callable[[Floats], Rows]) -> None:
        """The parts under what changed or ended are to be judged again."""
        for state in update.changed:
            rows = rows_at(state.points_map)
            rows = rows[(rows >= 0) & (rows < len(self._owner))]
            self._dirty.update((number, None) for number in np.unique(self._owner[rows]).tolist() if number)
        for instance_id in (*update.ended, *(state.id for state in update.changed)):
            self._dirty.update((number, None) for number in sorted(self._parts_of.get(instance_id, ())))

    def _settled(self, stamp_ns: int) -> list[int]:
        least_ns = stamp_ns - round(self.settings.settle_s * NS_PER_S)
        due = [n for n in self._waiting if self._parts[n].since_ns <= least_ns]
        for number in due:
            del self._waiting[number]
        return due

    def _judge(
        self,
        part: Part,
        owners: Callable[[Floats], Ints],
        rooms: Rooms | None,
        stamp_ns: int,
        out: list[InstanceState],
    ) -> set[int]:
        """Whether a part is a thing of its own now; returns the camera's instances to be told again."""
        s, before = self.settings, set(part.claimants)
        self._release(part)
        mine = self._owner[part.rows] == part.number
        part.rows, part.points = part.rows[mine], part.points[mine]
        count = len(part.rows)
        if count == 0:
            self._end(part)
            return before
        if count < s.min_voxels and part.told is None:
            return before
        owner = owners(part.points) if self._camera else np.zeros(count, np.int64)
        whole = part.whole = count >= s.min_voxels and diagonal(part.points) <= s.max_size_m
        settled = stamp_ns - part.since_ns >= round(s.settle_s * NS_PER_S)
        self._weigh(part, owner, nameable=whole and settled and across(part.points) >= s.line_share)
        owner[np.isin(owner, list(part.absorbed))] = 0
        self._note_claims(part, owner)
        claims = sum(part.claimants.values())
        alone = bool(claims) and max(part.claimants.values()) >= max(0.9 * claims, s.complete_from * count)
        alone |= part.heir in part.claimants
        mostly = claims >= s.claimed * count
        part.taken = whole and (mostly or alone)
        free = part.points[owner == 0] if claims else part.points
        if not whole or mostly or alone or len(free) < s.min_voxels or across(free) < s.line_share:
            if part.told is not None:
                into = max(part.claimants, key=lambda i: (part.claimants[i], -i), default=0)
                self._ended.append((part.id, into))
                part.told = None
        elif part.told is None and not settled:
            self._waiting[part.number] = None
        else:
            self._tell(part, free, rooms, stamp_ns, out, anew=before != set(part.claimants))
        return before | set(part.claimants)

    def _note_claims(self, part: Part, owner: Ints) -> None:
        if not owner.any():
            return
        ids, counts = np.unique(owner[owner > 0], return_counts=True)
        part.claimants = {int(i): int(c) for i, c in zip(ids, counts, strict=True) if int(i) in self._camera}
        for instance_id in part.claimants:
            self._parts_of.setdefault(instance_id, set()).add(part.number)

    def _tell(
        self, part: Part, points: Floats, rooms: Rooms | None, stamp_ns: int, out: list[InstanceState], *, anew: bool
    ) -> None:
        last = part.told
        if last is not None and not anew and abs(len(points) - len(last.points_map)) <= 0.02 * len(points):
            return
        part.id = part.id or self._take_id()
        part.told = InstanceState(
            part.id, points, part.embedding, part.name, room_of(rooms, points), 0, self.settings.existence,
            part.first_ns, stamp_ns,
        )  # fmt: skip
        out.append(part.told)

    def _release(self, part: Part) -> None:
        for instance_id in part.claimants:
            self._parts_of[instance_id].discard(part.number)
        part.claimants, part.taken = {}, False

    def _complete(self, state: InstanceState) -> InstanceState:
        """A camera's instance with the unclaimed points of the parts that are its own."""
        parts = [self._parts[n] for n in sorted(self._parts_of.get(state.id, ()))]
        more = [self._share_of(state, part) for part in parts if part.taken and state.state != "gone"]
        more = [points for points in more if len(points)]
        return replace(state, points_map=np.concatenate([state.points_map, *more])) if more else state

    def _share_of(self, state: InstanceState, part: Part) -> Floats:
        """The points of a part that nobody claims and that fall to this claimant."""
        others = [self._camera[i].points_map for i in part.claimants if i != state.id and i in self._camera]
        mine, _ = cKDTree(state.points_map).query(part.points)
        if not others:
            return np.asarray(part.points[mine > 0.5 * _KEY_M], np.float32)
        theirs, _ = cKDTree(np.concatenate(others)).query(part.points)
        free = (mine > 0.5 * _KEY_M) & (theirs > 0.5 * _KEY_M)
        if part.heir in part.claimants:
            return np.asarray(part.points[free] if part.heir == state.id else part.points[:0], np.float32)
        return np.asarray(part.points[free & (mine < theirs) & (mine <= self.settings.fill_m)], np.float32)

    def alone(self, rows: Rows) -> Rows:
        """Number int32 [K] of the part of a thing's size that holds each voxel row [K], 0 where there is none."""
        known = (rows >= 0) & (rows < len(self._owner))
        out = np.where(known, self._owner[np.where(known, rows, 0)], 0).astype(np.int32)
        others = [number for number in np.unique(out[out > 0]).tolist() if not self._parts[number].whole]
        out[np.isin(out, others)] = 0
        return out

    # ------------------------------------------------------------------------------------------------ fragments
    @property
    def absorbed(self) -> Collection[int]:
        """Ids of the camera's instances that are fragments of a part."""
        return self._absorbed.keys()

    def contested(self) -> list[Contested]:
        """The parts that were judged in the last step and have fragments in them."""
        parts = [self._parts[number] for number in self._contested if number in self._parts]
        return [Contested(p.number, p.points, tuple(sorted(self._fragments(p) | p.absorbed))) for p in parts]

    def absorb(self, number: int, fragments: Sequence[int], heir: int = 0) -> None:
        """These fragments, and no others, are the part's from the next step on; they end in it, or in the claimant that gets it."""
        part = self._parts[number]
        self._give_back(part, part.absorbed - set(fragments))
        if heir != part.heir:
            part.heir = heir
            self._dirty[number] = None
        for instance_id in sorted(set(fragments) - part.absorbed):
            if instance_id in self._absorbed:  # it has grown from one part into another
                self._parts[self._absorbed[instance_id]].absorbed.discard(instance_id)
            part.absorbed.add(instance_id)
            self._absorbed[instance_id] = number
            part.id = part.id or self._take_id()
            self._ended.append((instance_id, heir or part.id))
            self._dirty[number] = None

    def _weigh(self, part: Part, owner: Ints, *, nameable: bool) -> None:
        """Whether the part has fragments; what was absorbed and has grown out is free again. owner: as in ``_note_claims``."""
        ids, counts = np.unique(owner[owner > 0], return_counts=True)
        inside = dict(zip(ids.tolist(), counts.tolist(), strict=True))
        least = self.settings.inside
        grown = {i for i in part.absorbed if inside.get(i, 0) < 0.75 * least * len(self._camera[i].points_map)}
        self._give_back(part, grown if nameable else set(part.absorbed))
        inner = [i for i, n in inside.items() if i in self._camera and n >= least * len(self._camera[i].points_map)]
        if nameable and (len(inner) > 1 or any(inside[i] < self.settings.complete_from * len(owner) for i in inner)):
            self._contested[part.number] = None

    def _fragments(self, part: Part) -> set[int]:
        least = self.settings.inside
        return {i for i, n in part.claimants.items() if n >= least * len(self._camera[i].points_map)}

    def _give_back(self, part: Part, fragments: set[int]) -> None:
        for instance_id in sorted(fragments):
            part.absorbed.discard(instance_id)
            del self._absorbed[instance_id]
            self._back[instance_id] = None

    # ------------------------------------------------------------------------------------------------ rooms, restart
    def _follow_rooms(self, rooms: Rooms | None) -> list[Part]:
        """The published parts whose room has changed."""
        if rooms is self._rooms:
            return []
        self._rooms = rooms
        moved = []
        for part in self._parts.values():
            if part.told is not None:
                room = room_of(rooms, part.told.points_map)
                if room != part.told.room:
                    part.told = replace(part.told, room=room)
                    moved.append(part)
        return moved

    def restore(self, states: Sequence[InstanceState]) -> None:
        """Ids of stored things that only the LiDAR had seen: parts that are found where they stood take them up again."""
        self._restored = {state.id: state for state in states}
        keys = [np.unique(voxel_keys(state.points_map, 1.0 / _KEY_M)) for state in states]
        of = [np.full(len(k), state.id, np.int64) for k, state in zip(keys, states, strict=True)]
        if states:
            all_keys = np.concatenate(keys)
            order = np.argsort(all_keys, kind="stable")
            self._restored_keys, self._restored_of = all_keys[order], np.concatenate(of)[order]

    def _recall(self, part: Part) -> None:
        """A new part that lies where a stored thing stood goes on under its id."""
        if not self._restored:
            return
        keys = np.unique(voxel_keys(part.points, 1.0 / _KEY_M))
        at = np.minimum(np.searchsorted(self._restored_keys, keys), len(self._restored_keys) - 1)
        ids = self._restored_of[at[self._restored_keys[at] == keys]]
        ids = ids[np.isin(ids, list(self._restored))]
        if len(ids) * 2 < len(keys):
            return
        found, counts = np.unique(ids, return_counts=True)
        state = self._restored.pop(int(found[counts.argmax()]))
        part.id, part.first_ns, part.told, part.name = state.id, state.first_seen_ns, state, state.labels
