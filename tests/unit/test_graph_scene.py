from __future__ import annotations

import pytest
from graph_values import a_delta, a_room, an_instance
from hypothesis import given, settings
from hypothesis import strategies as st

from irsd.graph.model import DoorEdge, GraphDelta
from irsd.graph.scene_graph import SceneGraph


def door(number: int, a: int, b: int) -> DoorEdge:
    return DoorEdge(f"D{number}", (f"R{a}", f"R{b}"), (0.0, 0.0), 0.9)


def test_an_empty_graph_has_a_building_only() -> None:
    graph = SceneGraph("m", building_name="house")
    assert graph.snapshot().seq == 0
    assert graph.snapshot().building.name == "house"
    assert graph.has_node("B0")
    assert graph.find_node("R1") is None
    assert not graph.has_node("D1")
    with pytest.raises(KeyError):
        graph.get_node("I1")


def test_topology_follows_the_deltas() -> None:
    graph = SceneGraph("m")
    before = graph.apply(
        a_delta(
            1,
            rooms=[a_room(1), a_room(2), a_room(10)],
            doors=[door(1, 1, 2), door(2, 2, 10), door(3, 1, 2)],
            instances=[an_instance(1, "R1"), an_instance(2, "R1"), an_instance(10, "R1"), an_instance(3)],
        )
    )
    assert before.building.rooms == ("R1", "R2", "R10")
    assert [i.id for i in graph.get_instances("R1")] == ["I1", "I2", "I10"]
    assert graph.get_neighbours("R2") == ("R1", "R10")
    assert graph.find_way("R1", "R10") == ("R1", "R2", "R10")
    after = graph.apply(a_delta(2, instances=[an_instance(1, "R2")], removed=["I2", "D2", "R10"]))
    assert [i.id for i in graph.get_instances("R1")] == ["I10"]
    assert [i.id for i in graph.get_instances("R2")] == ["I1"]
    assert graph.find_way("R1", "R10") is None
    assert [d.id for d in after.doors] == ["D1", "D3"]
    assert after.building.rooms == ("R1", "R2")
    assert len(before.instances) == 4  # a snapshot never changes
    graph.apply(a_delta(3, removed=["D1"]))
    assert graph.get_neighbours("R1") == ("R2",)  # through the other door


def test_a_delta_that_does_not_follow_is_refused() -> None:
    graph = SceneGraph("m")
    with pytest.raises(ValueError, match="does not follow"):
        graph.apply(a_delta(2))
    with pytest.raises(ValueError, match=r"of map"):
        graph.apply(GraphDelta(1, 0, "other", "map", (), (), (), (), ()))


@settings(max_examples=50, deadline=None)
@given(st.lists(st.tuples(st.lists(st.tuples(st.integers(1, 6), st.integers(1, 3)), max_size=4), st.integers(1, 6))))
def test_a_graph_restored_at_any_step_goes_on_alike(steps: list[tuple[list[tuple[int, int]], int]]) -> None:
    """Snapshots against a plain dictionary; restored from each snapshot, the graph ends the same."""
    graph, expected = SceneGraph("m"), {}
    graph.apply(a_delta(1, rooms=[a_room(k) for k in (1, 2, 3)]))
    for seq, (placed, removed) in enumerate(steps, 2):
        nodes = {f"I{n}": an_instance(n, f"R{r}", seq) for n, r in placed}
        gone = [f"I{removed}"] if f"I{removed}" not in nodes else []
        delta = a_delta(seq, instances=[nodes[i] for i in sorted(nodes)], removed=gone)
        restored = SceneGraph.from_snapshot(graph.snapshot())
        assert restored.apply(delta) == graph.apply(delta)
        expected = {i: n for i, n in {**expected, **nodes}.items() if i not in gone}
        assert {n.id: n for n in graph.snapshot().instances} == expected
        for room in ("R1", "R2", "R3"):
            inside = sorted(i for i, n in expected.items() if n.room == room)
            assert [n.id for n in graph.get_instances(room)] == inside
            assert restored.get_instances(room) == graph.get_instances(room)
