"""Pictures are people's: what may be written to disk, for how long, and where irsd does not look at all.

The graph holds no pictures in any case: points, names and directions of meaning only.
"""

from __future__ import annotations

from dataclasses import dataclass

from irsd.core.settings import setting
from irsd.graph.model import RoomNode
from irsd.graph.scene_graph import SceneGraph

PICTURES = frozenset({"image", "image_compressed"})  # kinds of topics


@dataclass(frozen=True)
class PrivacySettings:
    """What becomes of pictures."""

    store_pictures: bool = setting(
        False, "the rolling recording (record.rolling_mb), and so irsctl bundle, may hold pictures"
    )
    retention_days: float = setting(
        7.0, "the rolling recording is deleted when it is older than this", lo=0.01, hi=3650.0
    )
    no_pictures_in: tuple[str, ...] = setting(
        (),
        "rooms by id or name, such as [R3, bathroom]: while the robot is there, pictures are neither looked at nor kept",
    )


def is_private(rooms: tuple[str, ...], number: int, graph: SceneGraph) -> bool:
    """Whether the room of this number (0: none) is among those named by id or name."""
    if not rooms or not number:
        return False
    node = graph.find_node(f"R{number}")
    label = node.label.casefold() if isinstance(node, RoomNode) else ""
    return any(name.casefold() in (f"r{number}", label) for name in rooms)
