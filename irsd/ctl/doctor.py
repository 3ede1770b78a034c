"""irsctl doctor: looks at everything that must be right before irsd can work, and says of each thing what to do about it."""

from __future__ import annotations

import dataclasses
import json
import os
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from irsd.config import IrsdConfig, find_config, load_config, state_directory
from irsd.core.errors import ConfigError, IrsdError, ModelError
from irsd.ctl.doctor_topics import Level, listen, topic_reports
from irsd.ctl.link import Target
from irsd.health import disk_state
from irsd.io.endpoints import ZenohSettings, with_environment
from irsd.io.keys import any_robot, robot_of
from irsd.io.session import Session, open_session
from irsd.perception.assemble import ModelOpener
from irsd.perception.encoder import LabelEncoder

_SIGNS = {"ok": "ok  ", "note": "    ", "warning": "WARN", "error": "FAIL"}
_MIN_MEMORY_MB = 1500.0


@dataclass(frozen=True, slots=True)
class Report:
    """One thing that was looked at. fix: what to do, empty when nothing is to be done."""

    level: Level
    area: str
    text: str
    fix: str = ""


def doctor(target: Target, config_file: Path | None, listen_s: float, as_json: bool) -> int:
    """Looks at everything; exit code 1 when something must be repaired before irsd can work."""
    reports: list[Report] = []

    def say(report: Report) -> None:
        reports.append(report)
        if not as_json:
            click.echo(f"{_SIGNS[report.level]} {report.area:11s} {report.text}")
            if report.fix:
                click.echo(f"     {'':11s} -> {report.fix}")

    config = IrsdConfig()
    for report, loaded in configuration(config_file):
        config = loaded
        say(report)
    for check in (check_state, check_models, check_machine, check_secrets):
        for report in check(config):
            say(report)
    for report in check_network(config, target, listen_s):
        say(report)
    worst = [report for report in reports if report.level == "error"]
    if as_json:
        click.echo(json.dumps({"ok": not worst, "reports": [dataclasses.asdict(report) for report in reports]}))
    else:
        warned = sum(report.level == "warning" for report in reports)
        click.echo(f"{len(worst)} to repair, {warned} to look at, {len(reports)} looked at")
    return 1 if worst else 0


# ------------------------------------------------------------------------------------------------------ on this machine
def configuration(given: Path | None) -> Iterator[tuple[Report, IrsdConfig]]:
    """The file that irsd would read, and what it says."""
    path = find_config(given)
    try:
        config = load_config(path)
    except ConfigError as error:
        yield (
            Report("error", "config", str(error), "correct the file; irsctl config check FILE looks again"),
            IrsdConfig(),
        )
        return
    where = "built-in values (no /etc/irsd/irsd.yaml)" if path is None else str(path)
    yield Report("ok", "config", f"{where}: robot '{config.robot}'"), config


def check_state(config: IrsdConfig) -> Iterator[Report]:
    """Whether the map can be kept where it should be."""
    if not config.store.enabled:
        yield Report("note", "state", "store.enabled is false: the map is forgotten at every stop")
        return
    directory = state_directory(config.store)
    there = next(path for path in (directory, *directory.parents) if path.exists())
    free_mb, writable = disk_state(there)
    if not writable:
        owner = there.owner() if there.exists() else "nobody"
        fix = f"run as {owner}, or: sudo chown -R irsd:irsd {directory}; a read-only disk: mount -o remount,rw"
        yield Report("error", "state", f"{there} can't be written by uid {os.getuid()}", fix)
    elif free_mb is not None and free_mb < config.health.min_free_mb:
        yield Report("error", "disk", f"{directory}: {free_mb:.0f} MB are free", "free space: the map can't be kept")
    else:
        yield Report("ok", "disk", f"{directory}: {free_mb or 0:.0f} MB are free")


def check_models(config: IrsdConfig) -> Iterator[Report]:
    """Whether every model that the configuration names is here, with the bytes it should have."""
    try:
        LabelEncoder.load()
        yield Report("ok", "models", "the text encoder is here")
    except ModelError as error:
        yield Report("error", "models", f"text encoder: {error}", "install irsd again")
    s = config.perception
    if not s.image_encoder:
        yield Report("note", "models", "no eyes of its own: things come from detections/ids and detections/info")
    opener = ModelOpener(config.models)
    for name in dict.fromkeys(n for n in (s.tagger, s.detector, s.segmenter, s.image_encoder, s.text_encoder) if n):
        try:
            model, precision = opener.model(name), opener.precision_of(name)
            for part in model.parts:
                opener.shelf.verified(model, opener.shelf.choose(model, part, precision))
            yield Report("ok", "models", f"{name} is here, its bytes are right")
        except (ModelError, ConfigError) as error:
            fix = f"irsctl models pull {name.partition('@')[0]}; until then irsd runs without its eyes"
            yield Report("error", "models", f"{name}: {error}", fix)
    network = config.pipeline.mapping.network.model
    if network and not Path(network).is_file():
        yield Report(
            "error", "models", f"structure network: no file {network}", "correct pipeline.mapping.network.model"
        )


def check_machine(config: IrsdConfig) -> Iterator[Report]:
    """Cores, memory, and where compiled kernels are kept."""
    cores = len(os.sched_getaffinity(0))
    memory_mb = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 1e6
    level: Level = "ok" if cores >= 2 and memory_mb >= _MIN_MEMORY_MB else "warning"
    fix = "" if level == "ok" else "irsd is made for 2 cores and 2 GB; rooms go on with less, things come late"
    yield Report(level, "machine", f"{cores} cores, {memory_mb:.0f} MB memory", fix)
    cache = os.environ.get("NUMBA_CACHE_DIR")
    if cache and not os.access(cache, os.W_OK):
        fix = "CacheDirectory=irsd in the unit, or chown it; else every start compiles for half a minute"
        yield Report("warning", "machine", f"compiled kernels can't be kept in {cache}", fix)
    if config.zenoh.shared_memory and shutil.disk_usage("/dev/shm").free < 32e6:
        yield Report("warning", "machine", "/dev/shm is full", "remove /dev/shm/*.zenoh of processes that died")


def check_secrets(config: IrsdConfig) -> Iterator[Report]:
    """That keys are read by their owner only, and that nobody reaches irsd from outside unasked."""
    tls = config.zenoh.tls
    for name, value in (("ca", tls.ca), ("certificate", tls.certificate), ("key", tls.key)):
        path = Path(value)
        if value and not os.access(path, os.R_OK):
            fix = "correct the path, or: chgrp irsd FILE; chmod 640 FILE"
            yield Report("error", "security", f"zenoh.tls.{name}: {path} can't be read", fix)
        elif value and name == "key" and path.stat().st_mode & 0o007:
            yield Report("error", "security", f"{path}: everybody may read this key", f"chmod 640 {path}")
    open_to_all = [
        e for e in (config.zenoh.endpoint, *config.zenoh.listen) if e.startswith(("tcp/0.0.0.0", "tcp/[::]"))
    ]
    if open_to_all:
        fix = "config/secure shows TLS with certificates and rights; or listen on one address, behind a firewall"
        yield Report(
            "warning", "security", f"{', '.join(open_to_all)}: everybody on the network may read and steer", fix
        )
    else:
        yield Report("ok", "security", "reachable by " + ("certificate" if tls.key else "this computer only"))


# -------------------------------------------------------------------------------------------------------- on the network
def check_network(config: IrsdConfig, target: Target, listen_s: float) -> Iterator[Report]:
    """Who is there, and what can be heard."""
    settings = with_environment(config.zenoh, target.endpoint)
    settings = dataclasses.replace(settings, open_timeout_s=min(target.timeout_s, 5.0))
    try:
        with open_session(settings, "peer") as session:
            heard = listen(session, config.ingest, listen_s)
            yield from neighbours(session, settings)
            yield from running(session, target)
    except IrsdError as error:
        yield Report("error", "zenoh", str(error), "correct the section zenoh in irsd.yaml")
        return
    yield from (Report(*row) for row in topic_reports(heard, config.ingest))


def neighbours(session: Session, settings: ZenohSettings) -> Iterator[Report]:
    """Peers and routers that are linked."""
    peers, routers = session.neighbour_ids()
    where = ", ".join((settings.endpoint, *settings.connect))
    if not peers and not routers:
        fix = "start irsd, the bridge or the router; compare zenoh.endpoint and zenoh.connect, and firewalls"
        yield Report("error", "zenoh", f"nobody is linked at {where}", fix)
        return
    yield Report("ok", "zenoh", f"{len(peers)} peers and {len(routers)} routers are linked at {where}")
    if not routers:
        yield Report("note", "zenoh", "no router: needed only for ROS nodes with rmw_zenoh or for the bridge's clients")


def running(session: Session, target: Target) -> Iterator[Report]:
    """The irsd that is there, and its own faults."""
    robots = sorted({str(robot_of(key)) for key in session.find_alive(any_robot("alive"), timeout_s=target.timeout_s)})
    if not robots:
        yield Report("warning", "irsd", "no irsd is alive", "systemctl status irsd; journalctl -u irsd -e")
    for robot in robots:
        replies = session.get(f"irs/{robot}/status", timeout_s=target.timeout_s)
        document: dict[str, Any] = json.loads(replies[0].payload) if replies and replies[0].ok else {}
        graph = document.get("graph", {})
        yield Report(
            "ok", "irsd", f"{robot} is alive: {graph.get('rooms', 0)} rooms, {graph.get('instances', 0)} things"
        )
        for fault in document.get("faults", []):
            yield Report("warning", "irsd", f"{fault['code']}: {fault['text']}", fault.get("remedy", ""))
