"""What can be set about finding rooms."""

from __future__ import annotations

from dataclasses import dataclass, field

from irsd.core.settings import setting
from irsd.rooms.tracker import TrackSettings
from irsd.rooms.walls import WallSettings


@dataclass(frozen=True, slots=True)
class SegmentSettings:
    """How space is cut into rooms. All lengths are physical and hold for any building."""

    min_room_m2: float = setting(1.5, "a smaller piece is part of its neighbour, not a room", lo=0.1, hi=20.0)
    opening_max_m: float = setting(4.5, "the widest opening that may separate two rooms", lo=0.5, hi=12.0)
    wall_gap_max_m: float = setting(
        7.5, "the widest gap in the line of one wall that may separate two rooms", lo=0.5, hi=20.0
    )
    opening_min_m: float = setting(0.4, "a narrower gap is no passage", lo=0.1, hi=1.0)
    constriction: float = setting(
        0.75, "an opening separates when its width is below this part of the space behind it", lo=0.1, hi=1.0
    )
    doorway: float = setting(
        0.45, "an opening below this part of the space behind it is a doorway beyond doubt", lo=0.05, hi=1.0
    )
    door_max_m: float = setting(
        1.3, "doors are up to this wide; wider openings are looked for with doors closed", lo=0.5, hi=3.0
    )
    mouth: float = setting(
        0.45,
        "a passage ends where it opens into a hall: at a mouth below this part of the hall's width",
        lo=0.0,
        hi=1.0,
    )
    open_rim: float = setting(0.4, "a piece with more of its rim open to others is part of one of them", lo=0.1, hi=1.0)
    hall_m2: float = setting(20.0, "a piece of this size is a room or a hall, however open its rim", lo=1.0, hi=1000.0)
    furniture_m: float = setting(1.0, "a free-standing thing up to this long is furniture, not a wall", lo=0.0, hi=3.0)
    post_gap_m: float = setting(
        0.6, "posts this near, with something at robot height between, are one wall", lo=0.0, hi=2.0
    )
    wall_support: float = setting(
        0.4, "part of a room's rim that must stand on walls; less is the edge of what was seen", lo=0.0, hi=1.0
    )
    simplify_m: float = setting(
        0.10, "outlines may deviate by this much before corners are looked for", lo=0.05, hi=0.5
    )
    wall_reach_m: float = setting(0.15, "footprints grow by up to this much to reach the wall's face", lo=0.0, hi=0.5)


@dataclass(frozen=True, slots=True)
class RoomSettings:
    """Settings of the room stage."""

    method: str = setting(
        "ours", "ours, or irs: Algorithm 1 of the paper as published, one box per room", choices=("ours", "irs")
    )
    changed_share: float = setting(
        0.015, "rooms are found anew when this part of the known plan has changed", lo=0.0, hi=1.0
    )
    look_every: int = setting(3, "the plan is looked at once in this many updates", lo=1, hi=1000)
    settle_after: int = setting(12, "a smaller change is taken in after this many updates", lo=1, hi=10_000)
    segment: SegmentSettings = field(default_factory=SegmentSettings)
    walls: WallSettings = field(default_factory=WallSettings)
    track: TrackSettings = field(default_factory=TrackSettings)
