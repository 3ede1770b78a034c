"""What the LiDAR shows all round: parts of the map that stand alone become instances, where no picture made one.

A part keeps its number while the map grows (it goes to the part that holds most of its voxels) and gets an id when it is told for the
first time, once it has kept its size for a while. Voxels that a published instance of the camera owns are that one's: a part that is
mostly claimed ends in it, and what of the part nobody claimed completes those who claim the rest, because a mask of few pixels
covers a thing less well than the map does. The camera's instances are never changed otherwise.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from irsd.core.settings import setting
from irsd.core.types import InstanceState, InstanceUpdate, LooseChange, Rooms
from irsd.instances.room_prior import room_of
from irsd.instances.settle import connected_parts
from irsd.instances.voxels import Floats, Ints, Rows, voxel_keys

NS_PER_S = 1_000_000_000
UNNAMED = "object"
_KEY_M = 0.08  # cells by which parts are found again after a restart


@dataclass(frozen=True)
class ProposalSettings:
    """When a part of the map is a thing."""

    enabled: bool = setting(True, "with irsd's own eyes, parts of the map that no picture shows become things, too")
    period_s: float = setting(2.0, "parts are looked at anew at most this often, in sensor time", lo=0.1, hi=60.0)
    link_m: float = setting(0.05, "edge of the cells whose touching joins voxels of a heap", lo=0.02, hi=0.5)
    part_voxels: int = setting(60, "smaller pieces of a heap join the nearest large one", lo=1, hi=10_000)
    min_voxels: int = setting(40, "smaller parts are no things", lo=3, hi=10_000)
    heap_m: float = setting(3.0, "parts with a longer diagonal are cut where their voxels don't touch", lo=0.5, hi=50.0)
    max_size_m: float = setting(5.0, "parts with a longer diagonal are no things but heaps of them", lo=0.5, hi=50.0)
    line_share: float = setting(
        0.06,
        "parts whose spread across is a smaller share of that along are traces of single LiDAR beams, no things",
        lo=0.0,
        hi=1.0,
    )
    settle_s: float = setting(4.0, "a part must keep its size for so long before it is told", lo=0.0, hi=600.0)
    settle_share: float = setting(0.25, "by more than this its size must not change meanwhile", lo=0.01, hi=10.0)
    claimed: float = setting(
        0.5, "a part with this share of voxels claimed by pictures' instances is theirs", lo=0.1, hi=1.0
    )
    complete_from: float = setting(0.25, "a single claimant with this share of a part gets all of it", lo=0.05, hi=1.0)
    fill_m: float = setting(
        0.2, "of several claimants each gets what is unclaimed within this distance", lo=0.0, hi=2.0
    )
    existence: float = setting(0.6, "how sure a thing is that only the LiDAR saw", lo=0.05, hi=1.0)


@dataclass(slots=True)
class _Part:
    """One part. size, since_ns: voxels when it last changed by much, and when; told: what was published last, None: not published.

    claimants: id of an instance -> voxels of this part that are its own; taken: they have it, all of it.
    """

    number: int
    rows: Rows
    points: Floats
    first_ns: int
    since_ns: int
    size: int
    id: int = 0
    told: InstanceState | None = None
    claimants: dict[int, int] = field(default_factory=dict)
    taken: bool = False
    name: tuple[tuple[str, float], ...] = ((UNNAMED, 0.0),)
    embedding: Floats | None = None


class Proposals:
    """Owner of the parts. ``take`` every change of the map, ``join`` whenever the camera's instances are told."""

    def __init__(self, settings: ProposalSettings, take_id: Callable[[], int]) -> None:
        """take_id: a fresh id that no instance has or will get."""
        self.settings, self._take_id = settings, take_id
        self._parts: dict[int, _Part] = {}
        self._next = 1
        self._owner = np.zeros(1024, np.int32)  # by voxel row: number of the part, 0 = none
        self._dirty: dict[int, None] = {}
        self._waiting: dict[int, None] = {}  # parts that have not kept their size for long enough
        self._camera: dict[int, InstanceState] = {}  # the camera's instances as fusion told them
        self._parts_of: dict[int, set[int]] = {}  # instance -> parts of which it claims something
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
            if b - a < self.settings.part_voxels or _diagonal(points) <= self.settings.heap_m:
                out.append((rows, points))
                continue
            piece = pieces_of(points, self.settings.link_m, self.settings.part_voxels)
            out += [(rows[piece == k], points[piece == k]) for k in range(int(piece.max(initial=-1)) + 1)]
        return out

    def _set(self, number: int | None, rows: Rows, points: Floats, stamp_ns: int) -> None:
        part = self._parts.get(number) if number is not None else None
        if part is None:
            part = _Part(self._next, rows, points, stamp_ns, stamp_ns, len(rows))
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

    def _lose(self, part: _Part, gone: Rows) -> None:
        self._owner[gone[self._owner[gone] == part.number]] = 0
        mine = self._owner[part.rows] == part.number
        part.rows, part.points = part.rows[mine], part.points[mine]
        self._dirty[part.number] = None

    def _reserve(self, change: LooseChange) -> None:
        most = max(int(change.rows.max(initial=0)), int(change.gone.max(initial=0))) + 1
        if most > len(self._owner):
            self._owner = np.pad(self._owner, (0, max(most, 2 * len(self._owner)) - len(self._owner)))

    def _end(self, part: _Part, into: _Part | None = None) -> None:
        del self._parts[part.number]
        self._dirty.pop(part.number, None)
        self._waiting.pop(part.number, None)
        self._release(part)
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
        self._touch(update, rows_at)
        moved = self._follow_rooms(rooms)
        again: set[int] = set(told)
        due, self._dirty = sorted({*self._dirty, *self._settled(stamp_ns)}), {}
        out: list[InstanceState] = []
        for number in due:
            part = self._parts.get(number)
            if part is not None:
                again |= self._judge(part, owners, rooms, stamp_ns, out)
        out += [part.told for part in moved if part.told is not None and part.number not in due]
        changed = [self._complete(self._camera[i]) for i in sorted(again) if i in self._camera]
        over, self._ended = self._ended, []
        return replace(
            update,
            changed=tuple(sorted([*changed, *out], key=lambda state: state.id)),
            ended=tuple(sorted({*update.ended, *(i for i, _ in over)})),
            merged=(*update.merged, *((into, i) for i, into in over if into)),
        )

    def withdraw(self) -> tuple[int, ...]:
        """Nothing of this is told any more, for now; returns the ids that end."""
        over = [i for i, _ in self._ended]
        self._ended = []
        for part in self._parts.values():
            if part.told is not None:
                over.append(part.id)
                part.told = None
            self._release(part)
            self._waiting[part.number] = None
        return tuple(sorted(over))

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
        part: _Part,
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
        self._note_claims(part, owner)
        claims = sum(part.claimants.values())
        alone = bool(claims) and max(part.claimants.values()) >= max(0.9 * claims, s.complete_from * count)
        whole = _diagonal(part.points) <= s.max_size_m
        mostly = claims >= s.claimed * count
        part.taken = whole and (mostly or alone)
        free = part.points[owner == 0] if claims else part.points
        if not whole or mostly or alone or len(free) < s.min_voxels or _across(free) < s.line_share:
            if part.told is not None:
                into = max(part.claimants, key=lambda i: (part.claimants[i], -i), default=0)
                self._ended.append((part.id, into))
                part.told = None
        elif part.told is None and stamp_ns - part.since_ns < round(s.settle_s * NS_PER_S):
            self._waiting[part.number] = None
        else:
            self._tell(part, free, rooms, stamp_ns, out, anew=before != set(part.claimants))
        return before | set(part.claimants)

    def _note_claims(self, part: _Part, owner: Ints) -> None:
        if not owner.any():
            return
        ids, counts = np.unique(owner[owner > 0], return_counts=True)
        part.claimants = {int(i): int(c) for i, c in zip(ids, counts, strict=True) if int(i) in self._camera}
        for instance_id in part.claimants:
            self._parts_of.setdefault(instance_id, set()).add(part.number)

    def _tell(
        self, part: _Part, points: Floats, rooms: Rooms | None, stamp_ns: int, out: list[InstanceState], *, anew: bool
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

    def _release(self, part: _Part) -> None:
        for instance_id in part.claimants:
            self._parts_of[instance_id].discard(part.number)
        part.claimants, part.taken = {}, False

    def _complete(self, state: InstanceState) -> InstanceState:
        """A camera's instance with the unclaimed points of the parts that are its own."""
        parts = [self._parts[n] for n in sorted(self._parts_of.get(state.id, ()))]
        more = [self._share_of(state, part) for part in parts if part.taken and state.state != "gone"]
        more = [points for points in more if len(points)]
        return replace(state, points_map=np.concatenate([state.points_map, *more])) if more else state

    def _share_of(self, state: InstanceState, part: _Part) -> Floats:
        """The points of a part that nobody claims and that fall to this claimant."""
        others = [self._camera[i].points_map for i in part.claimants if i != state.id and i in self._camera]
        mine, _ = cKDTree(state.points_map).query(part.points)
        if not others:
            return np.asarray(part.points[mine > 0.5 * _KEY_M], np.float32)
        theirs, _ = cKDTree(np.concatenate(others)).query(part.points)
        near = (mine > 0.5 * _KEY_M) & (theirs > 0.5 * _KEY_M) & (mine < theirs) & (mine <= self.settings.fill_m)
        return np.asarray(part.points[near], np.float32)

    # ------------------------------------------------------------------------------------------------ rooms, restart
    def _follow_rooms(self, rooms: Rooms | None) -> list[_Part]:
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

    def _recall(self, part: _Part) -> None:
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


# ------------------------------------------------------------------------------------------------------------ kernels
def _diagonal(points: Floats) -> float:
    """Of the box of points [n, 3], n >= 1."""
    return float(np.linalg.norm(points.max(0) - points.min(0)))


def _across(points: Floats) -> float:
    """Second largest by largest standard deviation of points [n, 3] along their principal axes; 0 for a line."""
    values = np.linalg.eigvalsh(np.cov(points.astype(np.float64).T))
    return float(np.sqrt(max(values[1], 0.0) / max(values[2], 1e-12)))


def pieces_of(points: Floats, link_m: float, least: int) -> NDArray[np.int64]:
    """Which piece each of points [n, 3] belongs to: connected ones of at least ``least`` points, smaller ones with the nearest."""
    part = np.asarray(connected_parts(points, link_m), np.int64)
    size = np.bincount(part, minlength=1)
    large = np.flatnonzero(size >= least)
    if len(large) < 2:
        return np.zeros(len(points), np.int64)
    number = np.full(len(size), -1, np.int64)
    number[large] = np.arange(len(large))
    out = number[part]
    rest = np.flatnonzero(out < 0)
    if len(rest):
        kept = np.flatnonzero(out >= 0)
        distance, nearest = cKDTree(points[kept]).query(points[rest])
        order = np.lexsort((distance, part[rest]))
        first = np.unique(part[rest][order], return_index=True)[1]
        of_part = dict(zip(part[rest][order][first].tolist(), out[kept[nearest[order][first]]].tolist(), strict=True))
        out[rest] = [of_part[p] for p in part[rest].tolist()]
    return out
