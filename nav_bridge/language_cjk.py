"""Chinese and Japanese goals: no blanks, the goal last, place words behind their thing (沙发旁边的垃圾桶, ソファの隣のゴミ箱)."""

from __future__ import annotations

import re
from dataclasses import replace

from nav_bridge import words as w
from nav_bridge.functions import MARKERS, find_function
from nav_bridge.goal import IT, GoalSpec, Names, Phrase, Relation
from nav_bridge.words_attributes import ATTRIBUTES
from nav_bridge.words_carriers import OTHER_SIDE

_ONE = tuple(f"一{measure}" for measure in "个把张台只盏扇块件条")
_CHOICES: tuple[tuple[str, str], ...] = (
    *((word, "last") for word in (*(f"最后{one}" for one in _ONE), "最后的", "最後の")),
    *((f"{free}{one}", "any") for free in ("任意", "随便", "随意", "") for one in _ONE),
    *(
        (word, "any")
        for word in (
            "任意的",
            "任意",
            "随便",
            "随意",
            "どれでもいいから",
            "どれでもいい",
            "どれでも",
            "どれか",
            "任意の",
        )
    ),
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
# What must not be so: 不是红色的, 赤くない, 緑ではない.
_UNLIKE = re.compile("(?:不是|非)(?P<zh>[^的]+?)的|(?P<ja>.+?)(?:くない|ではない|じゃない)")
# The one nearest to something else: 离门最近的椅子, ドアに一番近い椅子.
_TOWARDS = re.compile(
    "(?:离|距离?)(?P<zh>[^我的]+?)最(?P<z>近|远)的|(?P<ja>.+?)(?:に|から)(?:一番|最も)(?P<j>近い|遠い)"
)
_BETWEEN = re.compile("(.+?)(?:和|与|跟|と)(.+?)[的の之]?(?:中间|中間|间|間)$")
_JOINTS = {"zh": re.compile("的"), "ja": re.compile("の|にある|にいる|に置いてある|に置かれた|で")}
_SIDES = {"左边": "left", "左侧": "left", "左": "left", "右边": "right", "右侧": "right", "右": "right"}
_LOOSE = {"zh": ("在", "那个", "这个", "上的"), "ja": ("その", "あの", "この")}


def parse_cjk(text: str, line: str, language: str, names: Names) -> GoalSpec:
    """The goal of an unspaced sentence (folded, commands stripped)."""
    if any(marker in line for marker in MARKERS):
        function = find_function((line,))
        if function is not None:
            return GoalSpec(
                text, language, tuple(Phrase(t) for t in function.things), choice="any", function=function.name
            )
    towards = _TOWARDS.match(line)
    if towards is not None and towards.end() < len(line) and (towards["zh"] or towards["ja"]) not in w.ME:
        anchor = Phrase(towards["zh"] or towards["ja"])
        kind = "nearest" if (towards["z"] or towards["j"]) in ("近", "近い") else "farthest"
        spec = parse_cjk(text, line[towards.end() :], language, names)
        return replace(spec, relations=(*spec.relations, Relation(kind, (anchor,))))
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
    spec, line = _unlike(spec, line)
    parts = _merge([p for p in _JOINTS[language].split(line) if p], language)
    for part in parts[:-1]:
        spec = _qualify(spec, part, names)
    room, thing = _room_prefix(parts[-1], names) if parts else ("", line)
    if room and not spec.room:
        spec = replace(spec, room=room)
    attributes, thing = _attributes(thing, names)
    thing = _destination(thing, names)
    pending = tuple(a for r in spec.relations if r.kind == "attribute" for p in r.anchors for a in p.attributes)
    relations = tuple(r for r in spec.relations if r.kind != "attribute")
    return replace(spec, relations=relations, things=(_named(thing, (*pending, *attributes), names),))


def _attribute_of(word: str) -> tuple[str, str] | None:
    """The attribute that a word says; Japanese adjectives without their ending too (赤 of 赤くない)."""
    return ATTRIBUTES.get(word) or ATTRIBUTES.get(f"{word}い")


def _unlike(spec: GoalSpec, line: str) -> tuple[GoalSpec, str]:
    """The goal with what a sentence begins with that the thing must not be, and the rest of the sentence."""
    found = _UNLIKE.match(line)
    so = _attribute_of(found["zh"] or found["ja"]) if found is not None else None
    if found is None or so is None or found.end() == len(line):
        return spec, line
    refused = Phrase("", "", ((f"not {so[0]}", so[1]),))
    return replace(spec, relations=(Relation("attribute", (refused,)),)), line[found.end() :]


def _destination(thing: str, names: Names) -> str:
    """A place without a thing is the thing to go to: 打印机旁边."""
    if names.known(thing):
        return thing
    bases = (thing.removesuffix(word) for word, _ in w.SUFFIX_RELATIONS if thing.endswith(word))
    return next((base for base in bases if names.known(base)), thing)


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
    side = next((s for s in _SIDES if line.startswith(s)), "")
    if choice == "last":
        line = line[len(side) :].removeprefix("的")
        choice = OTHER_SIDE[_SIDES[side]] if side else "farthest"
    found = _RANK.search(line)
    if found is not None and len(found[0]) < len(line):
        said = found[1] or found[2]
        rank, choice = _DIGITS.get(said) or int(said), choice or "ordinal"
        line = line.replace(found[0], "", 1)
        if rank > 1 and choice == "ordinal" and side:  # 左边第二把椅子: counted from there
            line, choice = line[len(side) :].removeprefix("的") or line, _SIDES[side]
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
