"""Settings of the bridge, and the only YAML of nav_bridge: its configuration file and descriptions of occupancy maps."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from irsd.core.errors import ConfigError
from irsd.core.settings import build, setting
from irsd.io.endpoints import ZenohSettings
from nav_bridge.approach import ApproachSettings
from nav_bridge.drive import DriveSettings
from nav_bridge.evidence import EvidenceSettings
from nav_bridge.geofence import GeofenceSettings, parse_rule
from nav_bridge.monitor import MonitorSettings
from nav_bridge.reader import ReaderSettings
from nav_bridge.resolve import ResolveSettings
from nav_bridge.route import RouteSettings
from nav_bridge.sinks.ned import MavlinkSettings

SYSTEM_FILE = Path("/etc/irsd/nav_bridge.yaml")
ENVIRONMENT = "NAV_BRIDGE_CONFIG"


@dataclass(frozen=True, slots=True)
class SinkSettings:
    """Who is told where to drive, besides irs/<robot>/nav/waypoints, nav/path and nav/goal_pose."""

    goal_topic: str = setting("", "ROS topic for the goal as PoseStamped, such as /goal_pose; empty = none")
    path_topic: str = setting("", "ROS topic for the way as nav_msgs/Path; empty = none")
    action: str = setting(
        "none", "Nav2's action that drives the robot", choices=("none", "navigate_to_pose", "follow_path")
    )
    action_name: str = setting("", "name of the action, where it is not the usual one")
    progress_checker: bool = setting(True, "follow_path has the field progress_checker_id: all of Nav2 but Humble's")
    form: str = setting("bridge", "how ROS hears us: zenoh-bridge-ros2dds or rmw_zenoh", choices=("bridge", "rmw"))
    namespace: str = setting("", "namespace of zenoh-bridge-ros2dds, if it has one")
    domain: int = setting(0, "ROS domain, for rmw", lo=0, hi=232)
    mavlink: MavlinkSettings = field(default_factory=MavlinkSettings)


@dataclass(frozen=True, slots=True)
class BridgeSettings:
    """All settings of nav_bridge; every key may be left out."""

    robot: str = setting("robot", "name of the robot, the second part of every key")
    odom_topic: str = setting("/odom", "ROS topic with the robot's odometry")
    odom_namespace: str = setting("", "namespace of zenoh-bridge-ros2dds on the input side, if it has one")
    state_directory: str = setting(
        "",
        "keeps the goal under way; empty: $STATE_DIRECTORY (systemd), else $XDG_STATE_HOME/irsd or ~/.local/state/irsd",
    )
    reply_timeout_s: float = setting(3.0, "how long irsd may take to answer a question", lo=0.1, hi=60.0)
    zenoh: ZenohSettings = field(default_factory=ZenohSettings)
    reader: ReaderSettings = field(default_factory=ReaderSettings)
    evidence: EvidenceSettings = field(default_factory=EvidenceSettings)
    resolve: ResolveSettings = field(default_factory=ResolveSettings)
    approach: ApproachSettings = field(default_factory=ApproachSettings)
    route: RouteSettings = field(default_factory=RouteSettings)
    monitor: MonitorSettings = field(default_factory=MonitorSettings)
    drive: DriveSettings = field(default_factory=DriveSettings)
    geofence: GeofenceSettings = field(default_factory=GeofenceSettings)
    sinks: SinkSettings = field(default_factory=SinkSettings)


@dataclass(frozen=True, slots=True)
class MapFile:
    """What a map_server description says: picture file, metres per pixel, map coordinates of the lower left corner."""

    image: Path
    resolution_m: float
    origin_xy_m: tuple[float, float]


def find_settings(given: Path | None) -> Path | None:
    """The file to read: the one given, else $NAV_BRIDGE_CONFIG, else /etc/irsd/nav_bridge.yaml where it exists, else None."""
    named = os.environ.get(ENVIRONMENT)
    if given is not None or named:
        return given or Path(str(named))
    return SYSTEM_FILE if SYSTEM_FILE.is_file() else None


def load_settings(path: Path | None) -> BridgeSettings:
    """The settings in a YAML file, or the defaults for None. ConfigError lists every problem found."""
    if path is None:
        return BridgeSettings()
    settings, problems = build(BridgeSettings, _mapping(path))
    if settings is None:
        raise ConfigError(f"{path}: " + "; ".join(problems))
    for rule in settings.geofence.rules:
        parse_rule(rule)
    return settings


def state_file(settings: BridgeSettings) -> Path | None:
    """Where the goal under way is kept, None where none is to be resumed."""
    if settings.drive.resume_s <= 0:
        return None
    base = os.environ.get("XDG_STATE_HOME")
    home = (Path(base) if base else Path.home() / ".local" / "state") / "irsd"
    named = settings.state_directory or os.environ.get("STATE_DIRECTORY", "").split(":")[0]
    return (Path(named).expanduser() if named else home) / settings.robot / "goal.json"


def load_map_file(path: Path) -> MapFile:
    """A map_server description. ConfigError says what is wrong with it."""
    document = _mapping(path)
    try:
        origin = document["origin"]
        image, resolution = str(document["image"]), float(document["resolution"])
        x, y, yaw = float(origin[0]), float(origin[1]), float(origin[2]) if len(origin) > 2 else 0.0
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise ConfigError(f"{path}: not a map_server description ({error!r})") from error
    if not (resolution > 0 and math.isfinite(resolution)) or yaw != 0.0:
        raise ConfigError(
            f"{path}: resolution = {resolution}, yaw = {yaw}: needs a resolution above 0 and an unturned map"
        )
    return MapFile(path.parent / image, resolution, (x, y))


def _mapping(path: Path) -> Mapping[str, Any]:
    try:
        document = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"{path} can't be read: {error}") from error
    except yaml.YAMLError as error:
        raise ConfigError(f"{path} is no YAML: {error}") from error
    if document is None:
        return {}
    if not isinstance(document, Mapping):
        raise ConfigError(f"{path}: must hold keys and values")
    return document
