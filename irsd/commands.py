"""What operators ask of a running irsd: ``irs/<robot>/cmd/<name>``, each a question with a JSON object and a JSON answer.

A command that changes the map is answered once its effect is on disk. Whoever may ask these keys is an operator: see the
access-control examples for telling operators from viewers.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable, Mapping
from typing import Any

from irsd.bundles import Bundles
from irsd.core.errors import EditError
from irsd.graph.codec import edit_to_json
from irsd.graph.edits import Request
from irsd.graph.model import Edit
from irsd.io.keys import RobotKeys
from irsd.io.session import BINARY, Handle, Query, Session
from irsd.maploop import MapLoop
from irsd.maps import Maps
from irsd.resume import Resumption

_MAX_BYTES = 65_536

Answer = Callable[[dict[str, Any]], dict[str, Any]]


class EditCommands:
    """``cmd/edit``, ``cmd/undo`` and ``cmd/edits``."""

    def __init__(self, session: Session, keys: RobotKeys, loop: MapLoop) -> None:
        self._loop = loop
        answers: tuple[tuple[str, Answer], ...] = (
            ("edit", self._edit),
            ("undo", self._undo),
            ("edits", self._list),
        )
        self._handles = [declared(session, keys.command(name), answer) for name, answer in answers]

    def close(self) -> None:
        """Answers no more."""
        for handle in self._handles:
            handle.close()

    def _edit(self, asked: dict[str, Any]) -> dict[str, Any]:
        """{"kind", "target", "name"?, "others"?} -> {"edit", "seq"}."""
        request = read_edit(asked)
        what = {"do": "edit", **dataclasses.asdict(request)}
        return self._loop.change(lambda pipeline: _told(*pipeline.edit(request)), what)

    def _undo(self, asked: dict[str, Any]) -> dict[str, Any]:
        """{} -> {"edit", "seq"}: the edit that was taken back."""
        nothing_more(asked)
        return self._loop.change(lambda pipeline: _told(*pipeline.undo()), {"do": "undo"})

    def _list(self, asked: dict[str, Any]) -> dict[str, Any]:
        """{} -> {"edits"}: the journal, oldest first."""
        nothing_more(asked)
        edits, graph = self._loop.call(lambda pipeline: (pipeline.edits(), pipeline.snapshot()))
        return {"edits": [_document(edit, graph.seq, graph.frame) for edit in edits]}


class MapCommands:
    """``cmd/snapshot``, ``cmd/map``, ``cmd/relocalise``, ``cmd/export`` and ``cmd/import``: which map irsd is in, and where in it."""

    def __init__(self, session: Session, keys: RobotKeys, maps: Maps, loop: MapLoop, resumption: Resumption) -> None:
        self._maps, self._loop, self._keys, self._resumption = maps, loop, keys, resumption
        self._handles = [
            declared(session, keys.command("snapshot"), self._snapshot),
            declared(session, keys.command("map"), self._map),
            declared(session, keys.command("relocalise"), self._relocalise),
            session.queryable(keys.command("export"), self._export),
            session.queryable(keys.command("import"), self._import),
        ]

    def close(self) -> None:
        """Answers no more."""
        for handle in self._handles:
            handle.close()

    def _snapshot(self, asked: dict[str, Any]) -> dict[str, Any]:
        """{"do": "save" | "list" | "restore" | "delete", "name"?} -> {"snapshots"} and, of a restore, {"seq"}."""
        what, name = text(asked, "do"), text(asked, "name", "")
        nothing_more(asked)
        out: dict[str, Any] = {}
        if what == "save":
            self._maps.save(name)
        elif what == "restore":
            out["seq"] = self._maps.restore(name)
        elif what == "delete":
            self._maps.delete(name)
        elif what != "list":
            raise EditError(f"{what[:20]!r}: save, list, restore or delete")
        return {**out, "snapshots": [dataclasses.asdict(info) for info in self._maps.list()]}

    def _map(self, asked: dict[str, Any]) -> dict[str, Any]:
        """{"do": "accept" | "new"} -> {"seq"}: what to do with a stored map that the scans do not fit."""
        what = text(asked, "do")
        nothing_more(asked)
        if what == "new":
            return {"seq": self._maps.start_new()}
        if what != "accept":
            raise EditError(f"{what[:20]!r}: accept or new")
        self._loop.accept_map()
        return {"seq": self._loop.snapshot.get().seq}

    def _relocalise(self, asked: dict[str, Any]) -> dict[str, Any]:
        """{"at"?: [x, y, yaw], "begin"?} -> {"found", "problem"}: the robot is looked for from the next sweeps on.

        Answered at once: there are few threads for questions, and a search ends when sweeps have come. begin false: how far is it?
        """
        at, begin = read_place(asked)
        if begin:
            self._loop.relocalise(at)
        return {"found": self._resumption.trusted, "problem": self._resumption.problem}

    def _export(self, query: Query) -> None:
        query.reply(self._keys.command("export"), self._maps.export(), encoding=BINARY)

    def _import(self, query: Query) -> None:
        seq = self._maps.take_in(query.payload)
        query.reply(self._keys.command("import"), json.dumps({"seq": seq}).encode())


class BundleCommand:
    """``cmd/bundle``: what a developer needs to see what this irsd saw."""

    def __init__(self, session: Session, keys: RobotKeys, bundles: Bundles) -> None:
        key = keys.command("bundle")
        self._handle = session.queryable(key, lambda query: query.reply(key, bundles.make(), encoding=BINARY))

    def close(self) -> None:
        """Answers no more."""
        self._handle.close()


def _told(edit: Edit, delta: Any) -> tuple[dict[str, Any], Any]:
    return {"edit": _document(edit, delta.seq, delta.frame), "seq": delta.seq}, delta


def _document(edit: Edit, seq: int, frame: str) -> dict[str, Any]:
    return dict(json.loads(edit_to_json(edit, seq=seq, frame=frame)))


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


# ---------------------------------------------------------------------------------------------------------- questions
def declared(session: Session, key: str, answer: Answer) -> Handle:
    """Answers JSON objects with JSON objects; what is wrong with a question becomes an error reply."""

    def handle(query: Query) -> None:
        query.reply(key, json.dumps(answer(read_question(query.payload))).encode())

    return session.queryable(key, handle)


def read_question(payload: bytes) -> dict[str, Any]:
    """The object that a question holds; nothing means an empty one. EditError for anything else."""
    if len(payload) > _MAX_BYTES:
        raise EditError(f"a command has at most {_MAX_BYTES} bytes, this one {len(payload)}")
    try:
        asked = json.loads(payload or b"{}")
    except (ValueError, RecursionError) as error:
        raise EditError(f"a command is a JSON object: {error}") from error
    if not isinstance(asked, dict):
        raise EditError("a command is a JSON object")
    return asked


def read_edit(asked: dict[str, Any]) -> Request:
    """What ``cmd/edit`` asks for. EditError for anything else."""
    others = asked.pop("others", [])
    if not isinstance(others, list) or not all(isinstance(i, str) for i in others):
        raise EditError("others: must be a list of ids")
    request = Request(text(asked, "kind"), text(asked, "target", ""), text(asked, "name", ""), tuple(others))
    nothing_more(asked)
    return request


def read_place(asked: dict[str, Any]) -> tuple[tuple[float, float, float] | None, bool]:
    """What ``cmd/relocalise`` asks for: about where the robot is, and whether a search begins. EditError for anything else."""
    at, begin = asked.pop("at", None), asked.pop("begin", True)
    nothing_more(asked)
    if at is not None and (not isinstance(at, list) or len(at) != 3 or not all(map(_is_number, at))):
        raise EditError("at: must be [x, y, yaw] in the map, metres and radians")
    if not isinstance(begin, bool):
        raise EditError("begin: must be true or false")
    return None if at is None else (float(at[0]), float(at[1]), float(at[2])), begin


def text(asked: dict[str, Any], name: str, default: str | None = None) -> str:
    """Takes a text out of a question. EditError when it is absent (and has no default) or no text."""
    value = asked.pop(name, default)
    if not isinstance(value, str):
        raise EditError(f"{name}: {'is missing' if value is None else 'must be text'}")
    return value


def nothing_more(asked: Mapping[str, Any]) -> None:
    """EditError when a question holds what its command does not know."""
    if asked:
        raise EditError(f"unknown: {', '.join(str(name)[:40] for name in asked)}")
