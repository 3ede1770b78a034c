"""irsctl teach, rename, forget, merge, split, delete, undo and edits: what an operator says outranks what irsd sees."""

from __future__ import annotations

import json
from typing import Any

import click

from irsd.ctl.link import Target, ask_json, connected
from irsd.graph.codec import edit_from_json
from irsd.graph.edits import in_words


def edit(
    target: Target, as_json: bool, kind: str, node_id: str = "", name: str = "", others: tuple[str, ...] = ()
) -> int:
    """One edit; returns once it is on disk."""
    question = {"kind": kind, "target": node_id, "name": name, "others": list(others)}
    _ask(target, as_json, "edit", [question])
    return 0


def undo(target: Target, count: int, as_json: bool) -> int:
    """Takes the last edits back, the newest first."""
    _ask(target, as_json, "undo", [{}] * count)
    return 0


def edits(target: Target, as_json: bool) -> int:
    """The journal; undone edits are marked."""
    with connected(target) as (session, keys):
        document = ask_json(session, keys.command("edits"), target.timeout_s)
    if as_json:
        click.echo(json.dumps(document))
    else:
        for entry in document["edits"]:
            click.echo(line_of(entry))
    return 0


def line_of(document: dict[str, Any]) -> str:
    """A journal entry in words."""
    one = edit_from_json(json.dumps(document))
    return f"{in_words(one)}{' (undone)' if one.undone else ''}"


def _ask(target: Target, as_json: bool, command: str, questions: list[dict[str, Any]]) -> None:
    with connected(target) as (session, keys):
        for question in questions:
            document = ask_json(session, keys.command(command), max(target.timeout_s, 10.0), question)
            click.echo(json.dumps(document) if as_json else line_of(document["edit"]))
