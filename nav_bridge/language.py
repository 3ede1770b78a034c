"""From a sentence to a ``GoalSpec``, offline: what is wanted, in which room, placed how against what, which one of several.

``parse`` is a grammar of few rules over the tables of ``words`` and ``functions``; the alias table (passed in as ``Names``)
tells names of things and rooms from other words. It never fails: what it can't place it keeps as part of the name, and the
resolver says not found.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from nav_bridge import words as w
from nav_bridge.functions import Function, find_function
from nav_bridge.goal import IT, GoalSpec, Names, Phrase, Relation
from nav_bridge.language_cjk import parse_cjk
from nav_bridge.language_ends import after_opener, find_language, strip_ends, strip_viewpoint
from nav_bridge.words_attributes import ATTRIBUTES

_MAX_NAME_WORDS = 5
# Languages in which an adjective follows its noun.
_NOUN_FIRST = ("fr", "es", "it")
# Relations that are none when nothing stands before them: "nearest chair".
_NEED_HEAD = ("of", "nearest", "farthest")


def parse(text: str, names: Names) -> GoalSpec:
    """The goal of a sentence. An empty sentence gives a goal without things."""
    folded = w.fold(text)
    language = find_language(folded)
    spoken, seen_from = strip_viewpoint(folded.split(), language)
    tokens = strip_ends(spoken, language)
    if language in ("zh", "ja"):
        spec = parse_cjk(text, "".join(tokens), language, names)
    else:
        spec = _of_words(text, language, spoken, tokens, names)
    return replace(spec, seen_from=seen_from)


def _of_words(text: str, language: str, spoken: list[str], tokens: list[str], names: Names) -> GoalSpec:
    # "I want to watch" opens a purpose, "I want to go to the" is a command.
    for opened in (after_opener(spoken), after_opener(tokens)):
        if opened is not None and strip_ends(opened, language) == opened:
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
    if bare and set(bare) <= w.BACK:
        return replace(spec, things=(Phrase(IT),))
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


_ORDERS = (
    (w.NEAREST, "nearest"), (w.FARTHEST, "farthest"), (w.LARGEST, "largest"), (w.SMALLEST, "smallest"), (w.TALLEST, "tallest"),
    (w.LOWEST, "lowest"), (w.LEFT, "left"), (w.RIGHT, "right"), (w.ANY, "any"),
)  # fmt: skip


def _choice(head: list[str]) -> tuple[list[str], str, int]:
    """(head without the words of choice, how to choose, which one)."""
    choice, rank, kept = "", 1, []
    most = False
    for position, token in enumerate(head if len(head) > 1 else []):
        found = next((name for table, name in _ORDERS if token in table), "")
        group, value = ATTRIBUTES.get(token, ("", ""))
        if most and group == "size" and value in w.SUPERLATIVES:
            found = w.SUPERLATIVES[value]
        if found:
            choice = found
        elif token in w.ORDINALS:
            rank, choice = w.ORDINALS[token], choice or "ordinal"
        elif token in w.INDEFINITE and position == 0:
            choice = choice or "any"
        elif not (token in w.MOST and position > 0 and len(head) > 2):
            kept.append(token)
        most = token in w.MOST
    if len(head) == 1:
        kept = list(head)
    while choice and len(kept) > 1 and (kept[-1] in w.ARTICLES or kept[-1] in w.SIDE):
        kept.pop()  # "la chaise la plus proche", "la chaise de gauche"
    if kept[:2] == ["one", "of"]:
        kept, choice = kept[2:], "any"
    return kept, choice, rank


def _side(kind: str, tokens: Sequence[str]) -> str:
    """ "left" or "right" where that is all that stands behind a relation: on the left, from the left, de la izquierda."""
    said = {t for t in tokens if t not in w.ARTICLES and t not in w.SIDE}
    if kind not in ("at", "on", "in", "of", "near", "left", "right") or not said:
        return ""
    return "left" if said <= w.LEFT else "right" if said <= w.RIGHT else ""


def noun_phrase(tokens: Sequence[str], language: str, names: Names) -> Phrase:
    """Name, head and attributes of a noun phrase. The longest known name wins; attributes are only words that are known as such."""
    phrase = _noun_phrase(tokens, language, names)
    if phrase.name in w.OUTER_DOORS:
        name = phrase.name if names.known(phrase.name) else "door"
        return Phrase(name, "", (*phrase.attributes, ("place", "outside")))
    return phrase


def _noun_phrase(tokens: Sequence[str], language: str, names: Names) -> Phrase:
    whole = _bare(tokens)
    bare = whole.split()
    attributes = tuple(dict.fromkeys(ATTRIBUTES[t] for t in bare if t in ATTRIBUTES))
    if len(bare) < 2 or names.known(whole):
        return Phrase(whole, "", attributes if len(bare) > 1 else ())
    noun = [t for t in bare if t not in ATTRIBUTES]
    if noun and names.known(" ".join(noun)):
        return Phrase(" ".join(noun), "", attributes)
    tails = [bare[k:] for k in range(1, len(bare))]
    fronts = [bare[:k] for k in range(len(bare) - 1, 0, -1)]
    for part in fronts + tails if language in _NOUN_FIRST else tails + fronts[:0]:
        if names.known(" ".join(part)):
            rest = bare[: -len(part)] if part == bare[-len(part) :] else bare[len(part) :]
            if all(t in ATTRIBUTES for t in rest):
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
            and (any(t not in w.ARTICLES and t not in w.ORDINALS for t in head) or match[1] not in _NEED_HEAD)
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
        if set(bare) <= w.HERE:
            continue
        if side := _side(kind, tokens):
            choice = side
        elif set(bare) & w.ME and kind in ("near", "nearest", "at", "of", "front"):
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
