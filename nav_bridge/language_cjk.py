"""Chinese and Japanese goals: no blanks, the goal last, place words behind their thing (沙发旁边的垃圾桶, ソファの隣のゴミ箱)."""

from __future__ import annotations

import re
from dataclasses import replace

from nav_bridge import words as w
from nav_bridge.functions import MARKERS, find_function
from nav_bridge.language import GoalSpec, Names, Phrase, Relation

_ANY = ("任意一个", "任意", "随便一个", "一个", "一把", "一张", "一台", "どれか", "任意の")
_NEAREST = ("最近的", "离我最近的", "最も近い", "一番近い", "近くの")
_JOINTS = {"zh": re.compile("的"), "ja": re.compile("の|にある|にいる|に置いてある|に置かれた|で")}
_LOOSE = {"zh": ("在", "那个", "这个", "上的"), "ja": ("その", "あの", "この")}


def parse_cjk(text: str, line: str, language: str, names: Names) -> GoalSpec:
    """The goal of an unspaced sentence (folded, commands stripped)."""
    if any(marker in line for marker in MARKERS):
        function = find_function((line,))
        if function is not None:
            return GoalSpec(
                text, language, tuple(Phrase(t) for t in function.things), choice="any", function=function.name
            )
    choice = ""
    for table, name in ((_NEAREST, "nearest"), (_ANY, "any")):
        for word in table:
            if word in line and len(word) < len(line):
                line, choice = line.replace(word, "", 1), choice or name
    for word in _LOOSE[language]:
        if line.startswith(word) and len(word) < len(line):
            line = line[len(word) :]
    spec = GoalSpec(text, language, (), choice=choice)
    if names.known(line):
        return replace(spec, things=(Phrase(line),))
    if names.known_room(line):
        return replace(spec, room=line, room_is_goal=True)
    parts = _merge([p for p in _JOINTS[language].split(line) if p], language)
    for part in parts[:-1]:
        spec = _qualify(spec, part, names)
    room, thing = _room_prefix(parts[-1], names) if parts else ("", line)
    if room and not spec.room:
        spec = replace(spec, room=room)
    attributes, thing = _attributes(thing, names)
    pending = tuple(a for r in spec.relations if r.kind == "attribute" for p in r.anchors for a in p.attributes)
    relations = tuple(r for r in spec.relations if r.kind != "attribute")
    return replace(spec, relations=relations, things=(Phrase(thing, "", (*pending, *attributes)),))


def _merge(parts: list[str], language: str) -> list[str]:
    """Japanese joins the place word by の as well (ソファ の 隣): put it back behind its thing."""
    out: list[str] = []
    suffixes = {word for word, _ in w.SUFFIX_RELATIONS}
    for k, part in enumerate(parts):
        if language == "ja" and out and part in suffixes and k < len(parts) - 1:
            out[-1] += part
        else:
            out.append(part)
    return out


def _qualify(spec: GoalSpec, part: str, names: Names) -> GoalSpec:
    """The goal with one part before it taken into account: a room, a colour, or a thing with a place word."""
    part = part.removeprefix("在")
    if part in w.ATTRIBUTES:
        anchor = Phrase("", "", (w.ATTRIBUTES[part],))
        return replace(spec, relations=(*spec.relations, Relation("attribute", (anchor,))))
    if names.known_room(part):
        return replace(spec, room=spec.room or part)
    for word, kind in w.SUFFIX_RELATIONS:
        base = part.removesuffix(word)
        if base == part or not base:
            continue
        if names.known_room(base) and kind in ("in", "on"):
            return replace(spec, room=spec.room or base)
        if base in w.WALL or base in w.FLOOR:
            return replace(spec, relations=(*spec.relations, Relation("wall" if base in w.WALL else "floor")))
        room, thing = _room_prefix(base, names)
        spec = replace(spec, room=spec.room or room)
        return replace(spec, relations=(*spec.relations, Relation(kind, (Phrase(thing),))))
    if part in w.CORNER:
        return replace(spec, relations=(*spec.relations, Relation("corner")))
    kind = "near" if names.known(part) else "in"
    return replace(spec, relations=(*spec.relations, Relation(kind, (Phrase(part),))))


def _room_prefix(text: str, names: Names) -> tuple[str, str]:
    """("卧室", "电视") of 卧室电视; ("", text) when no known room stands before a known thing."""
    if names.known(text):
        return "", text
    for k in range(len(text) - 1, 0, -1):
        room = re.sub("(里面|里|内|中)$", "", text[:k]) or text[:k]
        if names.known_room(room) and names.known(text[k:]):
            return room, text[k:]
    return "", text


def _attributes(text: str, names: Names) -> tuple[tuple[tuple[str, str], ...], str]:
    """Attributes that stand directly before a known thing (赤い椅子, 红椅子)."""
    if names.known(text):
        return (), text
    for k in range(len(text) - 1, 0, -1):
        if text[:k] in w.ATTRIBUTES and names.known(text[k:]):
            return (w.ATTRIBUTES[text[:k]],), text[k:]
    return (), text
