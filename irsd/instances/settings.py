"""Settings of instance fusion."""

from __future__ import annotations

from dataclasses import dataclass, field

from irsd.core.settings import setting
from irsd.instances.associate import NEVER, Rules
from irsd.instances.change import ChangeSettings
from irsd.instances.settle import Limits


@dataclass(frozen=True)
class FusionSettings:
    """Settings of instance fusion."""

    method: str = setting(
        "ours", "ours, or irs: the paper's plain rule (union of what matches), for comparison", choices=("ours", "irs")
    )
    voxel_m: float = setting(
        0.04, "edge of a voxel of the memory, about that of the points which it gets", lo=0.01, hi=0.5
    )
    tau_g: float = setting(0.3, "least geometric overlap of a mask and an instance", lo=0.0, hi=1.0)
    tau_s: float = setting(0.8, "least cosine of their meanings", lo=-1.0, hi=1.0)
    tau_merge: float = setting(
        0.95, "least cosine, freed from noise, of the mean meanings of two instances that become one", lo=-1.0, hi=1.0
    )
    merge_overlap: float = setting(0.3, "least geometric overlap of two instances that become one", lo=0.0, hi=1.0)
    tau_same: float = setting(0.5, "IoU from which two things are one, whatever their names", lo=0.0, hi=1.0)
    merge_ratio: float = setting(
        0.25, "relative evidence from which a claim counts for matching and merging", lo=0.0, hi=1.0
    )
    doubt: float = setting(
        1.0, "share of earlier sightings without a claim that count against a new claim", lo=0.0, hi=1.0
    )
    edge_px: float = setting(
        6.0,
        "masks that come as points with their uncertain edges: full evidence begins this far inside",
        lo=0.0,
        hi=50.0,
    )
    edge_share: float = setting(0.8, "or at this share of the mask's half width, if that is less", lo=0.0, hi=1.0)
    cover_share: float = setting(
        0.5, "a mask covers an instance with this share of what is visible of it", lo=0.0, hi=1.0
    )
    cover_least: float = setting(
        0.5, "where misses can't be seen: and at least this share of all that is known of it", lo=0.0, hi=1.0
    )
    known_share: float = setting(
        0.5, "where misses can't be seen: overlap is taken of at least this share of an instance", lo=0.0, hi=1.0
    )
    own_ratio: float = setting(0.2, "voxels with less relative evidence belong to nobody", lo=0.0, hi=1.0)
    own_level: float = setting(
        0.3,
        "where misses can't be seen: voxels with a smaller share of the typical hits belong to nobody",
        lo=0.0,
        hi=1.0,
    )
    part_ratio: float = setting(
        0.9, "an instance made up of several masks in this share of its pictures is several things", lo=0.0, hi=2.0
    )
    room_prior: bool = setting(True, "match only inside a room, unless a mask crosses its border")
    cross_share: float = setting(
        0.1, "a mask with this share of points in another room crosses the border", lo=0.0, hi=1.0
    )
    min_observations: int = setting(3, "pictures that must have seen an instance before it is published", lo=1, hi=1000)
    min_existence: float = setting(0.12, "least share of the pictures that should have seen it", lo=0.0, hi=1.0)
    early_existence: float = setting(
        0.6,
        "where misses can't be seen: two pictures are enough if this share of those that should have seen it did",
        lo=0.0,
        hi=1.0,
    )
    early_observations: int = setting(
        1, "where misses can't be seen: so many pictures are enough, existence permitting", lo=1, hi=1000
    )
    touch_voxels: int = setting(10, "voxels that parts of one thing claim both, at least", lo=1, hi=10_000)
    min_voxels: int = setting(5, "voxels an instance must own to be published", lo=1, hi=100_000)
    min_owned: float = setting(0.3, "least share of its good voxels that an instance must own", lo=0.0, hi=1.0)
    visible_share: float = setting(
        0.5, "a picture that shows this share of an instance should have seen it", lo=0.0, hi=1.0
    )
    part_m: float = setting(0.12, "edge of the cells that join the parts of an instance", lo=0.01, hi=1.0)
    part_share: float = setting(0.1, "parts with a smaller share of the largest part are not published", lo=0.0, hi=1.0)
    forget_views: int = setting(400, "pictures after which an unconfirmed instance is forgotten", lo=10, hi=1_000_000)
    rest_views: int = setting(
        100, "pictures without a look after which the voxels at a place are packed", lo=1, hi=1_000_000
    )
    top_labels: int = setting(5, "labels given with an instance", lo=1, hi=100)
    change: ChangeSettings = field(default_factory=ChangeSettings)

    @property
    def plain(self) -> bool:
        """Whether the paper's rule is asked for."""
        return self.method == "irs"

    def rules(self, blind: bool) -> Rules:
        """What matching needs. blind: the pictures do not tell what they saw beside their masks."""
        if self.plain:
            return Rules(
                self.tau_g,
                self.tau_s,
                2.0,
                0.0,
                self.cover_share,
                self.visible_share,
                2.0,
                1.0,
                0.0,
                self.tau_s,
                0.0,
                NEVER,
                NEVER,
            )
        return Rules(
            self.tau_g, self.tau_s, self.tau_same, self.merge_ratio, self.cover_share, self.visible_share, self.part_ratio,
            self.cover_least if blind else 0.0,
            self.known_share if blind else 0.0,
            self.tau_merge,
            self.merge_ratio if blind else 0.0,
            self.tau_s,
            1.0,
        )  # fmt: skip

    def limits(self, blind: bool) -> Limits:
        """What settling needs. Where pictures tell all that they saw, misses are counted and typical hits are not needed."""
        if blind:
            return Limits(self.own_ratio, self.own_level, 0.0, 0.9, self.plain, self.merge_ratio, self.merge_ratio)
        return Limits(self.own_ratio, 0.0, 0.0, 1.0, self.plain, self.merge_ratio, 0.0)
