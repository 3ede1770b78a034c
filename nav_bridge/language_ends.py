"""What stands round a goal in a sentence: its language, commands and courtesies, what opens a purpose, from where one looks."""

from __future__ import annotations

from collections.abc import Sequence

from nav_bridge import words as w
from nav_bridge.functions import OPENERS


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


def strip_ends(tokens: list[str], language: str) -> list[str]:
    """Without "go to", "please" and the like at both ends, in the sentence's language and in English."""
    tables = [w.COMMANDS[language], w.COMMANDS["en"]] if language != "en" else [w.COMMANDS["en"]]
    if language in ("zh", "ja"):
        return _unspaced(tokens, language)
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


def _unspaced(tokens: list[str], language: str) -> list[str]:
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


def strip_viewpoint(tokens: list[str], language: str) -> tuple[list[str], str]:
    """(the sentence without "seen from the door", "door" or "robot"); "" where nothing of the kind is said."""
    if language in ("zh", "ja"):
        line = "".join(tokens)
        for words, eye in w.VIEWPOINTS[language]:
            if (phrase := "".join(words)) in line and len(phrase) < len(line):
                return [line.replace(phrase, "", 1)], eye
        return tokens, ""
    for words, eye in w.VIEWPOINTS[language]:
        size = len(words)
        for at in range(1, len(tokens) - size + 1):
            if tuple(tokens[at : at + size]) == words:
                return tokens[:at] + tokens[at + size :], eye
    return tokens, ""
