"""The paper's arrangement, for ``fusion.py --rooms serial|parallel``: memories that share nothing, rooms dealt out among them.

A mask goes to the memory of the room that holds most of its points, so a thing in a doorway can be two. Each memory follows its own
pictures; serial does one after the other, parallel both at once on a pool. The results are the same, only the time differs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from irsd.core.runtime import Pool, Ring
from irsd.core.types import CameraView, InstanceState, Rooms
from irsd.instances.lift import LiftedView
from irsd.instances.memory import FusionSettings, InstanceMemory
from irsd.instances.record import Embed
from irsd.instances.room_prior import room_of

Frame = tuple[CameraView, LiftedView]


class RoomsApart:
    """So many memories; room n belongs to memory n modulo their number."""

    def __init__(self, settings: FusionSettings, embed: Embed, count: int, *, parallel: bool) -> None:
        self._memories = [InstanceMemory(settings, embed) for _ in range(count)]
        self._parallel = parallel

    def __len__(self) -> int:
        return sum(map(len, self._memories))

    def streams(self, frames: Sequence[Frame], rooms: Rooms) -> list[list[Frame]]:
        """The pictures of each memory, with its masks alone; without any where a picture shows none of its rooms."""
        count = len(self._memories)
        out: list[list[Frame]] = [[] for _ in range(count)]
        for view, lifted in frames:
            owner = [room_of(rooms, mask.points_map) % count for mask in lifted.masks]
            for k in sorted(set(owner)):
                masks = tuple(m for m, o in zip(lifted.masks, owner, strict=True) if o == k)
                out[k].append((view, replace(lifted, masks=masks)))
        return out

    def drive(self, streams: Sequence[Sequence[Frame]], collect_every: int) -> None:
        """Fuse the pictures of every memory."""
        works = [_work(memory, stream, collect_every) for memory, stream in zip(self._memories, streams, strict=True)]
        if not self._parallel:
            for work in works:
                work()
            return
        done: Ring[int] = Ring(len(works))
        with Pool("rooms", len(works)) as pool:
            for k, work in enumerate(works):
                pool.submit(_told(work, done, k))
            for _ in works:
                done.get()

    def finish(self, stamp_ns: int) -> tuple[InstanceState, ...]:
        """The states of all instances at the end."""
        for memory in self._memories:
            memory.collect(stamp_ns)
        return tuple(state for memory in self._memories for state in memory.states())


def _work(memory: InstanceMemory, stream: Sequence[Frame], collect_every: int) -> Callable[[], None]:
    def work() -> None:
        for k, (view, lifted) in enumerate(stream, start=1):
            memory.observe(view, lifted, None)
            if collect_every and k % collect_every == 0:
                memory.collect(view.stamp_ns)

    return work


def _told(work: Callable[[], None], done: Ring[int], k: int) -> Callable[[], None]:
    def told() -> None:
        try:
            work()
        finally:
            done.put(k)

    return told
