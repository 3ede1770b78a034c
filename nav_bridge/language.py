"""From a sentence to a ``GoalSpec``, offline: what is wanted, in which room, placed how against what, which one of several.

``parse`` is a grammar of few rules over the tables of ``words`` and ``functions``; the alias table (passed in as ``Names``)
tells names of things and rooms from other words. It never fails: what it can't place it keeps as part of the name, and the
resolver says not found.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

from nav_bridge import words as w
from nav_bridge import words_carriers as c
from nav_bridge.functions import Function, find_function
from nav_bridge.goal import IT, GoalSpec, Names, Phrase, Relation
from nav_bridge.language_cjk import parse_cjk
from nav_bridge.language_ends import after_opener, find_language, in_order, starts_relation, strip_ends, strip_viewpoint
from nav_bridge.language_nouns import bare_name, noun_phrase
from nav_bridge.words_attributes import ATTRIBUTES, OPPOSITES

_MAX_NAME_WORDS = 5
# Relations that are none when nothing stands before them: "nearest chair".
_NEED_HEAD = ("of", "nearest", "farthest")


def parse(text: str, names: Names) -> GoalSpec:
    """The goal of a sentence. An empty sentence gives a goal without things."""
    folded = w.fold(text)
    language = find_language(folded)
    if language in ("zh", "ja"):
        spoken, seen_from = strip_viewpoint(folded.split(), language)
        spec = parse_cjk(text, "".join(strip_ends(spoken, language, names)), language, names)
        return replace(spec, seen_from=seen_from)
    seen_from, clauses = "", [_rewritten(part).split() for part in re.split("[,;:]", text)]
    for k, clause in enumerate(clauses):
        clauses[k], eye = strip_viewpoint(clause, language, alone=len(clauses) == 1)
        seen_from = seen_from or eye
    return replace(_of_words(text, language, clauses, names), seen_from=seen_from)


def _rewritten(text: str) -> str:
    line = f" {w.fold(text)} "
    for said, means in c.REWRITES.items():
        line = line.replace(f" {said} ", f" {means} ")
    return line


def _of_words(text: str, language: str, clauses: list[list[str]], names: Names) -> GoalSpec:
    spoken = [token for clause in clauses for token in clause]
    tokens = in_order(clauses, language, names)
    # "I want to watch" opens a purpose, "I want to go to the" is a command.
    for opened in (after_opener(spoken), after_opener(tokens)):
        if opened is not None and strip_ends(opened, language, names) == opened:
            spec = _by_purpose(text, language, opened, names)
            if spec is not None:
                return spec
    return _by_name(text, language, tokens, names)


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
    bare = bare_name(tokens).split()
    tails = [" ".join(bare[k:]) for k in range(len(bare))]
    return any(names.known(t) or names.known_room(t) for t in tails) or bool(set(bare) & (w.CORNER | w.ME))


def _by_name(text: str, language: str, tokens: list[str], names: Names) -> GoalSpec:
    head, segments = _split(tokens, language, names)
    head, choice, rank = _choice(head, names)
    if (
        choice in ("nearest", "farthest")
        and len(cut := [k for k, t in enumerate(head) if t in ("to", "from") and k]) == 1
    ):
        # "the closest chair to the door"
        head, segments = head[: cut[0]], [(choice, head[cut[0] + 1 :], False), *segments]
    room = ""
    if "s" in head[1:-1]:  # "the bedroom's TV"
        at = head.index("s")
        owner = bare_name(head[:at])
        if names.known_room(owner):
            room, head = owner, head[at + 1 :]
    bare = bare_name(head).split()
    if not room and len(bare) > 1 and not names.known(" ".join(bare)):  # "bedroom TV"
        cuts = [
            k
            for k in range(len(bare) - 1, 0, -1)
            if names.known_room(" ".join(bare[:k])) and _has_known_tail(bare[k:], names)
        ]
        whole = names.known_room(" ".join(bare))  # "server room"
        tails = [
            k
            for k in range(1, 1 if whole else len(bare))
            if names.known_room(" ".join(bare[k:])) and names.known(" ".join(bare[:k]))
        ]
        if cuts:
            room, bare = " ".join(bare[: cuts[0]]), bare[cuts[0] :]
        elif tails:  # "TV bedroom"
            room, bare = " ".join(bare[tails[0] :]), bare[: tails[0]]
    spec = GoalSpec(text, language, (), room=room, choice=choice, rank=rank)
    spec = _place(spec, [s for s in segments if s[0] != _UNLIKE], language, names)
    if spec.choice == "last":  # counted from the robot, or from a side
        spec = replace(spec, choice="farthest")
    if bare and set(bare) <= w.BACK:
        return replace(spec, things=(Phrase(IT),))
    phrase = noun_phrase(bare, language, names)
    unlike = [ATTRIBUTES[t] for kind, said, _ in segments if kind == _UNLIKE for t in said if t in ATTRIBUTES]
    if unlike:
        refused = tuple(
            ("size", OPPOSITES[value]) if value in OPPOSITES else (f"not {group}", value) for group, value in unlike
        )
        phrase = replace(phrase, attributes=(*phrase.attributes, *refused))
    if not phrase.name and _is_destination(spec):  # "park by the front door", "get close to the plant"
        return replace(spec, things=spec.relations[0].anchors, relations=spec.relations[1:])
    only_command = not bare or any(tuple(bare) in w.COMMANDS[k] for k in (language, "en"))
    if spec.room and only_command and not spec.relations and not spec.choice:
        return replace(spec, room_is_goal=True)  # "drive into the kitchen"
    is_room = bool(bare) and not names.known(phrase.name) and names.known_room(" ".join(bare))
    if is_room and not spec.relations and not spec.room:
        return replace(spec, room=" ".join(bare), room_is_goal=True)
    return replace(spec, things=(phrase,) if phrase.name else ())


def _is_destination(spec: GoalSpec) -> bool:
    """Whether a place without a thing is the place to go to: "next to the sofa"."""
    if spec.room or not spec.relations:
        return False
    first = spec.relations[0]
    return first.kind not in ("between", "without") and len(first.anchors) == 1 and not (first.negated or first.room)


def _has_known_tail(tokens: Sequence[str], names: Names) -> bool:
    return any(names.known(" ".join(tokens[k:])) for k in range(len(tokens)))


_ORDERS = (
    (w.NEAREST, "nearest"), (w.FARTHEST, "farthest"), (w.LARGEST, "largest"), (w.SMALLEST, "smallest"), (w.TALLEST, "tallest"),
    (w.LOWEST, "lowest"), (w.LEFT, "left"), (w.RIGHT, "right"), (w.ANY, "any"),
)  # fmt: skip


def _choice(head: list[str], names: Names) -> tuple[list[str], str, int]:
    """(head without the words of choice, how to choose, which one)."""
    choice, rank, most = "", 1, False
    kept: list[str] = []
    for position, token in enumerate(head if len(head) > 1 else []):
        found = next((name for table, name in _ORDERS if token in table), "")
        group, value = ATTRIBUTES.get(token, ("", ""))
        if most and group == "size" and value in w.SUPERLATIVES:
            found = w.SUPERLATIVES[value]
        if found:
            choice = c.OTHER_SIDE.get(found, found) if choice == "last" else found
        elif token in c.LAST and len(head) > 1:
            choice = c.OTHER_SIDE.get(choice, "last")
        elif token in w.ORDINALS and not names.known(" ".join(head[position:])):  # "first aid kit"
            rank, choice = w.ORDINALS[token], choice or "ordinal"
        elif token in w.INDEFINITE and position == 0:
            choice = choice or "any"
        elif not (token in w.MOST and position > 0 and len(head) > 2) and token not in kept[-1:]:
            kept.append(token)  # once: "a chair, any chair"
        most = token in w.MOST
    if len(head) == 1:
        kept = list(head)
    while choice and len(kept) > 1 and (kept[-1] in w.ARTICLES or kept[-1] in w.SIDE):
        kept.pop()  # "la chaise la plus proche", "la chaise de gauche"
    return kept, choice, rank


def _side(kind: str, tokens: Sequence[str]) -> str:
    """ "left" or "right" where that is all that stands behind a relation: on the left, from the left, de la izquierda."""
    said = {t for t in tokens if t not in w.ARTICLES and t not in w.SIDE}
    if kind not in ("at", "on", "in", "of", "near", "left", "right") or not said:
        return ""
    return "left" if said <= w.LEFT else "right" if said <= w.RIGHT else ""


_NO_NAME = w.INDEFINITE | w.LEFT | w.RIGHT  # of what a relation refers to: "on the left desk" is on a desk


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
            if unlike := _attributes_only(tokens[at:], language):  # "that is not red", "but not the red one"
                segments.append((_UNLIKE, list(tokens[at : at + unlike]), True))
                negated, at = False, at + unlike
            continue
        if tokens[at] in _GENITIVE and head and not segments and all(t in _QUANTIFIERS for t in head):
            at += 1  # "any of the chairs"
            continue
        match = next((row for row in table if tuple(tokens[at : at + len(row[0])]) == row[0]), None)
        if (
            match is not None
            and at + len(match[0]) < len(tokens) + (1 if segments else 0)
            and (any(t not in w.ARTICLES and t not in w.ORDINALS for t in head) or match[1] not in _NEED_HEAD)
        ):
            while len(current) > 1 and current[-1] in c.ANDS:
                current.pop()  # "near the window and next to the wardrobe"
            negated = negated != (match[1] == "out")
            current = []
            segments.append(("in" if match[1] == "out" else match[1], current, negated))
            negated, at = False, at + len(match[0])
            continue
        current.append(tokens[at])
        at += 1
    loose = w.FILLERS | c.PARTICLES | w.ARTICLES
    while len(head) > 1 and head[-1] in loose and not names.known(bare_name(head)):
        head.pop()
    return head, segments


_UNLIKE = "unlike"  # a segment that holds the attributes a thing must not have
_GENITIVE = w.words("of de des du del della dello dei delle из")
_QUANTIFIERS = (
    w.ARTICLES | w.INDEFINITE | w.ANY | w.NEAREST | w.FARTHEST | w.LARGEST | w.SMALLEST | frozenset(w.ORDINALS) | c.LAST
)


def _attributes_only(tokens: Sequence[str], language: str) -> int:
    """How many of the words, up to a relation or the end, are attributes and nothing more; 0 when there is a noun among them."""
    for size, token in enumerate(tokens):
        if starts_relation(tokens[size:], language):
            return size
        if token not in ATTRIBUTES and token not in c.SHADES and token not in ("one", "ones"):
            return 0
    return len(tokens)


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
        side = _side(kind, tokens)
        while len(tokens) > 1 and tokens[-1] in w.FILLERS and not names.known(bare_name(tokens)):
            tokens = tokens[:-1]
        bare = bare_name(tokens).split()
        if kind == "with" and following and (not following[1] or set(following[1]) & w.PRONOUNS):
            position += 1
            kind = {"on": "has_on", "in": "has_on", "under": "has_under", "above": "under"}.get(following[0], "near")
        if set(bare) <= w.HERE:
            continue
        if side:
            choice = c.OTHER_SIDE[side] if choice == "last" else side
        elif set(bare) & w.ME and kind in ("near", "nearest", "at", "of", "front"):
            choice = choice or "nearest"
        elif not (len(bare) > 1 and names.known(" ".join(bare))) and (placed := _without_anchor(kind, bare, negated)):
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
        elif bare and set(bare) <= w.BACK:
            relations.append(Relation(kind, (Phrase(IT),), negated))
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
    cut = (
        next((k for k, t in enumerate(bare) if t in c.ANDS and 0 < k < len(bare) - 1), None)
        if kind == "between"
        else None
    )
    parts = [bare] if cut is None else [bare[:cut], bare[cut + 1 :]]
    anchors = tuple(
        noun_phrase([t for t in part if t not in _NO_NAME] or list(part), language, names) for part in parts
    )
    room = " ".join(bare) if names.known_room(" ".join(bare)) and not names.known(" ".join(bare)) else ""
    return Relation("without" if kind == "without" else kind, anchors, negated, room)
