"""irsctl snapshot, export, import, map and relocalise: the maps of a running irsd, and the robot's place in its own."""

from __future__ import annotations

import json
import time
from pathlib import Path

import click

from irsd.core.errors import StoreError
from irsd.core.runtime import monotonic_s, sleep_s
from irsd.ctl.link import Target, ask, ask_json, connected

_PATIENCE_S = 180.0  # for a map of ten thousand things on a busy robot


def snapshot(target: Target, what: str, name: str, as_json: bool) -> int:
    """Save, list, restore or delete; prints what there is afterwards."""
    with connected(target) as (session, keys):
        document = ask_json(session, keys.command("snapshot"), _PATIENCE_S, {"do": what, "name": name})
    if as_json:
        click.echo(json.dumps(document))
        return 0
    if what == "restore":
        click.echo(f"restored {name}: the map is at revision {document['seq']}")
    for info in document["snapshots"]:
        saved = time.strftime("%Y-%m-%d %H:%M", time.localtime(info["saved_s"]))
        click.echo(f"{info['name']:24s} {info['size_bytes'] / 1e6:8.1f} MB  {saved}")
    return 0


def export(target: Target, file: Path) -> int:
    """The map into a file, which appears whole or not at all."""
    with connected(target) as (session, keys):
        content = ask(session, keys.command("export"), _PATIENCE_S)
    partial = file.with_name(f".{file.name}.part")
    try:
        partial.write_bytes(content)
        partial.replace(file)
    except OSError as error:
        raise StoreError(f"{file}: {error}") from error
    click.echo(f"wrote {file}, {len(content) / 1e6:.1f} MB")
    return 0


def take_in(target: Target, file: Path) -> int:
    """A file that export wrote into irsd."""
    try:
        content = file.read_bytes()
    except OSError as error:
        raise StoreError(f"{file}: {error}") from error
    with connected(target) as (session, keys):
        answer = json.loads(ask(session, keys.command("import"), _PATIENCE_S, content))
    click.echo(f"took {file} in: the map is at revision {answer['seq']}")
    return 0


def decide(target: Target, what: str) -> int:
    """Accept the stored map, or begin a new one."""
    with connected(target) as (session, keys):
        answer = ask_json(session, keys.command("map"), _PATIENCE_S, {"do": what})
    click.echo(f"{'the stored map goes on' if what == 'accept' else 'a new map begins'}, at revision {answer['seq']}")
    return 0


def relocalise(target: Target, at: tuple[float, float, float] | None, wait_s: float, as_json: bool) -> int:
    """Have the robot looked for; 1 when it was not found in the time given (the search goes on)."""
    with connected(target) as (session, keys):
        key, patience_s = keys.command("relocalise"), max(target.timeout_s, 15.0)
        answer = ask_json(session, key, patience_s, {} if at is None else {"at": list(at)})
        end_s = monotonic_s() + wait_s
        while not answer["found"] and monotonic_s() < end_s:
            sleep_s(0.3)
            answer = ask_json(session, key, patience_s, {"begin": False})
    if as_json:
        click.echo(json.dumps(answer))
    elif answer["found"]:
        click.echo("found: the robot is in the map, and sweeps are merged again")
    else:
        click.echo(
            f"not found yet: {answer['problem']}. The search goes on while sweeps come in: drive on a little, say about where it is "
            "(--at X,Y,YAW), or call it off (irsctl map accept)"
        )
    return 0 if answer["found"] else 1
