"""Rules in words about where the robot may not go: "never in server room", "not within 1 m of fume hood 08:00-18:00".

A rule names nodes of the graph as a goal would; it holds for every room or thing that fits, as the graph is when it is asked.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from irsd.core.errors import ConfigError
from irsd.core.settings import setting
from irsd.graph.model import GraphSnapshot, InstanceNode
from nav_bridge.approach import in_polygon
from nav_bridge.evidence import MATCH, Knowledge
from nav_bridge.language import noun_phrase
from nav_bridge.route import CostMap
from nav_bridge.words import fold

_HOURS = r"(?:\s+(?:from\s+|between\s+)?(\d{1,2}):(\d{2})\s*(?:-|to|and)\s*(\d{1,2}):(\d{2}))?"
_IN = re.compile(rf"(?:never|not|no) (?:go )?(?:in|into|inside|enter) (?:(?:the|a|any) )?`?([^`]+?)`?{_HOURS}", re.I)
_NEAR = re.compile(
    r"(?:never|not|no) (?:closer than|within|nearer than) (\d+(?:\.\d+)?) ?(m|cm) (?:of|to|from) "
    rf"(?:(?:the|a|an|any) )?`?([^`]+?)`?{_HOURS}",
    re.I,
)
_DAY_MIN = 24 * 60


@dataclass(frozen=True, slots=True)
class GeofenceSettings:
    """Where the robot may not go."""

    rules: tuple[str, ...] = setting(
        (), 'such as "never in server room", "not within 1 m of fume hood 08:00-18:00"; hours are local time'
    )


@dataclass(frozen=True, slots=True)
class Rule:
    """One rule. name: a room (metres None) or a thing, as said; hours: minutes of the day [begin, end), None = always."""

    text: str
    name: str
    metres: float | None
    hours: tuple[int, int] | None

    def holds(self, minute: int | None) -> bool:
        """At a minute of the day; None: at some time of the day."""
        if self.hours is None or minute is None:
            return True
        begin, end = self.hours
        return begin <= minute < end if begin <= end else minute >= begin or minute < end


def parse_rule(text: str) -> Rule:
    """ConfigError when it can't be understood: a rule that does nothing would be worse than none."""
    line = " ".join(text.split())
    near = _NEAR.fullmatch(line)
    inside = None if near else _IN.fullmatch(line)
    if near is not None:
        metres = float(near[1]) * (0.01 if near[2].lower() == "cm" else 1.0)
        return Rule(line, fold(near[3]), metres, _hours(line, near.groups()[3:]))
    if inside is not None:
        return Rule(line, fold(inside[1]), None, _hours(line, inside.groups()[1:]))
    raise ConfigError(
        f'geofence rule {text!r}: expected "never in ROOM" or "not within N m of THING", and perhaps hours "08:00-18:00"'
    )


def _hours(text: str, parts: Sequence[str | None]) -> tuple[int, int] | None:
    if parts[0] is None:
        return None
    h0, m0, h1, m1 = (int(part or 0) for part in parts)
    begin, end = 60 * h0 + m0, 60 * h1 + m1
    if max(m0, m1) > 59 or max(begin, end) > _DAY_MIN:
        raise ConfigError(f"geofence rule {text!r}: there is no such time of the day")
    return begin, end


class Geofence:
    """The rules, and what they forbid in a graph. One owner, one thread (names are cached). ConfigError for a rule in bad words."""

    def __init__(self, settings: GeofenceSettings, knowledge: Knowledge, body_m: float) -> None:
        """body_m: radius of the robot: no part of it may be where a rule forbids."""
        self._rules = tuple(parse_rule(text) for text in settings.rules)
        self._knowledge = knowledge
        self._body_m = body_m

    def __bool__(self) -> bool:
        return bool(self._rules)

    def apply(self, costs: CostMap, graph: GraphSnapshot, minute: int | None) -> CostMap:
        """The map with everything forbidden at this minute of the day (None: at any) as good as walled off."""
        zone = np.zeros(costs.passable.shape, bool)
        for rule in self._rules:
            if rule.holds(minute):
                zone |= self._zone(rule, costs, graph)
        if not zone.any():
            return costs
        away = ndimage.distance_transform_edt(~zone, sampling=costs.frame.resolution_m).astype(np.float32)
        return replace(costs, clear_m=np.minimum(costs.clear_m, away), passable=costs.passable & (away >= self._body_m))

    def broken(
        self, costs: CostMap, graph: GraphSnapshot, minute: int | None, places_xy: NDArray[np.floating]
    ) -> tuple[str, ...]:
        """The rules that places [N, 2] on a map break, in words."""
        found = []
        for rule in self._rules:
            zone = self._zone(rule, costs, graph) if rule.holds(minute) else np.zeros((0, 0), bool)
            if zone.any():
                points = costs.frame.centres_of(np.argwhere(zone))
                away = np.hypot(*(points[:, None] - np.asarray(places_xy)[None, :, :2]).transpose(2, 0, 1))
                if away.min() < self._body_m:
                    found.append(rule.text)
        return tuple(found)

    def _zone(self, rule: Rule, costs: CostMap, graph: GraphSnapshot) -> NDArray[np.bool_]:
        """bool [H, W]: where the rule forbids any part of the robot."""
        zone = np.zeros(costs.passable.shape, bool)
        xy = costs.frame.centres_of(np.argwhere(np.ones(zone.shape, bool)))
        if rule.metres is None:
            for room in graph.rooms:
                if len(room.polygon_xy) >= 3 and self._knowledge.room_grade(rule.name, room) >= MATCH:
                    zone |= in_polygon(xy, room.polygon_xy).reshape(zone.shape)
            return zone
        phrase = noun_phrase(rule.name.split(), "en", self._knowledge.names)
        labels = self._knowledge.label_scores(phrase, self._knowledge.follow(graph))
        for node, label in zip(graph.instances, labels, strict=True):
            if (node.id.casefold() == rule.name or label >= _NAMED) and node.state != "gone":
                zone |= (_to_box(xy, node) <= rule.metres).reshape(zone.shape)
        return zone


_NAMED = 0.4  # label evidence from which a thing is kept away from; less than a goal needs: caution costs little


def _to_box(xy: NDArray[np.floating], node: InstanceNode) -> NDArray[np.float64]:
    """[N] plan distance of places [N, 2] to a thing's upright box."""
    cos, sin = np.cos(node.obb_yaw_rad), np.sin(node.obb_yaw_rad)
    local = (np.asarray(xy, np.float64) - node.obb_center_m[:2]) @ np.array([[cos, -sin], [sin, cos]])
    outside = np.maximum(np.abs(local) - np.asarray(node.obb_size_m[:2]) / 2, 0.0)
    return np.asarray(np.hypot(*outside.T), np.float64)
