"""The embedded world while it changes: sensors through the pipeline, what the graph says against the truth. Simulated time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from irsd.config import IrsdConfig
from irsd.core.types import SyncedFrame
from irsd.ctl.recordings import Offline
from irsd.graph.model import GraphDelta, InstanceNode
from irsd.ingest import SensorDecoder
from irsd.perception.encoder import LabelEncoder
from irsd.pipeline import MapPipeline, StepResult
from irsd.sensors.replay import RawMessage
from irsd.sensors.sync import Synchronizer
from irsd.sim.furniture import person
from irsd.sim.rearrange import CATALOGUE
from irsd.sim.world import World

MEETING_ROOM = 4
PLANT, WHITEBOARD, TRASH_CAN = 78, 77, 79
RNG = np.random.default_rng(1)


class Recorded(MapPipeline):
    """The pipeline, keeping its deltas."""

    def step(self, frame: SyncedFrame) -> StepResult:
        result = super().step(frame)
        self.deltas: list[GraphDelta] = [*getattr(self, "deltas", []), *([result.delta] if result.delta else [])]
        return result


class Robot:
    """A robot in the building of seed 4, its sensors wired to a pipeline."""

    def __init__(self) -> None:
        config = IrsdConfig()
        self.world = World(4, explore=False)
        self.pipeline = Recorded(config.pipeline, LabelEncoder.load(), map_id="test")
        self._offline = Offline(SensorDecoder(config.ingest), Synchronizer(config.sync), self.pipeline)
        self.run(1.0)

    def run(self, seconds: float) -> None:
        end_ns = self.world.now_ns + round(seconds * 1e9)
        while self.world.now_ns < end_ns:
            for m in self.world.step(0.02):
                self._offline.feed(RawMessage(m.topic, m.type_name, m.data, m.log_time_ns))

    def drive(self, way: Sequence[Sequence[float]]) -> None:
        self.world.follow(way)
        for _ in range(300):
            if self.world.phase == "idle":
                return
            self.run(0.2)
        raise AssertionError("the robot does not arrive")

    def go(self, x: float, y: float) -> None:
        space = self.world.building.space
        _, before = space.distances(self.world.robot.odometry[:2])
        way = space.path(before, np.array([x, y]))
        self.drive([[*xy, float(self.world.robot.odometry[2])] for xy in way.tolist()])

    def look_around(self) -> None:
        x, y, yaw = self.world.robot.odometry.tolist()
        for quarter in range(1, 5):
            self.drive([[x, y, float(np.angle(np.exp(1j * (yaw + quarter * np.pi / 2))))]])

    def tour(self) -> None:
        """Around at two places of the meeting room."""
        for x, y in ((3.2, 1.6), (2.0, 2.3)):
            self.go(x, y)
            self.look_around()

    def things(self, label: str, near: NDArray[np.float64], within_m: float = 0.6) -> list[InstanceNode]:
        """Nodes of the graph with a label, the middle of their boxes (in plan) near a place of the world."""
        nodes = self.pipeline.snapshot().instances
        return [
            n for n in nodes if n.label == label and np.linalg.norm(np.array(n.obb_center_m[:2]) - near[:2]) < within_m
        ]

    def told(self, node_id: str, since: int) -> list[InstanceNode]:
        return [n for d in self.pipeline.deltas[since:] for n in d.instances if n.id == node_id]


def middle(world: World, thing_id: int) -> NDArray[np.float64]:
    thing = next(t for t in world.building.things if t.id == thing_id)
    return np.asarray((thing.aabb_min_m + thing.aabb_max_m) / 2)


@pytest.fixture(scope="module")
def changed() -> tuple[Robot, dict[str, NDArray[np.float64]], dict[str, InstanceNode], int]:
    """(the robot after it looked again, where things were, the nodes they had, how many deltas came before)."""
    robot = Robot()
    robot.tour()
    names = {"plant": PLANT, "whiteboard": WHITEBOARD, "trash can": TRASH_CAN}
    places = {name: middle(robot.world, number) for name, number in names.items()}
    nodes = {name: robot.things(name, place)[0] for name, place in places.items()}
    robot.go(2.0, 0.0)
    before = len(robot.pipeline.deltas)
    robot.world.remove(PLANT)
    robot.world.remove(WHITEBOARD)
    robot.world.move(TRASH_CAN, 5.2, 3.9)
    robot.world.place(CATALOGUE["lamp"](RNG), 4.9, 1.7)
    robot.tour()
    robot.tour()
    return robot, places, nodes, before


def test_what_was_carried_away_is_told_of_as_gone_and_ends(
    changed: tuple[Robot, dict[str, NDArray[np.float64]], dict[str, InstanceNode], int],
) -> None:
    robot, places, nodes, before = changed
    for name in ("plant", "whiteboard"):
        last = robot.told(nodes[name].id, before)[-1]
        assert (last.state, last.existence) == ("gone", 0.0), name
        assert last.last_seen_ns <= robot.pipeline.deltas[before - 1].stamp_ns, "when it was last seen, not when missed"
    removed = [i for d in robot.pipeline.deltas[before:] for i in d.removed]
    assert nodes["plant"].id in removed
    assert [n.id for n in robot.things("plant", places["plant"], 1.0)] == []


def test_nothing_stays_where_it_stood(
    changed: tuple[Robot, dict[str, NDArray[np.float64]], dict[str, InstanceNode], int],
) -> None:
    robot, places, _, _ = changed
    arrays = robot.pipeline.arrays()
    present = [n for n in robot.pipeline.snapshot().instances if n.state != "gone"]
    for name in ("plant", "trash can"):
        place = places[name]
        near = [n.id for n in present if _share_within(arrays[n.id].points_map, place, 0.3) > 0.3]
        assert near == [], f"a ghost of the {name}"


def _share_within(points: NDArray[np.float32], place: NDArray[np.float64], within_m: float) -> float:
    return float((np.linalg.norm(points - place, axis=1) < within_m).mean())


def test_another_is_there_after_three_pictures(
    changed: tuple[Robot, dict[str, NDArray[np.float64]], dict[str, InstanceNode], int],
) -> None:
    robot, _, _, before = changed
    lamp = max(robot.things("lamp", np.array([4.9, 1.7])), key=lambda n: n.point_count)
    first = robot.told(lamp.id, before)[0]
    assert (first.state, first.observations <= 4) == ("present", True)
    assert lamp.existence > 0.8


def test_what_was_moved_keeps_its_id(
    changed: tuple[Robot, dict[str, NDArray[np.float64]], dict[str, InstanceNode], int],
) -> None:
    robot, places, nodes, _ = changed
    (can,) = robot.things("trash can", np.array([5.2, 3.9]))
    assert (can.id, can.state) == (nodes["trash can"].id, "moved")
    assert can.first_seen_ns == nodes["trash can"].first_seen_ns
    assert can.last_seen_ns > nodes["trash can"].last_seen_ns
    assert robot.things("trash can", places["trash can"]) == []


def test_all_else_stays(
    changed: tuple[Robot, dict[str, NDArray[np.float64]], dict[str, InstanceNode], int],
) -> None:
    robot, _, _, _ = changed
    world = robot.world
    for number in (71, 72, 73, 76, 80):  # chairs, a picture on the wall
        thing = next(t for t in world.building.things if t.id == number)
        found = robot.things(thing.label, middle(world, number), 0.5)
        assert [n.state for n in found] == ["present"], thing.label


def test_people_walking_by_do_not_stay() -> None:
    robot = Robot()
    robot.go(3.2, 1.6)
    robot.look_around()
    before = {n.id for n in robot.pipeline.snapshot().instances}
    robot.world.walk(person(RNG), [[1.6, 2.4], [5.1, 1.9], [1.6, 2.4], [2.4, 1.6]], speed_m_s=0.9)
    robot.look_around()
    robot.run(5.0)
    robot.look_around()
    nodes = robot.pipeline.snapshot().instances
    assert [n.id for n in nodes if "person" in dict(n.labels) and n.state != "gone" and n.label == "person"] == []
    lost = before - {n.id for n in nodes}
    assert len(lost) <= 2, "what stands there stays"
