"""Which sinks are told where to drive, by configuration."""

from __future__ import annotations

from irsd.io.keys import RobotKeys
from irsd.io.session import Session
from nav_bridge.config import BridgeSettings
from nav_bridge.sinks.base import Sink
from nav_bridge.sinks.guard import Guard
from nav_bridge.sinks.nav2 import Nav2Sink
from nav_bridge.sinks.ros2 import RosSink
from nav_bridge.sinks.zenoh import ZenohSink


def open_sinks(session: Session, keys: RobotKeys, settings: BridgeSettings) -> tuple[Sink, ...]:
    """The sinks that the settings ask for; our own key always."""
    chosen = settings.sinks
    sinks: list[Sink] = [ZenohSink(session, keys), RosSink(session, chosen)]
    if chosen.action != "none":
        sinks.append(Nav2Sink(session, chosen, Guard(chosen, settings.zenoh)))
    if chosen.mavlink.url:
        from nav_bridge.sinks.mavlink import MavlinkSink  # noqa: PLC0415  takes 0.2 s and 14 MB

        sinks.append(MavlinkSink(chosen.mavlink))
    return tuple(sinks)
