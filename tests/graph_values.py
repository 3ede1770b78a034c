"""Graph values for tests: hypothesis strategies for every type of graph.model."""

from __future__ import annotations

from hypothesis import strategies as st

from irsd.graph.codec import as_published
from irsd.graph.model import BuildingNode, DoorEdge, GraphDelta, GraphSnapshot, InstanceNode, RoomNode

metres = st.floats(-1e5, 1e5)
size = st.floats(0, 1e4)
share = st.floats(0, 1)
text = st.text(st.characters(exclude_categories=["Cs"]), max_size=12)
count = st.integers(0, 10**9)
stamp = st.integers(0, 2**63 - 1)
labels = st.lists(st.tuples(text, share), min_size=1, max_size=4).map(tuple)


def ids(letter: str) -> st.SearchStrategy[str]:
    return st.integers(0, 9999).map(lambda n: f"{letter}{n}")


def some(strategy: st.SearchStrategy, most: int = 4) -> st.SearchStrategy:
    return st.lists(strategy, max_size=most).map(tuple)


def unique(strategy: st.SearchStrategy) -> st.SearchStrategy:
    """Nodes with different ids, by number, as snapshots hold them."""
    nodes = st.lists(strategy, max_size=4, unique_by=lambda node: node.id)
    return nodes.map(lambda found: tuple(sorted(found, key=lambda node: int(node.id[1:]))))


xy = st.tuples(metres, metres)
xyz = st.tuples(metres, metres, metres)
sizes = st.tuples(size, size, size)
rooms = st.builds(
    RoomNode,
    id=ids("R"),
    label=text,
    labels=labels,
    polygon_xy=some(xy),
    aabb_xy=st.tuples(metres, metres, metres, metres),
    area_m2=size,
    floor_z_m=metres,
    ceiling_z_m=st.none() | metres,
    instances=some(ids("I")),
    doors=some(ids("D")),
)
doors = st.builds(DoorEdge, id=ids("D"), rooms=st.tuples(ids("R"), ids("R")), position_xy=xy, width_m=size)
instances = st.builds(
    InstanceNode,
    id=ids("I"),
    label=text,
    labels=labels,
    room=st.none() | ids("R"),
    centroid_m=xyz,
    aabb_min_m=xyz,
    aabb_max_m=xyz,
    obb_center_m=xyz,
    obb_size_m=sizes,
    obb_yaw_rad=st.floats(-1.5, 1.5),
    volume_m3=size,
    point_count=count,
    observations=count,
    existence=share,
    state=st.sampled_from(["present", "moved", "gone"]),
    first_seen_ns=stamp,
    last_seen_ns=stamp,
    score_kind=st.sampled_from(["votes", "chances"]),
)
buildings = st.builds(BuildingNode, id=st.just("B0"), name=text, rooms=some(ids("R")))
deltas = st.builds(
    GraphDelta,
    seq=count,
    stamp_ns=stamp,
    map_id=text,
    frame=text,
    rooms=unique(rooms),
    doors=unique(doors),
    instances=unique(instances),
    removed=some(ids("I")),
    lineage=some(text),
)
snapshots = st.builds(
    GraphSnapshot,
    seq=count,
    stamp_ns=stamp,
    map_id=text,
    frame=text,
    building=buildings,
    rooms=unique(rooms),
    doors=unique(doors),
    instances=unique(instances),
)
nodes = rooms | doors | instances | buildings


def an_instance(number: int, room: str | None = None, observations: int = 1) -> InstanceNode:
    """A plain instance I<number>."""
    zero = (0.0, 0.0, 0.0)
    boxes = (zero, zero, zero, zero, (1.0, 1.0, 1.0), 0.0, 1.0)
    return as_published(
        InstanceNode(f"I{number}", "box", (("box", 1.0),), room, *boxes, 10, observations, 1.0, "present", 0, 1)
    )


def a_room(number: int, label: str = "room", instances: tuple[str, ...] = (), doors: tuple[str, ...] = ()) -> RoomNode:
    """A plain room R<number>, 1 m2."""
    corners = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))
    return RoomNode(f"R{number}", label, (), corners, (0.0, 0.0, 1.0, 1.0), 1.0, 0.0, 2.5, instances, doors)


def a_delta(seq: int, *, rooms=(), doors=(), instances=(), removed=()) -> GraphDelta:
    """A delta of map "m"."""
    return GraphDelta(seq, seq * 10, "m", "map", tuple(rooms), tuple(doors), tuple(instances), tuple(removed), ())
