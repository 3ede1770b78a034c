"""Who the instances are: ids, slots and numbers. Slots are reused, ids never."""

from __future__ import annotations

from array import array

import numpy as np
from numpy.typing import NDArray

from irsd.instances.associate import Things, new_things
from irsd.instances.record import Instance, Numbers
from irsd.instances.voxels import NOBODY, Floats

_SCALARS = tuple(name for name in Things._fields if name not in ("id", "mean", "column"))


class Roster:
    """Owner of the instances' records and of their numbers by slot."""

    def __init__(self) -> None:
        self.things = new_things(64, 1)
        self.by_id: dict[int, Instance] = {}
        self.by_slot: dict[int, Instance] = {}
        self.next_id = 1
        self._free: list[int] = list(range(63, -1, -1))

    def __len__(self) -> int:
        return len(self.by_id)

    def create(self, stamp_ns: int, room: int, instance_id: int | None = None) -> Instance:
        """A new instance in a free slot, all its numbers zero."""
        number = self.next_id if instance_id is None else instance_id
        self.next_id = max(self.next_id, number + 1)
        self.by_id[number] = instance = Instance(number, NOBODY, stamp_ns)
        self._take_slot(instance)
        self.things.room[instance.slot] = room
        return instance

    def remove(self, instance: Instance) -> None:
        """Forget an instance; its claims must have been released before."""
        del self.by_id[instance.id], self.by_slot[instance.slot]
        self.things.id[instance.slot] = 0
        self._free.append(instance.slot)

    def retire(self, instance: Instance) -> None:
        """Give the slot of an instance back, which claims nothing in the voxels now; ``recall`` it before it is used again."""
        things, slot = self.things, instance.slot
        dim, length = int(things.dim[slot]), max(float(things.length[slot]), 1e-9)
        scalars = array("d", [getattr(things, name)[slot].item() for name in _SCALARS])
        instance.numbers = Numbers(scalars, (things.mean[slot, :dim] / np.float32(length)).astype(np.float16))
        del self.by_slot[slot]
        things.id[slot] = 0
        self._free.append(slot)
        instance.slot = NOBODY

    def recall(self, instance: Instance) -> None:
        """Give an instance a slot again, with the numbers that it had; nothing when it has one."""
        if instance.numbers is None:
            return
        kept, instance.numbers = instance.numbers, None
        self._take_slot(instance)
        slot = instance.slot
        for name, value in zip(_SCALARS, kept.scalars, strict=True):
            getattr(self.things, name)[slot] = value
        self.things.mean[slot, : len(kept.mean)] = kept.mean.astype(np.float32) * self.things.length[slot]

    def move(self, instance: Instance, room: int) -> bool:
        """Note the room of an instance; whether it is another one than before."""
        if instance.numbers is None:
            before, self.things.room[instance.slot] = int(self.things.room[instance.slot]), room
            return before != room
        scalars, at = instance.numbers.scalars, _SCALARS.index("room")
        before, scalars[at] = round(scalars[at]), room
        return before != room

    def _take_slot(self, instance: Instance) -> None:
        if not self._free:
            self._grow(2 * len(self.things.id), self.things.mean.shape[1])
        slot = self._free.pop()
        for numbers in self.things:
            numbers[slot] = 0
        self.things.column[slot] = NOBODY
        self.things.id[slot] = instance.id
        self.by_slot[slot] = instance
        instance.slot = slot

    def rename(self, instance: Instance, new_id: int) -> None:
        """The instance goes on under another id, one that nobody has."""
        del self.by_id[instance.id]
        for other_id in instance.beside:
            beside = self.by_id[other_id].beside
            beside[new_id] = beside.pop(instance.id)
        instance.id = new_id
        self.by_id[new_id] = instance
        self.things.id[instance.slot] = new_id

    def meanings(self, vectors: list[Floats]) -> tuple[Floats, NDArray[np.int32]]:
        """Unit vectors of a picture as (float32 [m, D], lengths int32 [m]); D is the longest ever given."""
        dims = np.array([len(v) for v in vectors], np.int32)
        if dims.max(initial=0) > self.things.mean.shape[1]:
            self._grow(len(self.things.id), int(dims.max()))
        width = self.things.mean.shape[1]
        if vectors and (dims == width).all():
            return np.stack(vectors).astype(np.float32, copy=False), dims
        out = np.zeros((len(vectors), width), np.float32)
        for k, vector in enumerate(vectors):
            out[k, : len(vector)] = vector
        return out, dims

    def direction(self, slot: int) -> Floats | None:
        """Unit vector float32 [D] of the mean meaning; None where there is none."""
        dim, length = int(self.things.dim[slot]), float(self.things.length[slot])
        return None if dim == 0 or length < 1e-9 else self.things.mean[slot, :dim] / np.float32(length)

    def existence(self, slot: int) -> float:
        """Share of the pictures that should have seen it and did."""
        return min(1.0, float(self.things.observations[slot]) / max(float(self.things.expected[slot]), 1.0))

    def _grow(self, capacity: int, dim: int) -> None:
        old, self.things = self.things, new_things(capacity, dim)
        count = len(old.id)
        for name in Things._fields:
            if name == "mean":
                self.things.mean[:count, : old.mean.shape[1]] = old.mean
            else:
                getattr(self.things, name)[:count] = getattr(old, name)
        self._free = list(range(capacity - 1, count - 1, -1)) + self._free
