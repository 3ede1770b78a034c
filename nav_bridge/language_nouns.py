"""Noun phrases: the name, the head and the attributes of a thing as it is named."""

from __future__ import annotations

from collections.abc import Sequence

from nav_bridge import words as w
from nav_bridge import words_carriers as c
from nav_bridge.goal import Names, Phrase
from nav_bridge.words_attributes import ATTRIBUTES

# Languages in which an adjective follows its noun.
_NOUN_FIRST = ("fr", "es", "it")


def bare_name(tokens: Sequence[str]) -> str:
    """The words after leading articles; articles inside a name stay ("mesa del comedor")."""
    kept = list(tokens)
    while len(kept) > 1 and kept[0] in w.ARTICLES:
        kept = kept[1:]
    return " ".join(kept)


def noun_phrase(tokens: Sequence[str], language: str, names: Names) -> Phrase:
    """Name, head and attributes of a noun phrase. The longest known name wins; attributes are only words that are known as such."""
    phrase = _noun_phrase(tokens, language, names)
    if phrase.name in w.OUTER_DOORS:
        name = phrase.name if names.known(phrase.name) else "door"
        return Phrase(name, "", (*phrase.attributes, ("place", "outside")))
    return phrase


def _noun_phrase(tokens: Sequence[str], language: str, names: Names) -> Phrase:
    whole = bare_name(tokens)
    bare = whole.split()
    attributes = tuple(dict.fromkeys(ATTRIBUTES[t] for t in bare if t in ATTRIBUTES))
    if not names.known(whole):
        bare = [_listed(t, language, names) for t in bare]
        whole = " ".join(bare)
    if len(bare) < 2 or names.known(whole):
        return Phrase(whole, "", attributes if len(bare) > 1 else ())
    shades = c.SHADES if any(group == "colour" for group, _ in attributes) else frozenset()
    noun = [t for t in bare if t not in ATTRIBUTES and t not in w.FILLERS and t not in shades and t not in c.NUMBERS]
    if noun and names.known(" ".join(noun)):
        return Phrase(" ".join(noun), "", attributes)
    tails = [bare[k:] for k in range(1, len(bare))]
    fronts = [bare[:k] for k in range(len(bare) - 1, 0, -1)]
    for part in fronts + tails if language in _NOUN_FIRST else tails + fronts[:0]:
        if names.known(" ".join(part)):
            rest = bare[: -len(part)] if part == bare[-len(part) :] else bare[len(part) :]
            if not set(rest) & set(noun):
                return Phrase(" ".join(part), "", attributes)
            return Phrase(" ".join(noun or bare), " ".join(part), attributes)
    return Phrase(" ".join(noun or bare), "", attributes if noun else ())


def _listed(word: str, language: str, names: Names) -> str:
    """A word in the form in which names are listed, where that is known: zwischen den Sesseln, le poltrone."""
    if word in ATTRIBUTES or word in w.ARTICLES or names.known(word):
        return word
    forms = (word.removesuffix(end) + new for end, new in c.ENDINGS.get(language, ()) if word.endswith(end))
    return next((form for form in forms if len(form) > 2 and names.known(form)), word)
