"""The loop: one synchronised frame in, one graph delta out. The live thread and the replay both call ``MapPipeline.step``.

    SyncedFrame -> localise -> mapping -> rooms -> (eyes) -> instances -> graph

Nothing here knows of zenoh, files, threads or the wall clock: what is due is decided by sensor time alone, so the same
input gives the same graph.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from irsd.allround import AllRound
from irsd.config import PipelineSettings
from irsd.core.geometry import Pose
from irsd.core.grid import GridFrame
from irsd.core.times import is_due
from irsd.core.types import CameraView, Localisation, MapUpdate, PlanEvidence, Prototype, Rooms, SyncedFrame
from irsd.graph.builder import GraphBuilder
from irsd.graph.edits import Record, Request
from irsd.graph.footprints import footprint_of, opening_of
from irsd.graph.model import Edit, GraphDelta, GraphSnapshot, InstanceArrays
from irsd.graph.scene_graph import SceneGraph, number_of
from irsd.graph.store import StoredMap
from irsd.instances.lift import lift
from irsd.instances.memory import InstanceMemory
from irsd.instances.room_prior import room_of
from irsd.lookout import Company, Lookout
from irsd.mapping.localise import Localiser
from irsd.mapping.mapper import Mapper
from irsd.perception.encoder import LabelEncoder
from irsd.perception.naming import Namer
from irsd.perception.structure_net import structure_model
from irsd.perception.worker import Eyes
from irsd.privacy import is_private
from irsd.rooms.stage import RoomStage
from irsd.warm import warm_up

NS_PER_S = 1_000_000_000


@dataclass(frozen=True, slots=True)
class StepResult:
    """What one step did. delta: None when nothing in the graph changed. stage_ms: wall milliseconds per stage that ran.

    rooms_followed: the rooms took this sweep in. where: the robot in the map; None where there was no frame.
    """

    update: MapUpdate
    delta: GraphDelta | None
    snapshot: GraphSnapshot
    stage_ms: dict[str, float]
    rooms_followed: bool = True
    where: Localisation | None = None


class MapPipeline:
    """Owns map, rooms, instances and graph; the only writer of all four. Not thread-safe: one thread calls it."""

    def __init__(
        self,
        settings: PipelineSettings,
        labels: LabelEncoder,
        *,
        map_id: str,
        frame: str = "map",
        eyes: Eyes | None = None,
        namer: Namer | None = None,
        no_pictures_in: tuple[str, ...] = (),
    ) -> None:
        """eyes: who looks at pictures that come without detections; None: nobody. namer: who names things by shape and picture; with
        one, what stands alone in the LiDAR's map becomes things, too. no_pictures_in: rooms by id or name in which nobody looks.
        """
        warm_up()  # compiled kernels are loaded now, not in the first frame
        self._settings = settings
        network = structure_model(settings.mapping.network.model)
        self._mapper = Mapper(settings.mapping, network, parts=namer is not None)
        self._localiser = Localiser(settings.localise)
        self._room_stage = RoomStage(settings.rooms)
        self._memory = InstanceMemory(settings.fusion, labels.encode, self._mapper)
        self._builder = GraphBuilder(settings.graph, labels, frame=frame, map_id=map_id)
        self._graph = SceneGraph(map_id=map_id, frame=frame)
        self._rooms: Rooms | None = None
        self._graph_due_ns = 0
        self._stamp_ns = 0
        self._lookout = None if eyes is None else Lookout(eyes, settings.lift)
        self._company = Company()
        self._allround = None if namer is None else AllRound(settings.proposals, namer, self._mapper, self._memory)
        self._sweeps_without_rooms = 0
        self._over: tuple[int, ...] = ()
        self._no_pictures_in = no_pictures_in
        self.pictures_allowed = True

    def step(self, frame: SyncedFrame) -> StepResult:
        """Take one frame through every stage that is due."""
        ms: dict[str, float] = {}
        self._stamp_ns = frame.stamp_ns

        # 1. The scan laid on the map, which takes the drift out of the odometry; then into the voxel map and the plan.
        with _timed(ms, "localise"):
            frame, where = self._localiser.place(frame, self._mapper.voxels)
        with _timed(ms, "mapping"):
            update = self._mapper.integrate(frame)

        if self._allround is not None:
            with _timed(ms, "parts"):
                self._allround.follow(frame.stamp_ns)

        # 2. Rooms: the stage looks at the plan now and then, and spreads its work over the scans.
        with _timed(ms, "rooms"):
            followed = self._follow_rooms(frame)
        if self._no_pictures_in:
            here = room_of(self._rooms, frame.map_T_base[None, :3, 3].astype(np.float32))
            self.pictures_allowed = not is_private(self._no_pictures_in, here, self._graph)

        # 3. What the cameras saw: masks to 3D points, points to instances.
        for view in frame.views:
            if view.detections is not None:
                self._company.heard(view.stamp_ns)
                with _timed(ms, "lift"):
                    seen = self._mapper.visible(view.map_T_camera, view.camera, self._settings.lift.max_range_m)
                self._observe(view, *seen, ms)
            elif self._lookout is not None and view.image is not None and self._must_see(view.stamp_ns):
                with _timed(ms, "keyframes"):
                    alone = None if self._allround is None else self._allround.alone
                    self._lookout.show(view, self._mapper, self._memory, self._rooms, alone)
        self._observe_answers(ms)

        # 4. What the LiDAR saw through: things that are no longer there.
        with _timed(ms, "fusion"):
            free = self._memory.watch(frame.scan.origin_map, frame.scan.points_map, frame.stamp_ns)
            self._mapper.forget(free)

        # 5. The graph, when its period is over.
        delta = None
        period_ns = round(self._settings.pace.graph_period_s * NS_PER_S)
        if is_due(frame.stamp_ns, self._graph_due_ns, period_ns):
            delta = self._commit(frame.stamp_ns, ms)
            self._graph_due_ns = frame.stamp_ns + period_ns
        return StepResult(update, delta, self._graph.snapshot(), ms, followed, where)

    def finish(self, stamp_ns: int) -> StepResult:
        """Run every stage once more on all that was gathered: the end of a recording, or a clean stop."""
        ms: dict[str, float] = {}
        with _timed(ms, "rooms"):
            self._rooms = self._room_stage.update(self._mapper.plan_evidence(), *self._mapper.wall_points())
        self._observe_answers(ms)
        delta = self._commit(stamp_ns, ms)
        update = MapUpdate(0, stamp_ns, np.zeros(0, np.int32), 0.0, None, None)
        return StepResult(update, delta, self._graph.snapshot(), ms)

    @property
    def answers_wait(self) -> bool:
        """Whether the eyes have answers that no step has taken yet."""
        return self._lookout is not None and self._lookout.eyes.answers_wait

    def navigation_grid(self) -> tuple[GridFrame, NDArray[np.int8]]:
        """Where a robot's body fits: int8 [H, W], -1 unknown, 0 free, 100 occupied."""
        return self._mapper.navigation_grid()

    def plan_evidence(self) -> PlanEvidence:
        """The map of the robot's floor from above. Costs a pass over the grid."""
        return self._mapper.plan_evidence()

    def snapshot(self) -> GraphSnapshot:
        """The graph as it stands."""
        return self._graph.snapshot()

    def arrays(self) -> Mapping[str, InstanceArrays]:
        """Points and embeddings of all instances by id; a copy that later steps don't change. Costs a look at each."""
        return self._builder.all_arrays()

    def find_arrays(self, instance_id: str) -> InstanceArrays | None:
        """Points and embedding of one instance, None when there is none."""
        return self._builder.find_arrays(instance_id)

    # ------------------------------------------------------------------------------------------------ operators
    def edit(self, request: Request) -> tuple[Edit, GraphDelta]:
        """What an operator asks for, at once, and the step of the graph that holds it. EditError when it can't be done."""
        return self._applied(*self._builder.edit(request, self._stamp_ns, self._memory.take_id))

    def undo(self) -> tuple[Edit, GraphDelta]:
        """Takes back the last edit that stands. EditError when none does."""
        return self._applied(*self._builder.undo(self._stamp_ns))

    def edits(self) -> tuple[Edit, ...]:
        """The journal, undone edits included, oldest first."""
        return self._builder.edits

    def prototypes(self) -> tuple[Prototype, ...]:
        """What operators taught and did not let be forgotten."""
        return self._builder.prototypes()

    def take_record(self) -> Record:
        """What the steps since the last call leave on disk beside their deltas."""
        return self._builder.take_record({"I": self._memory.next_id, "R": self._room_stage.next_id})

    def whole(self) -> StoredMap:
        """Everything that the store keeps of the map as it is now."""
        record = self._builder.whole_record({"I": self._memory.next_id, "R": self._room_stage.next_id})
        beneath = {node_id: value for node_id, value in record.beneath.items() if value is not None}
        return StoredMap(
            self._graph.snapshot(),
            self._builder.all_arrays(),
            record.edits,
            beneath,
            record.next_ids,
            taught=record.prototypes,
        )

    def restore(self, stored: StoredMap) -> None:
        """Take up a stored graph, before the first step: ids, rooms and instances go on; the voxels are seen anew.

        The caller answers for the frame: the robot's odometry must start where it started when the graph was made.
        """
        snapshot = stored.snapshot
        self._builder.restore(snapshot, stored.arrays, stored.edits, stored.taught, stored.beneath)
        self._graph = SceneGraph.from_snapshot(snapshot)
        self._stamp_ns = snapshot.stamp_ns
        self._room_stage.restore(
            [number_of(room.id) for room in snapshot.rooms],
            [footprint_of(room) for room in snapshot.rooms],
            [opening_of(door) for door in snapshot.doors],
        )
        self._room_stage.reserve(stored.next_ids.get("R", 1))
        states = self._builder.states_beneath()
        there = [state for state in states if state.state != "gone"]
        self._memory.restore([state for state in there if state.observations or self._allround is None])
        if self._allround is not None:
            self._allround.restore([state for state in there if not state.observations])
        self._memory.reserve(max([stored.next_ids.get("I", 1), *(number_of(n.id) + 1 for n in snapshot.instances)]))
        # What was told of as gone has no one left who would end it.
        self._over = tuple(state.id for state in states if state.state == "gone")

    def go_on_from(self, seq: int) -> None:
        """The graph of now counts as revision ``seq``: it takes the place of another one."""
        self._builder.seq = seq
        self._graph = SceneGraph.from_snapshot(replace(self._graph.snapshot(), seq=seq))

    @property
    def map_T_odom(self) -> Pose:
        """Where the odometry's frame lies in the map now."""
        return self._localiser.map_T_odom

    def begin_at(self, map_T_odom: Pose) -> None:
        """Where the odometry's frame lies in a stored map, before its first step."""
        self._localiser.begin_at(map_T_odom)

    def learn(self, taught: Mapping[int, Prototype]) -> None:
        """What was taught on earlier maps, for a map that begins."""
        self._builder.learn(taught)

    def _applied(self, edit: Edit, delta: GraphDelta) -> tuple[Edit, GraphDelta]:
        self._graph.apply(delta)
        return edit, delta

    def counters(self) -> dict[str, int]:
        """Everything that was dropped, refused or evicted inside the stages, by name."""
        seen = self._lookout.counters() if self._lookout is not None else {}
        return {**self._localiser.counters(), **self._mapper.counters(), **seen}

    def _must_see(self, stamp_ns: int) -> bool:
        """The shipped eyes rest while a detector is heard; models that somebody chose see in any case. None where it is private."""
        return self.pictures_allowed and (self._allround is None or self._company.alone(stamp_ns))

    def _follow_rooms(self, frame: SyncedFrame) -> bool:
        """Every sweep, unless the budget is so short that even rooms must wait: then False."""
        self._sweeps_without_rooms += 1
        if self._lookout is not None and self._sweeps_without_rooms < self._lookout.eyes.rooms_every:
            return False
        self._sweeps_without_rooms = 0
        x, y = frame.map_T_base[:2, 3].tolist()
        self._rooms = self._room_stage.follow(self._mapper, (x, y))
        return True

    def _observe_answers(self, ms: dict[str, float]) -> None:
        """What the eyes have seen meanwhile, lifted with the pose and the map of the time of its picture."""
        for result in self._lookout.answers() if self._lookout is not None else ():
            job = result.job
            view = replace(job.view, detections=result.detections, image=None)
            self._observe(view, job.points_map, job.structure, ms)

    def _observe(
        self, view: CameraView, points: NDArray[np.float32], structure: NDArray[np.uint8], ms: dict[str, float]
    ) -> None:
        with _timed(ms, "lift"):
            lifted = lift(view, points, structure, self._settings.lift)
        with _timed(ms, "fusion"):
            self._memory.observe(view, lifted, self._rooms)

    def _commit(self, stamp_ns: int, ms: dict[str, float]) -> GraphDelta | None:
        with _timed(ms, "fusion"):
            self._memory.follow_rooms(self._rooms)
            instances = self._memory.collect(stamp_ns)
            if self._over:
                instances, self._over = replace(instances, ended=(*self._over, *instances.ended)), ()
        if self._allround is not None:
            with _timed(ms, "parts"):
                alone, taught = self._company.alone(stamp_ns), self._builder.prototypes()
                instances = self._allround.join(instances, self._rooms, stamp_ns, alone=alone, taught=taught)
        with _timed(ms, "graph"):
            delta = self._builder.build(self._rooms, instances, stamp_ns)
            if delta is not None:
                self._graph.apply(delta)
        return delta


@contextmanager
def _timed(stage_ms: dict[str, float], stage: str) -> Iterator[None]:
    """Add the wall milliseconds of a block to its stage."""
    start_ns = time.perf_counter_ns()
    yield
    stage_ms[stage] = stage_ms.get(stage, 0.0) + (time.perf_counter_ns() - start_ns) / 1e6
