"""A MAVLink vehicle (PX4, ArduPilot) by offboard position setpoints. The only import of mavsdk.

MAVSDK repeats the last setpoint by itself, so a hung planner would not stop the vehicle: a thread of its own watches the age of
the last heartbeat and puts the vehicle on hold. It never arms unless it is configured to, never leaves the height it found, and
gives up for good when the pilot takes over.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import Any

from mavsdk import ComponentType, Configuration, Mavsdk, MavsdkError
from mavsdk.plugins.action import Action
from mavsdk.plugins.offboard import Offboard, PositionNedYaw
from mavsdk.plugins.telemetry import Telemetry

from irsd.core.runtime import Cell, Stopper, Worker, monotonic_s
from nav_bridge.sinks.base import Plan
from nav_bridge.sinks.ned import Follower, MavlinkSettings, from_ned, to_ned

_log = logging.getLogger(__name__)

_PERIOD_S = 0.05
_CONNECT_S = 3.0
_JOIN_S = 10.0


@dataclass(frozen=True, slots=True)
class _Order:
    """The last plan and when it was last said to hold."""

    plan: Plan
    beat_s: float


@dataclass(frozen=True, slots=True)
class _Place:
    """Where the vehicle was in its local frame, and when it said so."""

    north_m: float
    east_m: float
    down_m: float
    heard_s: float


class MavlinkSink:
    """Flies or drives a vehicle along plans. send, beat, trouble, close: from one thread; MAVSDK is spoken to by another."""

    def __init__(self, settings: MavlinkSettings) -> None:
        self._settings = settings
        self._order: Cell[_Order | None] = Cell(None)
        self._place: Cell[_Place | None] = Cell(None)
        self._armed: Cell[bool | None] = Cell(None)
        self._trouble: Cell[str] = Cell(f"no vehicle at {settings.url} yet")
        self._stopper = Stopper()
        self._worker = Worker("mavlink", self._run, lambda error: self._trouble.set(f"internal error: {error}")).start()

    def send(self, plan: Plan) -> None:
        self._order.set(_Order(plan, monotonic_s()))

    def beat(self, plan: Plan) -> None:
        order = self._order.get()
        if order is not None and (order.plan.goal_id, order.plan.seq) == (plan.goal_id, plan.seq):
            self._order.set(_Order(order.plan, monotonic_s()))

    def trouble(self) -> str:
        return self._trouble.get()

    def close(self) -> None:
        """Puts the vehicle on hold if it follows a plan of ours, and ends the link."""
        self._stopper.request("closed")
        if not self._worker.join(_JOIN_S):
            _log.warning("the vehicle did not answer in time while the link was closed")

    # ---------------------------------------------------------------------------------------------- on the own thread
    def _run(self) -> None:
        configuration = Configuration.create_with_component_type(ComponentType.COMPANION_COMPUTER)
        mavsdk = Mavsdk(configuration)
        try:
            mavsdk.add_any_connection(self._settings.url)
            system: Any = None
            while system is None and not self._stopper.requested:
                system = mavsdk.first_autopilot(_CONNECT_S)
            if system is not None:
                self._serve(system)
        finally:
            mavsdk.destroy()
            configuration.destroy()

    def _serve(self, system: Any) -> None:
        """Until the stop: follow the order of the moment, or hold."""
        telemetry = Telemetry(system)
        telemetry.subscribe_position_velocity_ned(self._hear)
        telemetry.subscribe_armed(lambda armed, _: self._armed.set(armed))
        pilot = _Pilot(system, self._settings)
        _log.info("vehicle at %s", self._settings.url)
        while not self._stopper.wait(_PERIOD_S):
            state = pilot.step(self._order.get(), self._place.get(), self._armed.get(), monotonic_s())
            self._trouble.set(state)
        pilot.hold("nav_bridge stops")

    def _hear(self, update: Any, _: Any) -> None:
        """On MAVSDK's thread."""
        at = update.position
        self._place.set(_Place(at.north_m, at.east_m, at.down_m, monotonic_s()))


class _Pilot:
    """Turns orders into setpoints and modes."""

    def __init__(self, system: Any, settings: MavlinkSettings) -> None:
        self._offboard = Offboard(system)
        self._action = Action(system)
        self._settings = settings
        self._driven: tuple[str, int] | None = None  # the plan the follower is of
        self._follower: Follower | None = None
        self._down_m = 0.0
        self._active = False
        self._refused = ""  # why the plan in _driven is not driven any more

    def step(self, order: _Order | None, place: _Place | None, armed: bool | None, now_s: float) -> str:
        """One turn; why the vehicle can't follow, "" if it can. place, armed: None as long as the vehicle has not told."""
        if place is None or now_s - place.heard_s > self._settings.link_timeout_s:
            self.hold("the link is lost")
            return "the link to the vehicle is lost" if place is not None else "the vehicle does not say where it is"
        if armed is None:
            return "the vehicle does not say whether it is armed"
        if order is None or not order.plan.waypoints:
            self.hold("stop")
            return ""
        name = (order.plan.goal_id, order.plan.seq)
        if name != self._driven:
            self._driven, self._refused = name, ""
            self._follower = Follower(order.plan.waypoints, self._settings.accept_m)
        if now_s - order.beat_s > order.plan.valid_s:
            self.hold("the plan is stale")
            return ""
        if self._refused or self._follower is None:
            return self._refused
        x, y, _ = from_ned(place.north_m, place.east_m, 0.0, self._settings)
        north, east, heading = to_ned(self._follower.setpoint((x, y)), self._settings)
        try:
            if not self._active:
                self._begin(place, armed)
            elif not self._offboard.is_active():
                self._active = False
                self._refused = "the pilot has taken over"
                return self._refused
            if self._active:
                self._offboard.set_position_ned(PositionNedYaw(north, east, self._down_m, heading))
        except MavsdkError as error:
            self._refused = f"the vehicle refused: {error}"
            self.hold("it refused")
        return self._refused

    def _begin(self, place: _Place, armed: bool) -> None:
        """Offboard mode, from a setpoint at the place where the vehicle is."""
        if not armed:
            if not self._settings.arm:
                self._refused = "the vehicle is not armed, and nav_bridge may not arm it"
                return
            self._action.arm()
        self._down_m = place.down_m
        _, _, heading = to_ned((0.0, 0.0, 0.0), self._settings)
        self._offboard.set_position_ned(PositionNedYaw(place.north_m, place.east_m, place.down_m, heading))
        self._offboard.start()
        self._active = True

    def hold(self, why: str) -> None:
        """The vehicle's own hold mode; setpoints end with it. Nothing where the vehicle does not follow us anyway."""
        if not self._active:
            return
        self._active = False
        _log.info("vehicle holds: %s", why)
        try:
            self._offboard.stop()
        except MavsdkError as error:
            _log.warning(
                "hold was not confirmed (%s); setpoints have ended, the vehicle's own failsafe holds it", error
            )
