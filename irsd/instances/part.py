"""One part of the map that stands alone, and when it is a thing: what ``proposals`` keeps."""

from __future__ import annotations

from dataclasses import dataclass, field

from irsd.core.settings import setting
from irsd.core.types import InstanceState
from irsd.instances.voxels import Floats, Rows

UNNAMED = "object"


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
    inside: float = setting(
        0.8, "a claimant with this share of its voxels in a part may be a fragment of it", lo=0.5, hi=1.0
    )
    fill_m: float = setting(
        0.2, "of several claimants each gets what is unclaimed within this distance", lo=0.0, hi=2.0
    )
    existence: float = setting(0.6, "how sure a thing is that only the LiDAR saw", lo=0.05, hi=1.0)


@dataclass(frozen=True, slots=True)
class Contested:
    """A part that several may have: points_map float32 [n, 3], all of it; fragments: ids of the camera's instances that lie in it,
    absorbed ones included."""

    number: int
    points_map: Floats
    fragments: tuple[int, ...]


@dataclass(slots=True)
class Part:
    """One part. size, since_ns: voxels when it last changed by much, and when; told: what was published last, None: not published.

    claimants: id of an instance -> voxels of this part that are its own; taken: they have it, all of it. whole: it is of a thing's
    size, as last judged. absorbed: ids of instances that are fragments of it; heir: the claimant that gets all of it, 0 none.
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
    whole: bool = False
    absorbed: set[int] = field(default_factory=set)
    heir: int = 0
    name: tuple[tuple[str, float], ...] = ((UNNAMED, 0.0),)
    embedding: Floats | None = None
