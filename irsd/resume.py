"""Are the scans of the place that is in the map, in its frame? At a start, after a jump of the odometry, and when an operator asks.

Until that is clear, nothing is merged. Odometry may go on where it was, with the drift that was found in it, or begin anew where the
map began: whichever fits. Or the place of its frame is looked for in the whole plan: at a start where the settings say so, after a
jump, and when an operator asks.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from typing import NamedTuple, Protocol

import numpy as np

from irsd.core.geometry import Pose, farthest_step, invert, yaw_of
from irsd.core.runtime import Cell
from irsd.core.types import Plan, PlanEvidence, SyncedFrame
from irsd.mapping.localise import moved
from irsd.mapping.mapper import Mapper, MappingSettings
from irsd.mapping.relocalise import Near, find_place
from irsd.plans import CORRECTION, PLAN, SHARED_M2, Agreement, compare, plan_from_bytes, plan_of, pose_from_bytes

_log = logging.getLogger(__name__)

_LOOKS = 5  # sweeps before the first verdict
_AGAIN_EVERY, _LAST_LOOK = 10, 300  # sweeps between the later ones, and after which it is left to the operator
_SEARCH_EVERY = 80  # sweeps between two searches at most: they come after 5, 10, 20, 40, ... sweeps
_OFF_M, _OFF_RAD = 1.5, 0.6  # by how much an operator's word of the place may be off


class Present(Protocol):
    """The map that frames go into; ``MapPipeline`` is one."""

    @property
    def map_T_odom(self) -> Pose: ...

    def plan_evidence(self) -> PlanEvidence: ...


class _Verdict(NamedTuple):
    """How what was seen fits, map_T_odom with which it does, and why it is not believed all the same (empty: it is, if it fits)."""

    fit: Agreement
    start: Pose
    doubt: str


class Resumption:
    """Keeps frames from a map until they are known to be of it. ``problem`` and ``trusted`` are for all, the rest is the map's."""

    def __init__(
        self, settings: MappingSettings, geometry: Mapping[str, bytes], *, search: bool, max_speed_mps: float
    ) -> None:
        """geometry: of the stored map; without a plan in it there is nothing to compare, and every frame is admitted.

        search: where the first scans do not fit, look for the robot in the whole plan. max_speed_mps: odometry that moves faster has
        jumped.
        """
        self._settings, self._search_then, self._max_speed_mps = settings, search, max_speed_mps
        self._problem = Cell("")
        self._stored: list[Plan] = []
        self._maps: list[
            tuple[Pose, Mapper]
        ] = []  # of the sweeps since, from each start in question; the last from odometry's
        self._fallback: Pose | None = None
        self._search, self._only_search = search, False
        self._at: tuple[float, float, float] | None = None
        self._start: Pose | None = None
        self._waiting: list[SyncedFrame] = []
        self._looks, self._search_at = 0, _LOOKS
        self._before: SyncedFrame | None = None
        self.held = 0
        self.begin(geometry)

    def begin(self, geometry: Mapping[str, bytes]) -> None:
        """The check anew, against another map."""
        stored = [plan_from_bytes(value) for name, value in geometry.items() if name.startswith(PLAN)]
        starts = [pose_from_bytes(geometry[CORRECTION])] if CORRECTION in geometry else []
        if not starts or not np.allclose(starts[0], np.eye(4), atol=1e-3):
            starts.append(np.eye(4))
        self._begin_again(stored, starts)
        self._fallback = starts[0]
        self._search, self._only_search, self._at = self._search_then, False, None
        self._problem.set("")

    def seek(self, present: Present, at: tuple[float, float, float] | None = None) -> None:
        """Forget where the robot is, and look for it: in the present map, or in the stored one that the scans did not fit so far.

        at: about where it is in the map, as an operator says: x, y (metres) and yaw (rad).
        """
        if self._maps:
            self._begin_again(self._stored, [np.eye(4)])
        else:
            self._fallback = None  # should it be called off, the robot is where it was
            self._begin_again([plan_of(present.plan_evidence())], [np.eye(4)])
        self._search, self._only_search, self._at = True, True, at
        self._problem.set("the robot is being looked for in the map")

    def accept(self) -> None:
        """The operator says that it is the place, in the stored frame."""
        if self._maps:
            self._start = self._fallback
        self._maps, self._waiting = [], []
        self._problem.set("")

    @property
    def trusted(self) -> bool:
        """Whether frames go into the map."""
        return not self._maps

    @property
    def problem(self) -> str:
        """Why frames are held back; empty while they are not, or while it is not known yet."""
        return self._problem.get()

    def take_start(self) -> Pose | None:
        """map_T_odom that the next admitted frames begin with; told once, when it has been found out."""
        start, self._start = self._start, None
        return start

    def admit(self, frame: SyncedFrame, present: Present) -> list[SyncedFrame]:
        """The frames that may go into the present map now, in order. A search in a large plan takes seconds."""
        before, self._before = self._before, frame
        if not self._maps and before is not None and self._jumped(before, frame):
            self._doubt(present)
        if not self._maps:
            return [frame]
        self._looks += 1
        if self._looks <= _LAST_LOOK or self._search:
            for start, scratch in self._maps:
                scratch.integrate(moved(frame, start))
            if self._looks <= _LOOKS:
                self._waiting.append(frame)
            if self._looks == _LOOKS or (self._looks > _LOOKS and self._looks % _AGAIN_EVERY == 0):
                verdict = self._judge(frame)
                if verdict is not None and verdict.fit.good and not verdict.doubt:
                    return self._go_on(frame, verdict)
                self._waiting = []
                if verdict is not None:
                    self._tell(verdict)
        self.held += self._looks > _LOOKS
        return []

    def _jumped(self, before: SyncedFrame, frame: SyncedFrame) -> bool:
        step = invert(before.map_T_base) @ frame.map_T_base
        passed_s = max(frame.stamp_ns - before.stamp_ns, 0) * 1e-9
        most_m, most_rad = farthest_step(passed_s, self._max_speed_mps)
        return float(np.hypot(*step[:2, 3])) > most_m or abs(yaw_of(step)) > most_rad

    def _doubt(self, present: Present) -> None:
        """Odometry has jumped: to where the robot is now (a gap in it), or because it began anew. A map of nothing can't tell."""
        plan = plan_of(present.plan_evidence())
        if float(plan.free.sum()) * plan.frame.resolution_m**2 < 2 * SHARED_M2:
            return
        self._fallback = present.map_T_odom
        self._begin_again([plan], [present.map_T_odom, np.eye(4)])
        self._search, self._only_search, self._at = True, False, None
        self._problem.set("odometry has jumped: whether the robot is where it says is being looked at")

    def _begin_again(self, stored: list[Plan], starts: list[Pose]) -> None:
        self._stored = stored
        self._maps = [(start, Mapper(self._settings, None)) for start in starts] if stored else []
        self._start, self._waiting = None, []
        self._looks, self._search_at = 0, _LOOKS

    def _go_on(self, frame: SyncedFrame, verdict: _Verdict) -> list[SyncedFrame]:
        _log.info("this is the stored map: %.0f %% of the walls fit", 100 * verdict.fit.walls)
        ready = self._waiting if self._looks == _LOOKS else [frame]
        self._maps, self._waiting, self._start = [], [], verdict.start
        self._problem.set("")
        return ready

    def _judge(self, frame: SyncedFrame) -> _Verdict | None:
        """None: nothing was looked into."""
        verdict = None
        if not self._only_search:
            verdicts = [_Verdict(compare(*self._plans(scratch)), start, "") for start, scratch in self._maps]
            verdict = max(verdicts, key=lambda each: each.fit.walls)
        if not self._search or self._looks < self._search_at or (verdict is not None and verdict.fit.good):
            return verdict
        self._search_at = self._looks + min(self._looks, _SEARCH_EVERY)
        return self._find(frame)

    def _find(self, frame: SyncedFrame) -> _Verdict:
        """The best place for what was seen in the whole plan of the floor. The last of the maps is in the odometry's frame."""
        now, stored = self._plans(self._maps[-1][1])
        near = None
        if self._at is not None:
            x, y, yaw = self._at
            near = Near(x, y, _OFF_M, yaw - yaw_of(frame.map_T_base), _OFF_RAD)
        robot_x, robot_y = frame.map_T_base[:2, 3].tolist()
        found = find_place(now, (robot_x, robot_y), stored, near)
        return _Verdict(compare(now, stored, found.stored_T_now), found.stored_T_now, found.refused)

    def _plans(self, scratch: Mapper) -> tuple[Plan, Plan]:
        """What was seen, and the stored floor that it is of."""
        now = plan_of(scratch.plan_evidence())
        return now, min(self._stored, key=lambda plan: abs(plan.floor_z_m - now.floor_z_m))

    def _tell(self, verdict: _Verdict) -> None:
        fit = verdict.fit
        if verdict.doubt:
            text = f"the robot is not found in the map: {verdict.doubt}"
        elif fit.enough:
            text = (
                f"the scans do not fit the stored map ({100 * fit.walls:.0f} % of the walls lie on its walls, "
                f"{100 * fit.blocked:.0f} % of the free floor too)"
            )
        else:
            text = f"the scans are of no part of the stored map ({fit.shared_m2:.1f} m2 in common)"
        if text.split("(")[0] != self._problem.get().split("(")[0]:
            _log.warning("%s: nothing is merged until it fits, or irsctl relocalise or irsctl map decides", text)
        self._problem.set(text)
