"""The configuration: defaults that are documented, every problem named, nothing corrected in silence."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import pytest
import yaml

from irsd.config import (
    IrsdConfig,
    StoreSettings,
    as_mapping,
    find_config,
    load_config,
    load_yaml_mapping,
    render_yaml,
    state_directory,
)
from irsd.core.errors import ConfigError

SHIPPED = Path(__file__).resolve().parents[2] / "config" / "irsd.yaml"


def write(folder: Path, text: str) -> Path:
    path = folder / "irsd.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_an_empty_file_is_the_defaults(tmp_path: Path) -> None:
    assert load_config(write(tmp_path, "")) == IrsdConfig() == load_config(None)
    assert load_config(write(tmp_path, "zenoh:\nsync:\n")) == IrsdConfig()


def test_the_shipped_file_is_the_defaults_and_names_every_key() -> None:
    assert SHIPPED.read_text(encoding="utf-8") == render_yaml(IrsdConfig()), (
        "config/irsd.yaml is not what the settings say: write render_yaml(IrsdConfig()) to it"
    )
    assert load_config(SHIPPED) == IrsdConfig()
    assert load_yaml_mapping(SHIPPED) == as_mapping(IrsdConfig())


def settings_of(config: Any, path: str = "") -> list[tuple[str, dataclasses.Field[Any]]]:
    out = []
    for field in dataclasses.fields(config):
        value = getattr(config, field.name)
        key = f"{path}.{field.name}" if path else field.name
        out += settings_of(value, key) if dataclasses.is_dataclass(value) else [(key, field)]
    return out


@pytest.mark.parametrize(("key", "field"), settings_of(IrsdConfig()), ids=lambda v: v if isinstance(v, str) else "")
def test_every_key_says_what_it_means(key: str, field: dataclasses.Field[Any]) -> None:
    assert field.metadata.get("doc"), f"{key} has no meaning written down"


def test_every_problem_is_named_with_file_key_value_and_range(tmp_path: Path) -> None:
    path = write(
        tmp_path,
        "robot: bot\nzenho: {}\nzenoh: {open_timeout_s: -1, multicast: 3}\n"
        "health: {status_period_s: fast}\ningest: {form: dds, lidar_queue: 0}\n",
    )
    with pytest.raises(ConfigError) as caught:
        load_config(path)
    text = str(caught.value)
    assert str(path) in text
    for part in (
        "6 problem(s)",
        "zenho = {}: unknown key",
        "zenoh.open_timeout_s = -1: must be in 0.0 .. 600.0",
        "zenoh.multicast = 3: must be true or false",
        "health.status_period_s = 'fast': must be a number",
        "ingest.form = 'dds': must be one of auto, bridge, rmw",
        "ingest.lidar_queue = 0: must be in 1 .. 1000",
    ):
        assert part in text


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("robot: a/b", "robot"),
        ("ingest: {lidar_topic: 'bad topic'}", "ROS topic"),
        ("ingest: {lidar_topic: /odom}", "/odom is given for more than one input"),
        ("robot: a\nrobot: b", "given twice"),
        ("zenoh: {multicast: true, multicast: false}", "given twice"),
        ("- a list", "keys and values"),
        ("zenoh: [1, 2]", "section"),
        ("robot: [", "not YAML"),
        ("robot: !!python/object:os.system x", "not YAML"),
    ],
)
def test_what_is_refused(tmp_path: Path, text: str, says: str) -> None:
    path = write(tmp_path, text)
    with pytest.raises(ConfigError, match=says) as caught:
        load_config(path)
    assert str(path) in str(caught.value)


def test_a_missing_or_binary_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="can't be read"):
        load_config(tmp_path / "nothing.yaml")
    binary = tmp_path / "binary.yaml"
    binary.write_bytes(b"\xff\xfe\x00\x01")
    with pytest.raises(ConfigError, match="can't be read"):
        load_config(binary)


def test_values_arrive_in_their_sections(tmp_path: Path) -> None:
    config = load_config(write(tmp_path, "robot: r2\npipeline: {pace: {graph_period_s: 2}}\nzenoh: {connect: []}\n"))
    assert config.robot == "r2"
    assert config.pipeline.pace.graph_period_s == 2.0
    assert config.zenoh.connect == ()
    assert load_config(write(tmp_path, render_yaml(config))) == config


def test_order_of_search(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    given, named, system = tmp_path / "a.yaml", tmp_path / "b.yaml", tmp_path / "c.yaml"
    monkeypatch.setattr("irsd.config.SYSTEM_FILE", system)
    monkeypatch.delenv("IRSD_CONFIG", raising=False)
    assert find_config(None) is None
    system.touch()
    assert find_config(None) == system
    monkeypatch.setenv("IRSD_CONFIG", str(named))
    assert find_config(None) == named  # even if it is not there: better an error than another file in silence
    assert find_config(given) == given


def test_where_the_map_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("STATE_DIRECTORY", raising=False)
    monkeypatch.setenv("XDG_STATE_HOME", "/x")
    assert state_directory(StoreSettings()) == Path("/x/irsd")
    monkeypatch.setenv("STATE_DIRECTORY", "/var/lib/irsd:/other")
    assert state_directory(StoreSettings()) == Path("/var/lib/irsd")
    assert state_directory(StoreSettings(directory="/data")) == Path("/data")


def test_the_rendered_file_is_plain_yaml() -> None:
    assert isinstance(yaml.safe_load(render_yaml(IrsdConfig())), dict)


def test_models_by_licence_and_provider(tmp_path: Path) -> None:
    models = load_config(write(tmp_path, "models: {accept_license: apple-ascl, providers: [openvino, cpu]}\n")).models
    assert models.accepted == ("apple-ascl",)
    assert load_config(write(tmp_path, "models: {accept_license: [a, b]}\n")).models.accepted == ("a", "b")
    with pytest.raises(ConfigError, match=r"models.providers = \['abacus'\]: must be some of tensorrt, cuda"):
        load_config(write(tmp_path, "models: {providers: [abacus]}\n"))
