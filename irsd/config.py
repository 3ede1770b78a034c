"""irsd's configuration: one section per stage, read from YAML, checked whole, refused with every problem named.

All keys are optional; the defaults run. The only module of irsd that imports yaml. ``config/irsd.yaml`` is what
``render_yaml`` makes of the defaults, so it can't fall behind.
"""

from __future__ import annotations

import dataclasses
import os
import textwrap
import typing
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from irsd.core.errors import ConfigError
from irsd.core.settings import build, setting
from irsd.graph.builder import GraphSettings
from irsd.health import HealthSettings
from irsd.ingest import IngestSettings, topics_of
from irsd.instances.lift import LiftSettings
from irsd.instances.memory import FusionSettings
from irsd.instances.part import ProposalSettings
from irsd.io.endpoints import ZenohSettings
from irsd.io.keys import check_robot_name
from irsd.mapping.localise import LocaliseSettings
from irsd.mapping.mapper import MappingSettings
from irsd.perception.assemble import ModelSettings, check_models
from irsd.perception.budget import BudgetSettings
from irsd.perception.settings import PerceptionSettings, check_perception
from irsd.privacy import PrivacySettings
from irsd.record import RecordSettings
from irsd.rooms.stage import RoomSettings
from irsd.sensors.sync import SyncSettings
from irsd.sensors.watch import WatchSettings

SYSTEM_FILE = Path("/etc/irsd/irsd.yaml")
ENVIRONMENT = "IRSD_CONFIG"
_COMMENT_COLUMNS = 110


@dataclass(frozen=True)
class PaceSettings:
    """How often the graph is brought up to date, in sensor time."""

    graph_period_s: float = setting(0.5, "graph deltas are made at most this often", lo=0.0)


@dataclass(frozen=True)
class PipelineSettings:
    """What turns sensors into the graph; a stage sees only its own section."""

    pace: PaceSettings = field(default_factory=PaceSettings)
    localise: LocaliseSettings = field(default_factory=LocaliseSettings)
    mapping: MappingSettings = field(default_factory=MappingSettings)
    rooms: RoomSettings = field(default_factory=RoomSettings)
    lift: LiftSettings = field(default_factory=LiftSettings)
    fusion: FusionSettings = field(default_factory=FusionSettings)
    proposals: ProposalSettings = field(default_factory=ProposalSettings)
    graph: GraphSettings = field(default_factory=GraphSettings)


@dataclass(frozen=True)
class StoreSettings:
    """Where the map is kept between runs."""

    enabled: bool = setting(True, "keep the graph on disk and take it up again at the next start")
    directory: str = setting(
        "", "state directory; empty: $STATE_DIRECTORY (systemd), else $XDG_STATE_HOME/irsd or ~/.local/state/irsd"
    )
    on_start: str = setting(
        "same_frame",
        "same_frame: go on with the stored map, once the first scans fit it (odometry goes on where it was); "
        "relocalise: the same, and where they do not fit, look for the robot in the whole stored plan; "
        "new: begin an empty map, and keep the stored one as snapshot 'previous'",
        choices=("same_frame", "relocalise", "new"),
    )


@dataclass(frozen=True)
class IrsdConfig:
    """Everything that can be set."""

    robot: str = setting("robot", "name of the robot: the second part of all its keys, irs/<robot>/...")
    zenoh: ZenohSettings = field(default_factory=ZenohSettings)
    ingest: IngestSettings = field(default_factory=IngestSettings)
    sync: SyncSettings = field(default_factory=SyncSettings)
    pipeline: PipelineSettings = field(default_factory=PipelineSettings)
    perception: PerceptionSettings = field(default_factory=PerceptionSettings)
    models: ModelSettings = field(default_factory=ModelSettings)
    budget: BudgetSettings = field(default_factory=BudgetSettings)
    store: StoreSettings = field(default_factory=StoreSettings)
    record: RecordSettings = field(default_factory=RecordSettings)
    privacy: PrivacySettings = field(default_factory=PrivacySettings)
    health: HealthSettings = field(default_factory=HealthSettings)
    watch: WatchSettings = field(default_factory=WatchSettings)


class _StrictLoader(yaml.SafeLoader):
    """YAML's safe subset, and no key twice (YAML forbids it, PyYAML takes the last in silence)."""

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
        seen: set[Any] = set()
        for key_node, _ in node.value:
            key = self.construct_object(key_node, deep=True)
            if isinstance(key, str) and key in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f"the key {key!r} is given twice", key_node.start_mark
                )
            if isinstance(key, str):
                seen.add(key)
        return typing.cast(dict[Any, Any], super().construct_mapping(node, deep))


def load_yaml_mapping(path: Path) -> dict[str, Any]:
    """The keys and values of a YAML file; an empty file has none. ConfigError when it can't be read or is something else."""
    try:
        document = yaml.load(path.read_text(encoding="utf-8"), Loader=_StrictLoader)
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: can't be read: {error}") from error
    except yaml.YAMLError as error:
        raise ConfigError(f"{path}: is not YAML: {error}") from error
    if document is None:
        return {}
    if not isinstance(document, dict):
        raise ConfigError(f"{path}: must hold keys and values, holds {type(document).__name__}")
    return document


def find_config(given: Path | None) -> Path | None:
    """The file to read: the one given, else $IRSD_CONFIG, else /etc/irsd/irsd.yaml where it exists, else None (defaults)."""
    if given is not None:
        return given
    from_environment = os.environ.get(ENVIRONMENT)
    if from_environment:
        return Path(from_environment)
    return SYSTEM_FILE if SYSTEM_FILE.is_file() else None


def load_config(path: Path | None) -> IrsdConfig:
    """The configuration in a file (None: the defaults). ConfigError lists every unknown key, wrong type and value out of range."""
    if path is None:
        return IrsdConfig()
    config, problems = build(IrsdConfig, load_yaml_mapping(path))
    if config is not None:
        for check in (
            lambda: check_robot_name(config.robot),
            lambda: topics_of(config.ingest),
            lambda: check_perception(config.perception),
            lambda: check_models(config.models),
        ):
            try:
                check()
            except ConfigError as error:
                problems.append(str(error))
    if config is None or problems:
        raise ConfigError("\n  ".join([f"{path}: {len(problems)} problem(s)", *problems]))
    return config


def with_pictures(config: IrsdConfig) -> IrsdConfig:
    """The configuration for one who has eyes: pictures are received, and become views."""
    return dataclasses.replace(
        config,
        ingest=dataclasses.replace(config.ingest, images=True),
        sync=dataclasses.replace(config.sync, keep_images=True),
    )


def state_directory(settings: StoreSettings) -> Path:
    """Where to keep the map; see ``StoreSettings.directory``."""
    if settings.directory:
        return Path(settings.directory).expanduser()
    systemd = os.environ.get("STATE_DIRECTORY", "").split(":")[0]
    if systemd:
        return Path(systemd)
    base = os.environ.get("XDG_STATE_HOME")
    return (Path(base) if base else Path.home() / ".local" / "state") / "irsd"


# ------------------------------------------------------------------------------------------------------------ rendering
def render_yaml(config: Any) -> str:
    """A settings object as commented YAML: every key, its meaning and range, and its value."""
    head = "# irsd's settings, all with their default values; every key may be left out.\n"
    return head + "\n".join(_lines(config, 0)) + "\n"


def as_mapping(config: Any) -> dict[str, Any]:
    """A settings object as plain keys and values, as YAML would give them."""
    out: dict[str, Any] = {}
    for each in dataclasses.fields(config):
        value = getattr(config, each.name)
        if dataclasses.is_dataclass(value):
            out[each.name] = as_mapping(value)
        else:
            out[each.name] = _plain(value)
    return out


def _lines(config: Any, depth: int) -> Iterator[str]:
    indent = "  " * depth
    for each in dataclasses.fields(config):
        value = getattr(config, each.name)
        nested = dataclasses.is_dataclass(value)
        doc = (type(value).__doc__ or "").split("\n\n")[0] if nested else _meaning(each.metadata)
        if nested and depth == 0:
            yield ""
        yield from (f"{indent}# {line}" for line in textwrap.wrap(" ".join(doc.split()), _COMMENT_COLUMNS))
        if nested:
            yield f"{indent}{each.name}:"
            yield from _lines(value, depth + 1)
        else:
            scalar = yaml.safe_dump(_plain(value), default_flow_style=True, allow_unicode=True, width=10**6)
            yield f"{indent}{each.name}: {scalar.removesuffix('...' + chr(10)).strip()}"


def _meaning(metadata: Mapping[str, Any]) -> str:
    doc = str(metadata.get("doc", "")).strip()
    low, high, choices = metadata.get("lo"), metadata.get("hi"), metadata.get("choices")
    if choices is not None:
        return f"{doc} [{' | '.join(map(str, choices))}]"
    if low is None and high is None:
        return doc
    return f"{doc} [{'' if low is None else f'{low:g}'} .. {'' if high is None else f'{high:g}'}]"


def _plain(value: Any) -> Any:
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    return dict(value) if isinstance(value, Mapping) else value
