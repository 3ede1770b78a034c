"""Sentences read by a language model behind an OpenAI-compatible endpoint, cross-checked with the offline parser.

The model fills in a form (a JSON schema); what it writes is checked like any input from outside. It is believed where it agrees with
what the offline parser found, and where that found no name it knows; where both know names and disagree, the offline parser's word
counts. No answer in time, a wrong one, or none at all: the offline parser alone. Any llama.cpp, Ollama or cloud server will do.
"""

from __future__ import annotations

import http.client
import json
import logging
import os
import urllib.parse
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from irsd.core.errors import ConfigError
from irsd.core.runtime import monotonic_s
from irsd.core.settings import setting
from nav_bridge import words as w
from nav_bridge.goal import GoalSpec, Names, Phrase, Relation
from nav_bridge.language import parse
from nav_bridge.language_nouns import noun_phrase

_log = logging.getLogger(__name__)

_MAX_ANSWER_BYTES = 100_000
_MAX_QUERY = 500  # characters that are sent
RELATIONS = (
    *(
        "near",
        "at",
        "on",
        "over",
        "in",
        "under",
        "above",
        "front",
        "behind",
        "left",
        "right",
        "between",
        "with",
        "without",
    ),
    *("has_on", "has_under", "nearest", "farthest", "corner", "middle", "floor", "wall", "ceiling"),
)
_ALONE = ("corner", "middle", "floor", "wall", "ceiling")  # relations to the room and to no thing
CHOICES = ("", "any", "nearest", "farthest", "largest", "smallest", "tallest", "lowest", "left", "right", "ordinal")
_TEXT = {"type": "string", "maxLength": 80}
SCHEMA: Mapping[str, Any] = {
    "type": "object",
    "additionalProperties": False,
    "required": ["thing", "attributes", "room", "not_room", "relations", "choice", "rank"],
    "properties": {
        "thing": {**_TEXT, "description": "English name of the thing to go to; empty if a room is the goal"},
        "attributes": {
            "type": "array",
            "maxItems": 4,
            "items": _TEXT,
            "description": "English colours, sizes, materials",
        },
        "room": {
            **_TEXT,
            "description": "English name of the room it is in, or that is the goal; empty if none is named",
        },
        "not_room": {**_TEXT, "description": "English name of a room it is not in; mostly empty"},
        "relations": {
            "type": "array",
            "maxItems": 4,
            "items": {
                "type": "object",
                "additionalProperties": False,
                "required": ["kind", "things", "negated"],
                "properties": {
                    "kind": {"enum": list(RELATIONS)},
                    "things": {"type": "array", "maxItems": 2, "items": _TEXT, "description": "what it is related to"},
                    "negated": {"type": "boolean"},
                },
            },
        },
        "choice": {"enum": list(CHOICES), "description": "which one of several, empty if it must be the only one"},
        "rank": {"type": "integer", "minimum": 1, "maximum": 20, "description": "2 for the second one"},
    },
}
_PROMPT = (
    "You read orders to a robot in a building, in any language, and fill in a form about the place it shall drive to. "
    "Use plain English names of things. Do not invent what is not said."
)


@dataclass(frozen=True, slots=True)
class ReaderSettings:
    """A language model that reads goals; without a URL the offline parser reads them alone."""

    url: str = setting("", "base URL of an OpenAI-compatible server, such as http://127.0.0.1:8080/v1; empty = none")
    model: str = setting("", "name of the model, as the server calls it")
    key_variable: str = setting("NAV_BRIDGE_API_KEY", "environment variable that holds the key, if one is needed")
    timeout_s: float = setting(3.0, "how long an answer may take before the offline parser's is used", lo=0.1, hi=60.0)


class Reader:
    """Reads sentences; may be used from several threads. ConfigError for a URL that is none."""

    def __init__(self, settings: ReaderSettings, names: Names) -> None:
        self._settings = settings
        self._names = names
        self._url = urllib.parse.urlsplit(settings.url)
        if settings.url and not (self._url.scheme in ("http", "https") and self._url.hostname):
            raise ConfigError(f"reader.url = {settings.url!r}: must be http://... or https://...")

    def read(self, text: str) -> GoalSpec:
        """The goal of a sentence. Never fails: what the endpoint does wrong is logged and left out."""
        offline = parse(text, self._names)
        if not self._settings.url or not text.strip():
            return offline
        try:
            model = goal_of(json.loads(self._ask(text)), text, offline.language, self._names)
        except (OSError, http.client.HTTPException, ValueError, KeyError, TypeError, IndexError) as error:
            # Of an error only its kind and what it says: never the request, whose header holds the key.
            _log.warning("the language model was of no use (%s: %s); read offline", type(error).__name__, _short(error))
            return replace(offline, parsed_by="offline: no use of the model")
        return agreed(offline, model, self._names)

    def _ask(self, text: str) -> str:
        """What the model writes. OSError (a time-out too), HTTPException, ValueError, KeyError: it is not what it should be."""
        deadline_s = monotonic_s() + self._settings.timeout_s
        kind = http.client.HTTPSConnection if self._url.scheme == "https" else http.client.HTTPConnection
        connection = kind(str(self._url.hostname), self._url.port, timeout=self._settings.timeout_s)
        messages = [{"role": "system", "content": _PROMPT}, {"role": "user", "content": text[:_MAX_QUERY]}]
        form = {"type": "json_schema", "json_schema": {"name": "goal", "strict": True, "schema": SCHEMA}}
        body = {
            "model": self._settings.model,
            "messages": messages,
            "temperature": 0,
            "max_tokens": 400,
            "response_format": form,
        }
        headers = {"Content-Type": "application/json"}
        if key := os.environ.get(self._settings.key_variable):
            headers["Authorization"] = f"Bearer {key}"
        try:
            connection.request(
                "POST", f"{self._url.path.rstrip('/')}/chat/completions", json.dumps(body).encode(), headers
            )
            reply = connection.getresponse()
            if reply.status != http.client.OK:
                raise ValueError(f"status {reply.status}")
            payload = b""
            while part := reply.read1(_MAX_ANSWER_BYTES):  # a server that drips is given up as well
                payload += part
                if len(payload) > _MAX_ANSWER_BYTES or monotonic_s() > deadline_s:
                    raise ValueError("the answer is too long, or takes too long")
        finally:
            connection.close()
        return str(json.loads(payload)["choices"][0]["message"]["content"])


def _short(error: Exception) -> str:
    key = " ".join(str(error).split())
    return key[:120]


def goal_of(form: Any, text: str, language: str, names: Names) -> GoalSpec:
    """The goal in a form that a model has filled in. ValueError, KeyError or TypeError when it does not keep to the schema."""
    if not isinstance(form, Mapping):
        raise TypeError("the form is no object")
    choice, rank = form["choice"], form["rank"]
    if choice not in CHOICES or not isinstance(rank, int) or not 1 <= rank <= 20:
        raise ValueError(f"choice {choice!r}, rank {rank!r}")
    thing, room, not_room = (_text(form[name]) for name in ("thing", "room", "not_room"))
    relations = []
    for item in form["relations"][:4]:
        anchors = tuple(_phrase(_text(anchor), names) for anchor in item["things"][:2])
        kind, alone = item["kind"], item["kind"] in _ALONE
        if kind not in RELATIONS or not (alone or (anchors and all(anchor.name for anchor in anchors))):
            raise ValueError(f"relation {kind!r}")
        relations.append(Relation(kind, () if alone else anchors, bool(item["negated"])))
    said = " ".join([*(_text(a) for a in form["attributes"][:4]), thing])
    things = (_phrase(said, names),) if thing else ()
    if not things and not room:
        raise ValueError("neither thing nor room")
    return GoalSpec(
        text, language, things, room=room, not_rooms=(not_room,) if not_room else (), relations=tuple(relations),
        choice=choice or ("ordinal" if rank > 1 else ""), rank=rank, room_is_goal=not things, parsed_by="model",
    )  # fmt: skip


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError(f"{value!r} is no text")
    return w.fold(value[:80])


def _phrase(said: str, names: Names) -> Phrase:
    return noun_phrase(said.split(), "en", names) if said else Phrase("")


def agreed(offline: GoalSpec, model: GoalSpec, names: Names) -> GoalSpec:
    """Of two readings the one that counts; parsed_by says which and why."""
    if offline.function or (offline.room_is_goal and names.known_room(offline.room)):
        return replace(offline, parsed_by="offline: a purpose or a room it knows")
    mine, its = (spec.things[0] if spec.things else None for spec in (offline, model))
    known = mine is not None and names.known(mine.name)
    same = mine is not None and its is not None and _same(mine.name, its.name, names)
    if known and not same:
        return replace(offline, parsed_by="offline: the model named something else")
    rooms = (offline.room, model.room)
    if all(rooms) and names.known_room(rooms[0]) and not _same_room(*rooms, names):
        return replace(offline, parsed_by="offline: the model named another room")
    # What the offline parser has understood of places and choices is in the sentence: the model may add to it, not drop it.
    if (
        len(offline.relations) > len(model.relations)
        or (offline.choice and not model.choice)
        or (offline.room and not model.room)
    ):
        return replace(offline, parsed_by="offline: the model left something out")
    return replace(model, seen_from=offline.seen_from, parsed_by="model, agreed" if same else "model")


def _same(a: str, b: str, names: Names) -> bool:
    return a == b or bool(set(names.senses(a)) & set(names.senses(b))) or names.is_a(a, b) or names.is_a(b, a)


def _same_room(a: str, b: str, names: Names) -> bool:
    return names.canonical_room(a) == names.canonical_room(b)
