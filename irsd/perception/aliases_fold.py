"""Pure folding of names for comparison: case, accents, separators, articles, plurals and Russian endings."""

from __future__ import annotations

import re
import unicodedata

_ARTICLES = frozenset(
    word
    for words in (
        "a an the some any this that my our your",
        "der die das den dem des ein eine einen einem einer",
        "le la les l un une des du el los las unos unas lo il gli i uno",
    )
    for word in words.split()
)
# English words that end in s and are no plurals, or whose plural is not regular.
_IRREGULAR = {
    "knives": "knife", "shelves": "shelf", "loaves": "loaf", "leaves": "leaf", "mice": "mouse", "men": "man",
    "people": "person", "children": "child", "women": "woman", "feet": "foot", "teeth": "tooth", "dice": "die",
    "switches": "switch", "couches": "couch", "benches": "bench", "boxes": "box", "dishes": "dish", "torches": "torch",
    "brushes": "brush", "watches": "watch", "matches": "match", "glasses": "glass", "buses": "bus", "vases": "vase",
    "houses": "house", "cases": "case", "hoses": "hose", "purses": "purse", "lens": "lens", "series": "series",
    "gas": "gas", "bus": "bus", "canvas": "canvas", "atlas": "atlas", "iris": "iris", "chaos": "chaos", "yes": "yes",
}  # fmt: skip
# As folded: the breve of й is an accent, so that ой reads ои.
_RUSSIAN_ENDING = re.compile(
    r"(?:ого|его|ому|ему|ыми|ими|ами|ями|ои|еи|ую|юю|ая|яя|ые|ие|ыи|ии|ых|их|ом|ем|ам|ям|ах|ях|а|я|у|ю|е|и|ы|о|ь)$"
)


def fold(name: str) -> str:
    """Lower case, no accents on Latin and Cyrillic letters, separators as single blanks."""
    text = unicodedata.normalize("NFKD", name.casefold())
    text = "".join(c for c in text if not "\u0300" <= c <= "\u036f")
    text = unicodedata.normalize("NFKC", text)
    return " ".join(re.sub(r"[\s\-_'’`./,;:!?()\"]+", " ", text).split())


def squeeze(folded: str) -> str:
    """Without blanks, so that "book shelf", "book-shelf" and "bookshelf" are one key."""
    return folded.replace(" ", "")


def variants(surface: str) -> tuple[str, ...]:
    """The folded spellings under which a surface form is entered: as is, and German umlauts written out (Kuehlschrank)."""
    spelled = surface.casefold()
    for umlaut, written in (("ä", "ae"), ("ö", "oe"), ("ü", "ue")):
        spelled = spelled.replace(umlaut, written)
    return tuple(dict.fromkeys((fold(surface), fold(spelled))))


def singular(word: str) -> str:
    """English singular of a folded word by rule; words that look like no plural come back as they are."""
    if word in _IRREGULAR:
        return _IRREGULAR[word]
    if len(word) < 4 or not word.isascii() or not word.endswith("s") or word.endswith(("ss", "us", "is")):
        return word
    if word.endswith("ies"):
        return word[:-3] + "y"
    if word.endswith(("sses", "ches", "shes", "xes", "zes")):
        return word[:-2]
    return word[:-1]


def without_article(folded: str) -> str:
    """The name after leading articles and determiners; never empty."""
    words = folded.split()
    while len(words) > 1 and words[0] in _ARTICLES:
        words = words[1:]
    return " ".join(words)


def keys_of(name: str, *, squeezed: bool = True) -> tuple[str, ...]:
    """Keys to try in turn for a name: without article, then with its last word singular, then with Russian endings cut."""
    bare = without_article(fold(name))
    words = bare.split()
    one = " ".join([*words[:-1], singular(words[-1])]) if words else bare
    if not squeezed:
        return (bare, one)
    stemmed = " ".join(_stem(word) for word in words)
    return tuple(dict.fromkeys(squeeze(key) for key in (bare, one, stemmed)))


def _stem(word: str) -> str:
    """A Russian word without its case ending (the stem keeps at least three letters); other words as they are."""
    if not word or not "а" <= word[0] <= "я":
        return word
    cut = _RUSSIAN_ENDING.sub("", word)
    return cut if len(cut) >= 3 else word
