"""What stands round a goal in a sentence: its language, commands and courtesies, what opens a purpose, from where one looks."""

from __future__ import annotations

from collections.abc import Sequence

from nav_bridge import words as w
from nav_bridge import words_carriers as c
from nav_bridge.functions import OPENERS
from nav_bridge.goal import Names


def find_language(folded: str) -> str:
    """Language by script, then by which function words occur most; English where nothing tells."""
    if any("\u3040" <= c <= "\u30ff" for c in folded):
        return "ja"
    if any("\u4e00" <= c <= "\u9fff" for c in folded):
        return "zh"
    if any("\u0400" <= c <= "\u04ff" for c in folded):
        return "ru"
    tokens = folded.split()
    counts = {
        lang: sum(t in marks or (len(t) > 2 and t in c.CARRIERS[lang]) for t in tokens) + _commands(tokens, lang)
        for lang, marks in w.MARKS.items()
        if lang in c.CARRIERS
    }
    return max(counts, key=lambda lang: counts[lang])  # the first of equals: English


def _commands(tokens: Sequence[str], language: str) -> int:
    """Words of the longest command of a language that a sentence starts with: "geh", "ve a"; 0 for none, or a syllable."""
    found = (k for k in w.COMMANDS[language] if tuple(tokens[: len(k)]) == k and len(" ".join(k)) > 2)
    return max((len(k) for k in found), default=0)


def strip_ends(tokens: list[str], language: str, names: Names) -> list[str]:
    """Without "could you go to", "please" and the like at both ends, in the sentence's language and in English."""
    if language in ("zh", "ja"):
        return _unspaced(tokens, language)
    languages = (language,) if language == "en" else (language, "en")
    if tokens and tokens[0] in c.DELIVER:
        goals = (k for k in range(2, len(tokens) - 1) if tokens[k] == "to" and tokens[k - 1] not in c.NO_DESTINATION)
        tokens = tokens[next(goals, -1) + 1 :]
    while len(tokens) > 1:
        size = max(_command(tokens, lang) for lang in languages) or int(_carries(tokens, languages, names))
        if not size:
            break
        tokens = tokens[size:]
    while tokens:
        found = next((k for k in w.TAILS[language] if tuple(tokens[-len(k) :]) == k and len(k) < len(tokens)), None)
        if found is None:
            break
        tokens = tokens[: -len(found)]
    return tokens


def _command(tokens: Sequence[str], language: str) -> int:
    """Words of the longest command that a sentence of more words starts with; 0 for none."""
    return next((len(k) for k in w.COMMANDS[language] if tuple(tokens[: len(k)]) == k and len(k) < len(tokens)), 0)


def _carries(tokens: Sequence[str], languages: Sequence[str], names: Names) -> bool:
    """Whether the first word only carries the goal: "let s see the ...", but no "stop sign"."""
    first, second = tokens[0], tokens[1]
    if first in c.PARTICLES and second in c.AFTER_PARTICLES:
        return True
    if not any(first in c.CARRIERS[lang] for lang in languages):
        return False
    if second in w.ARTICLES:
        return True
    return not any(names.known(" ".join(tokens[:size])) for size in (2, 3) if size <= len(tokens))


def in_order(clauses: Sequence[list[str]], language: str, names: Names) -> list[str]:
    """The words of a sentence with the thing first: "in the kitchen, the toaster" is "the toaster in the kitchen".

    clauses: its words between commas, folded. A clause that only sends the robot back to what was said ("go to it") goes.
    """
    said = [strip_ends(list(clause), language, names) for clause in clauses if clause]
    said = [
        part for k, part in enumerate(said) if not _says_nothing(part, language, alone=len(said) == 1, first=k == 0)
    ]
    if not said:
        return []
    places: list[str] = []
    while said:
        place = _as_place(said[0], language, names)
        if place and len(said) == 1 and (cut := _new_clause(said[0], language)):
            place, said = _as_place(said[0][: cut[0]], language, names), [[], said[0][cut[1] :]]
        if not place or len(said) == 1:
            break
        places, said = places + place, [strip_ends(said[1], language, names), *said[2:]]
    if places and (starts_relation(said[0], language) or _starts_negation(said[0], language)):
        return [*places, *(token for part in said for token in part)]  # it was no place before a thing after all
    more = [_as_place(part, language, names) or part for part in said[1:]]
    return [*said[0], *places, *(token for part in more for token in part)]


def _says_nothing(tokens: Sequence[str], language: str, *, alone: bool, first: bool) -> bool:
    if alone:
        return False
    only_carries = tuple(tokens) in w.COMMANDS[language] or all(
        t in c.CARRIERS[language] or (t,) in w.TAILS[language] for t in tokens
    )
    return only_carries or (not first and set(tokens) <= w.BACK)


def starts_relation(tokens: Sequence[str], language: str) -> bool:
    return any(tuple(tokens[: len(row[0])]) == row[0] for row in w.RELATIONS[language])


def _starts_negation(tokens: Sequence[str], language: str) -> bool:
    return any(tuple(tokens[: len(n)]) == n for n in w.NEGATIONS.get(language, ()))


def _as_place(tokens: Sequence[str], language: str, names: Names) -> list[str]:
    """A clause that says only where, as the words that may follow a thing; empty for any other clause."""
    if starts_relation(tokens, language):
        return list(tokens)
    cut = _new_clause(tokens, language)
    name = " ".join(t for t in tokens[: cut[0] if cut else len(tokens)] if t not in w.ARTICLES)
    return [_IN[language], *tokens] if names.known_room(name) and not names.known(name) else []


_IN = {"en": "in", "de": "in", "fr": "dans", "es": "en", "it": "in", "ru": "в"}


def _new_clause(tokens: Sequence[str], language: str) -> tuple[int, int] | None:
    """(where a clause ends, where the next begins) in words without a comma; None where there is but one."""
    for at in range(1, len(tokens) - 1):
        there = next((p for p in c.THERE_IS if tuple(tokens[at : at + len(p)]) == p), None)
        if there is not None and at + len(there) < len(tokens):
            return at, at + len(there)
        if tokens[at] in c.ANDS and tokens[at + 1] in c.CARRIERS[language]:
            return at, at + 1
    return None


def _unspaced(tokens: list[str], language: str) -> list[str]:
    line, before = "".join(tokens), ""
    heads = ["".join(k) for k in w.COMMANDS[language]]
    tails = ["".join(k) for k in w.TAILS[language]]
    while line != before:
        before = line
        for head in sorted(heads, key=len, reverse=True):
            if line.startswith(head) and len(head) < len(line):
                line = line[len(head) :]
        for tail in sorted(tails, key=len, reverse=True):
            if line.endswith(tail) and len(tail) < len(line):
                line = line[: -len(tail)]
    return [line]


def after_opener(tokens: Sequence[str]) -> list[str] | None:
    """The words after "something to", "where can I" ..., None when nothing of the kind opens the sentence."""
    start = 1 if tokens and tokens[0] in ("a", "the", "any", "some") else 0
    for at in (0, start):
        for opener in OPENERS:
            if tuple(tokens[at : at + len(opener)]) == opener and len(tokens) > at + len(opener):
                rest = list(tokens[at + len(opener) :])
                deeper = after_opener(rest)
                return rest if deeper is None else deeper
    return None


def strip_viewpoint(tokens: list[str], language: str, *, alone: bool = True) -> tuple[list[str], str]:
    """(the sentence without "seen from the door", "door" or "robot"); "" where nothing of the kind is said.

    alone: the words are the whole sentence, and it does not begin with the place one looks from.
    """
    if language in ("zh", "ja"):
        line = "".join(tokens)
        for words, eye in w.VIEWPOINTS[language]:
            if (phrase := "".join(words)) in line and len(phrase) < len(line):
                return [line.replace(phrase, "", 1)], eye
        return tokens, ""
    for words, eye in w.VIEWPOINTS[language]:
        size = len(words)
        for at in range(int(alone), len(tokens) - size + 1):
            # "farthest from the door" is a choice and no place to look from.
            far = at > 0 and (tokens[at - 1] in w.FARTHEST or tokens[at - 1] in ("away", "distant", "far"))
            if tuple(tokens[at : at + size]) == words and not far:
                return tokens[:at] + tokens[at + size :], eye
    return tokens, ""
