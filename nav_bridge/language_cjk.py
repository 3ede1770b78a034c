"""Chinese and Japanese goals: no blanks, the goal last, place words behind their thing (沙发旁边的垃圾桶, ソファの隣のゴミ箱)."""

from __future__ import annotations

import re
from dataclasses import replace

from nav_bridge import words as w
from nav_bridge.functions import MARKERS, find_function
from nav_bridge.goal import IT, GoalSpec, Names, Phrase, Relation
from nav_bridge.words_attributes import ATTRIBUTES

_CHOICES: tuple[tuple[str, str], ...] = (
    *((word, "any") for word in ("任意一个", "任意", "随便一个", "一个", "一把", "一张", "一台", "どれか", "任意の")),
    *((word, "nearest") for word in ("离我最近的", "最近的", "最も近い", "一番近い", "近くの")),
    *((word, "farthest") for word in ("最远的", "最も遠い", "一番遠い")),
    *((word, "largest") for word in ("最大的", "最大の", "最も大きい", "一番大きい")),
    *((word, "smallest") for word in ("最小的", "最小の", "最も小さい", "一番小さい")),
    *((word, "tallest") for word in ("最高的", "最も高い", "一番高い")),
    *((word, "left") for word in ("最左边的", "最左的", "一番左の", "左端の")),
    *((word, "right") for word in ("最右边的", "最右的", "一番右の", "右端の")),
)
_RANK = re.compile("第?([一二三四五1-5])(?:番目|つ目|個目)の?|第([一二三四五1-5])[个把张台只盏]?")
_DIGITS = {"一": 1, "二": 2, "三": 3, "四": 4, "五": 5}
# The one not in a room: 不在厨房的, 除了厨房的, 台所以外の, 台所じゃない.
_NOT_IN = re.compile(
    "(?:不在|除了|不是)(?P<zh>.+?)(?:里面的|里的|里|中的|的)|(?P<ja>.+?)(?:以外の|ではない|じゃない|にない)"
)
_BETWEEN = re.compile("(.+?)(?:和|与|跟|と)(.+?)[的の之]?(?:中间|中間|间|間)$")
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
    line, choice, rank = _choice(line)
    for word in _LOOSE[language]:
        if line.startswith(word) and len(word) < len(line):
            line = line[len(word) :]
    spec = GoalSpec(text, language, (), choice=choice, rank=rank)
    if line in w.BACK:
        return replace(spec, things=(Phrase(IT),))
    if names.known(line) or line in w.OUTER_DOORS:
        return replace(spec, things=(_named(line, (), names),))
    if names.known_room(line):
        return replace(spec, room=line, room_is_goal=True)
    no = _NOT_IN.match(line)
    if no is not None and no.end() < len(line) and names.known_room(room := (no["zh"] or no["ja"])):
        spec, line = replace(spec, not_rooms=(room,)), line[no.end() :]
    parts = _merge([p for p in _JOINTS[language].split(line) if p], language)
    for part in parts[:-1]:
        spec = _qualify(spec, part, names)
    room, thing = _room_prefix(parts[-1], names) if parts else ("", line)
    if room and not spec.room:
        spec = replace(spec, room=room)
    attributes, thing = _attributes(thing, names)
    pending = tuple(a for r in spec.relations if r.kind == "attribute" for p in r.anchors for a in p.attributes)
    relations = tuple(r for r in spec.relations if r.kind != "attribute")
    return replace(spec, relations=relations, things=(_named(thing, (*pending, *attributes), names),))


def _named(thing: str, attributes: tuple[tuple[str, str], ...], names: Names) -> Phrase:
    if thing in w.OUTER_DOORS:
        return Phrase(thing if names.known(thing) else "door", "", (*attributes, ("place", "outside")))
    return Phrase(thing, "", attributes)


def _choice(line: str) -> tuple[str, str, int]:
    """(line without the words of choice, how to choose, which one)."""
    choice, rank = "", 1
    for word, name in _CHOICES:
        if word in line and len(word) < len(line):
            line, choice = line.replace(word, "", 1), choice or name
    found = _RANK.search(line)
    if found is not None and len(found[0]) < len(line):
        said = found[1] or found[2]
        rank, choice = _DIGITS.get(said) or int(said), choice or "ordinal"
        line = line.replace(found[0], "", 1)
    return line, choice, rank


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
    both = _BETWEEN.match(part)
    if both is not None:
        anchors = (Phrase(both[1]), Phrase(both[2]))
        return replace(spec, relations=(*spec.relations, Relation("between", anchors)))
    side = {word: kind for word, kind in w.SUFFIX_RELATIONS if kind in ("left", "right")}.get(part)
    if side is not None:
        return replace(spec, choice=side)
    if part in ATTRIBUTES:
        anchor = Phrase("", "", (ATTRIBUTES[part],))
        return replace(spec, relations=(*spec.relations, Relation("attribute", (anchor,))))
    if names.known_room(part):
        return replace(spec, room=spec.room or part)
    placed = _behind_its_thing(spec, part, names)
    if placed is not None:
        return placed
    if part in w.CORNER or part in w.MIDDLE:
        return replace(spec, relations=(*spec.relations, Relation("corner" if part in w.CORNER else "middle")))
    kind = "near" if names.known(part) else "in"
    return replace(spec, relations=(*spec.relations, Relation(kind, (Phrase(part),))))


def _behind_its_thing(spec: GoalSpec, part: str, names: Names) -> GoalSpec | None:
    """The goal with a thing or room and the place word behind it taken into account; None when part ends in no place word."""
    for word, kind in w.SUFFIX_RELATIONS:
        base = part.removesuffix(word)
        if base == part or not base:
            continue
        if names.known_room(base) and kind in ("in", "on"):
            return replace(spec, room=spec.room or base)
        for table, place in ((w.WALL, "wall"), (w.FLOOR, "floor"), (w.CORNER, "corner"), (w.MIDDLE, "middle")):
            if base in table and not (base == "床" and spec.language == "zh"):  # a floor in Japanese, a bed in Chinese
                return replace(spec, relations=(*spec.relations, Relation(place)))
        if base in w.BACK:
            return replace(spec, relations=(*spec.relations, Relation(kind, (Phrase(IT),))))
        room, thing = _room_prefix(base, names)
        spec = replace(spec, room=spec.room or room)
        return replace(spec, relations=(*spec.relations, Relation(kind, (Phrase(thing),))))
    return None


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
        if text[:k] in ATTRIBUTES and names.known(text[k:]):
            return (ATTRIBUTES[text[:k]],), text[k:]
    return (), text
