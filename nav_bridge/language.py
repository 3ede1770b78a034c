"""From a sentence to a ``GoalSpec``, offline: what is wanted, in which room, placed how against what, which one of several.

``parse`` is a grammar of few rules over the tables of ``words`` and ``functions``; the alias table (passed in as ``Names``)
tells names of things and rooms from other words. It never fails: what it can't place it keeps as part of the name, and the
resolver says not found.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

from nav_bridge import words as w
from nav_bridge.functions import OPENERS, Function, find_function

_MAX_NAME_WORDS = 5
# Languages in which an adjective follows its noun.
_NOUN_FIRST = ("fr", "es", "it")
# Relations that are none when nothing stands before them: "nearest chair".
_NEED_HEAD = ("of", "nearest", "farthest")


class Names(Protocol):
    """What the parser asks of the alias table."""

    def known(self, name: str) -> bool: ...

    def known_room(self, name: str) -> bool: ...


@dataclass(frozen=True, slots=True)
class Phrase:
    """A thing as named. name: the words of the noun, folded; head: its known ending, "" when the name is known or nothing is.

    attributes: (group, canonical attribute), such as ("colour", "orange").
    """

    name: str
    head: str = ""
    attributes: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True, slots=True)
class Relation:
    """How the goal lies to others. kind: near, at, on, under, above, front, behind, between, in, with, without, has_on, has_under,
    left, right, nearest, farthest (with anchors), corner, middle, floor, wall, ceiling (without). room: the anchor is a room of this
    name. seen_from: "door" or "robot" where it is said from where left is left, "" where it is not."""

    kind: str
    anchors: tuple[Phrase, ...] = ()
    negated: bool = False
    room: str = ""
    seen_from: str = ""


@dataclass(frozen=True, slots=True)
class GoalSpec:
    """What a sentence asks for.

    things: names wanted, best first (several for a purpose). room / not_rooms: names of rooms as said. choice: "" (must be
    unique), any, nearest, farthest, largest, smallest, tallest, lowest, ordinal; rank: which one in the order of choice, 1 = first.
    function: the purpose it was asked by, "".
    """

    text: str
    language: str
    things: tuple[Phrase, ...]
    room: str = ""
    not_rooms: tuple[str, ...] = ()
    relations: tuple[Relation, ...] = ()
    choice: str = ""
    rank: int = 1
    function: str = ""
    room_is_goal: bool = False


def parse(text: str, names: Names) -> GoalSpec:
    """The goal of a sentence. An empty sentence gives a goal without things."""
    folded = w.fold(text)
    language = find_language(folded)
    spoken = folded.split()
    tokens = _strip_ends(spoken, language)
    if language in ("zh", "ja"):
        from nav_bridge.language_cjk import parse_cjk  # noqa: PLC0415  that module builds on the types of this one

        return parse_cjk(text, "".join(tokens), language, names)
    # "I want to watch" opens a purpose, "I want to go to the" is a command.
    for opened in (_after_opener(spoken), _after_opener(tokens)):
        if opened is not None and _strip_ends(opened, language) == opened:
            spec = _by_purpose(text, language, opened, names)
            if spec is not None:
                return spec
    return _by_name(text, language, tokens, names)


def find_language(folded: str) -> str:
    """Language by script, then by which function words occur most; English where nothing tells."""
    if any("\u3040" <= c <= "\u30ff" for c in folded):
        return "ja"
    if any("\u4e00" <= c <= "\u9fff" for c in folded):
        return "zh"
    if any("\u0400" <= c <= "\u04ff" for c in folded):
        return "ru"
    tokens = folded.split()
    counts = {lang: sum(t in marks for t in tokens) + _commands(tokens, lang) for lang, marks in w.MARKS.items()}
    return max(counts, key=lambda lang: counts[lang])  # the first of equals: English


def _commands(tokens: Sequence[str], language: str) -> int:
    """Words of the longest command of a language that a sentence starts with: "geh", "ve a"; 0 for none, or a syllable."""
    found = (c for c in w.COMMANDS[language] if tuple(tokens[: len(c)]) == c and len(" ".join(c)) > 2)
    return max((len(c) for c in found), default=0)


def _strip_ends(tokens: list[str], language: str) -> list[str]:
    """Without "go to", "please" and the like at both ends, in the sentence's language and in English."""
    tables = [w.COMMANDS[language], w.COMMANDS["en"]] if language != "en" else [w.COMMANDS["en"]]
    if language in ("zh", "ja"):
        return _strip_ends_unspaced(tokens, language)
    while tokens:
        found = next(
            (c for table in tables for c in table if tuple(tokens[: len(c)]) == c and len(c) < len(tokens)), None
        )
        if found is None:
            break
        tokens = tokens[len(found) :]
    while tokens:
        found = next((c for c in w.TAILS[language] if tuple(tokens[-len(c) :]) == c and len(c) < len(tokens)), None)
        if found is None:
            break
        tokens = tokens[: -len(found)]
    return tokens


def _strip_ends_unspaced(tokens: list[str], language: str) -> list[str]:
    line, before = "".join(tokens), ""
    heads = ["".join(c) for c in w.COMMANDS[language]]
    tails = ["".join(c) for c in w.TAILS[language]]
    while line != before:
        before = line
        for head in sorted(heads, key=len, reverse=True):
            if line.startswith(head) and len(head) < len(line):
                line = line[len(head) :]
        for tail in sorted(tails, key=len, reverse=True):
            if line.endswith(tail) and len(tail) < len(line):
                line = line[: -len(tail)]
    return [line]


def _after_opener(tokens: Sequence[str]) -> list[str] | None:
    """The words after "something to", "where can I" ..., None when nothing of the kind opens the sentence."""
    start = 1 if tokens and tokens[0] in ("a", "the", "any", "some") else 0
    for at in (0, start):
        for opener in OPENERS:
            if tuple(tokens[at : at + len(opener)]) == opener and len(tokens) > at + len(opener):
                rest = list(tokens[at + len(opener) :])
                deeper = _after_opener(rest)
                return rest if deeper is None else deeper
    return None


def _by_purpose(text: str, language: str, tokens: list[str], names: Names) -> GoalSpec | None:
    """A goal asked for by what it is good for, None when no purpose is recognised. Rooms and relations may follow the verb."""
    head, segments = _split(tokens, language, names)
    function = find_function(tuple(head)) or find_function(tuple(tokens))
    if function is None:
        return None
    # "sit on in the kitchen": relations without an anchor belong to the verb.
    segments = [(kind, anchor, negated) for kind, anchor, negated in segments if _known_phrase(anchor, names)]
    spec = _place(
        GoalSpec(text, language, _things_of(function), choice="any", function=function.name), segments, language, names
    )
    if function.near and not any(r.kind in ("near", "front") for r in spec.relations):
        spec = replace(spec, relations=(*spec.relations, Relation("front", (Phrase(function.near),))))
    own = {w.fold(thing) for thing in function.things}
    kept = tuple(r for r in spec.relations if not any(a.name in own for a in r.anchors))
    return replace(spec, relations=kept)


def _things_of(function: Function) -> tuple[Phrase, ...]:
    return tuple(Phrase(thing) for thing in function.things)


def _known_phrase(tokens: Sequence[str], names: Names) -> bool:
    bare = _bare(tokens).split()
    tails = [" ".join(bare[k:]) for k in range(len(bare))]
    return any(names.known(t) or names.known_room(t) for t in tails) or bool(set(bare) & (w.CORNER | w.ME))


def _by_name(text: str, language: str, tokens: list[str], names: Names) -> GoalSpec:
    head, segments = _split(tokens, language, names)
    head, choice, rank = _choice(head)
    room = ""
    if "s" in head[1:-1]:  # "the bedroom's TV"
        at = head.index("s")
        owner = _bare(head[:at])
        if names.known_room(owner):
            room, head = owner, head[at + 1 :]
    bare = _bare(head).split()
    if not room and len(bare) > 1 and not names.known(" ".join(bare)):  # "bedroom TV"
        cuts = [
            k
            for k in range(len(bare) - 1, 0, -1)
            if names.known_room(" ".join(bare[:k])) and _has_known_tail(bare[k:], names)
        ]
        if cuts:
            room, bare = " ".join(bare[: cuts[0]]), bare[cuts[0] :]
    spec = GoalSpec(text, language, (), room=room, choice=choice, rank=rank)
    spec = _place(spec, segments, language, names)
    phrase = noun_phrase(bare, language, names)
    only_command = not bare or any(tuple(bare) in w.COMMANDS[k] for k in (language, "en"))
    if spec.room and only_command and not spec.relations and not spec.choice:
        return replace(spec, room_is_goal=True)  # "drive into the kitchen"
    is_room = bool(bare) and not names.known(phrase.name) and names.known_room(" ".join(bare))
    if is_room and not spec.relations and not spec.room:
        return replace(spec, room=" ".join(bare), room_is_goal=True)
    return replace(spec, things=(phrase,) if phrase.name else ())


def _has_known_tail(tokens: Sequence[str], names: Names) -> bool:
    return any(names.known(" ".join(tokens[k:])) for k in range(len(tokens)))


def _bare(tokens: Sequence[str]) -> str:
    """The words after leading articles; articles inside a name stay ("mesa del comedor")."""
    kept = list(tokens)
    while len(kept) > 1 and kept[0] in w.ARTICLES:
        kept = kept[1:]
    return " ".join(kept)


def _choice(head: list[str]) -> tuple[list[str], str, int]:
    """(head without the words of choice, how to choose, which one)."""
    choice, rank, kept = "", 1, []
    orders = (
        (w.NEAREST, "nearest"), (w.FARTHEST, "farthest"), (w.LARGEST, "largest"), (w.SMALLEST, "smallest"),
        (w.TALLEST, "tallest"), (w.LOWEST, "lowest"), (w.ANY, "any"),
    )  # fmt: skip
    for position, token in enumerate(head):
        found = next((name for table, name in orders if token in table), "")
        if found and len(head) > 1:
            choice = found
        elif token in w.ORDINALS and len(head) > 1:
            rank, choice = w.ORDINALS[token], choice or "ordinal"
        elif token in w.INDEFINITE and position == 0 and len(head) > 1:
            choice = choice or "any"
        else:
            kept.append(token)
    if kept[:2] == ["one", "of"]:
        kept, choice = kept[2:], "any"
    return kept, choice, rank


def noun_phrase(tokens: Sequence[str], language: str, names: Names) -> Phrase:
    """Name, head and attributes of a noun phrase. The longest known name wins; attributes are only words that are known as such."""
    whole = _bare(tokens)
    bare = whole.split()
    attributes = tuple(dict.fromkeys(w.ATTRIBUTES[t] for t in bare if t in w.ATTRIBUTES))
    if len(bare) < 2 or names.known(whole):
        return Phrase(whole, "", attributes if len(bare) > 1 else ())
    noun = [t for t in bare if t not in w.ATTRIBUTES]
    if noun and names.known(" ".join(noun)):
        return Phrase(" ".join(noun), "", attributes)
    tails = [bare[k:] for k in range(1, len(bare))]
    fronts = [bare[:k] for k in range(len(bare) - 1, 0, -1)]
    for part in fronts + tails if language in _NOUN_FIRST else tails + fronts[:0]:
        if names.known(" ".join(part)):
            rest = bare[: -len(part)] if part == bare[-len(part) :] else bare[len(part) :]
            if all(t in w.ATTRIBUTES for t in rest):
                return Phrase(" ".join(part), "", attributes)
            return Phrase(" ".join(noun or bare), " ".join(part), attributes)
    return Phrase(" ".join(noun or bare), "", attributes if noun else ())


Segment = tuple[str, list[str], bool]


def _split(tokens: Sequence[str], language: str, names: Names) -> tuple[list[str], list[Segment]]:
    """The words before the first relation, and per relation (kind, its words, negated). Known names are never cut."""
    head: list[str] = []
    segments: list[Segment] = []
    current, at, negated = head, 0, False
    table = w.RELATIONS[language]
    negations = w.NEGATIONS.get(language, ())
    while at < len(tokens):
        if (not current or current[-1:] == ["and"] or all(t in w.ARTICLES for t in current)) and (
            size := _name_at(tokens, at, names, language)
        ):
            current += tokens[at : at + size]
            at += size
            continue
        no = next((n for n in negations if tuple(tokens[at : at + len(n)]) == n), None)
        if no is not None and at > 0:
            negated, at = True, at + len(no)
            while at < len(tokens) and (tokens[at] in w.ARTICLES or tokens[at] in ("one", "ones")):
                at += 1
            continue
        match = next((row for row in table if tuple(tokens[at : at + len(row[0])]) == row[0]), None)
        if (
            match is not None
            and at + len(match[0]) < len(tokens) + (1 if segments else 0)
            and (any(t not in w.ARTICLES for t in head) or match[1] not in _NEED_HEAD)
        ):
            current = []
            segments.append((match[1], current, negated))
            negated, at = False, at + len(match[0])
            continue
        current.append(tokens[at])
        at += 1
    while len(head) > 1 and head[-1] in w.FILLERS and not names.known(_bare(head)):
        head.pop()
    return head, segments


def _name_at(tokens: Sequence[str], at: int, names: Names, language: str) -> int:
    """Words of the longest known name that starts here and holds a relation word ("chest of drawers", "salle a manger"); 0 if none."""
    relation_words = {row[0][0] for row in w.RELATIONS[language] if len(row[0]) == 1}
    for size in range(min(_MAX_NAME_WORDS, len(tokens) - at), 1, -1):
        part = tokens[at : at + size]
        if not any(t in relation_words for t in part[1:-1]) or part[0] in relation_words or part[0] in w.ARTICLES:
            continue
        name = " ".join(part)
        if names.known(name) or names.known_room(name):
            return size
    return 0


def _place(spec: GoalSpec, segments: Sequence[Segment], language: str, names: Names) -> GoalSpec:
    """The goal with its rooms and relations filled in from the segments."""
    room, not_rooms, relations = spec.room, list(spec.not_rooms), list(spec.relations)
    choice = spec.choice
    position = 0
    while position < len(segments):
        kind, tokens, negated = segments[position]
        following = segments[position + 1] if position + 1 < len(segments) else None
        position += 1
        while len(tokens) > 1 and tokens[-1] in w.FILLERS and not names.known(_bare(tokens)):
            tokens = tokens[:-1]
        bare = _bare(tokens).split()
        if kind == "with" and following and (not following[1] or set(following[1]) & w.PRONOUNS):
            position += 1
            kind = {"on": "has_on", "in": "has_on", "under": "has_under", "above": "under"}.get(following[0], "near")
        if set(bare) & w.ME and kind in ("near", "nearest", "at", "of", "front"):
            choice = choice or "nearest"
        elif placed := _without_anchor(kind, bare, negated):
            relations.append(placed)
        elif (
            kind in ("in", "on", "at", "of", "with")
            and (names.known_room(" ".join(bare)) or _is_room_id(bare))
            and not _thing_first(kind, bare, names)
        ):
            if negated:
                not_rooms.append(" ".join(bare))
            else:
                room = room or " ".join(bare)
        elif bare and not set(bare) <= w.PRONOUNS:
            relations.append(_relation(kind, bare, negated, language, names))
    return replace(spec, room=room, not_rooms=tuple(not_rooms), relations=tuple(relations), choice=choice)


def _is_room_id(bare: Sequence[str]) -> bool:
    """Whether the words are an id of the graph, such as R3."""
    return len(bare) == 1 and bare[0][:1] == "r" and bare[0][1:].isdigit()


def _thing_first(kind: str, bare: list[str], names: Names) -> bool:
    """Whether a word that names a room and a thing ("closet") means the thing here."""
    return kind not in ("in", "of") and names.known(" ".join(bare)) and kind != "on"


def _without_anchor(kind: str, bare: Sequence[str], negated: bool) -> Relation | None:
    said = set(bare)
    for table, name, kinds in (
        (w.CORNER, "corner", ("in", "at", "on", "near")),
        (w.MIDDLE, "middle", ("in", "at")),
        (w.FLOOR, "floor", ("on", "at", "in")),
        (w.WALL, "wall", ("on", "at", "near", "in")),
        (w.CEILING, "ceiling", ("on", "at", "of", "near", "under")),
    ):
        if said & table and kind in kinds:
            return Relation(name, (), negated)
    return None


def _relation(kind: str, bare: Sequence[str], negated: bool, language: str, names: Names) -> Relation:
    ands = {"and", "und", "et", "y", "e", "и"}
    cut = (
        next((k for k, t in enumerate(bare) if t in ands and 0 < k < len(bare) - 1), None)
        if kind == "between"
        else None
    )
    parts = [bare] if cut is None else [bare[:cut], bare[cut + 1 :]]
    anchors = tuple(
        noun_phrase([t for t in part if t not in w.INDEFINITE] or list(part), language, names) for part in parts
    )
    room = " ".join(bare) if names.known_room(" ".join(bare)) and not names.known(" ".join(bare)) else ""
    return Relation("without" if kind == "without" else kind, anchors, negated, room)
