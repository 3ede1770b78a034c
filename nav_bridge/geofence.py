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
from irsd.graph.model import GraphSnapshot, InstanceNode, RoomNode
from nav_bridge.approach import in_polygon
from nav_bridge.evidence import MATCH, Knowledge
from nav_bridge.judge import label_or_id
from nav_bridge.language_nouns import noun_phrase
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
        self._last: tuple[CostMap, GraphSnapshot, tuple[Rule, ...], CostMap] | None = None
        self._idle: tuple[GraphSnapshot, tuple[str, ...]] | None = None

    def __bool__(self) -> bool:
        return bool(self._rules)

    def apply(self, costs: CostMap, graph: GraphSnapshot, minute: int | None) -> CostMap:
        """The map with everything forbidden at this minute of the day (None: at any) as good as walled off."""
        rules = tuple(rule for rule in self._rules if rule.holds(minute))
        if self._last is not None and self._last[0] is costs and self._last[1] is graph and self._last[2] == rules:
            return self._last[3]
        zone = np.zeros(costs.passable.shape, bool)
        for rule in rules:
            zone |= self._zone(rule, costs, graph)
        fenced = costs
        if zone.any():
            away = self._away(zone, costs)
            free = costs.passable & (away >= self._body_m)
            fenced = replace(costs, clear_m=np.minimum(costs.clear_m, away), passable=free)
        self._last = (costs, graph, rules, fenced)
        return fenced

    def _away(self, zone: NDArray[np.bool_], costs: CostMap) -> NDArray[np.float32]:
        """[H, W] distance of each cell to a zone that is not empty, metres."""
        return np.asarray(ndimage.distance_transform_edt(~zone, sampling=costs.frame.resolution_m), np.float32)

    def broken(
        self, costs: CostMap, graph: GraphSnapshot, minute: int | None, places_xy: NDArray[np.floating]
    ) -> tuple[str, ...]:
        """The rules that places [N, 2] on a map break, in words."""
        cells = costs.frame.cells_of(np.asarray(places_xy, np.float64)[:, :2])
        rows, cols = cells[costs.frame.inside(cells)].T
        found = []
        for rule in self._rules:
            zone = self._zone(rule, costs, graph) if rule.holds(minute) else np.zeros((0, 0), bool)
            if zone.any() and (self._away(zone, costs)[rows, cols] < self._body_m).any():
                found.append(rule.text)
        return tuple(found)

    def idle(self, graph: GraphSnapshot) -> tuple[str, ...]:
        """In words, the rules that name nothing this graph has: by a wrong name, or because it was not seen yet."""
        if self._idle is None or self._idle[0] is not graph:
            found = (
                f"rule {rule.text!r} keeps the robot out of nothing: no {rule.name} is known here"
                for rule in self._rules
                if not self._rooms(rule, graph) and not self._things(rule, graph)
            )
            self._idle = (graph, tuple(found))
        return self._idle[1]

    def _rooms(self, rule: Rule, graph: GraphSnapshot) -> list[RoomNode]:
        """The rooms a rule forbids."""
        grade = self._knowledge.room_grade
        return [
            r for r in graph.rooms if rule.metres is None and len(r.polygon_xy) >= 3 and grade(rule.name, r) >= MATCH
        ]

    def _things(self, rule: Rule, graph: GraphSnapshot) -> list[InstanceNode]:
        """The things a rule keeps away from."""
        if rule.metres is None:
            return []
        phrase = noun_phrase(rule.name.split(), "en", self._knowledge.names)
        index = self._knowledge.follow(graph)
        near = (label_or_id(phrase, index, self._knowledge) >= _NAMED) & (index.exists > 0)
        return [graph.instances[k] for k in np.flatnonzero(near)]

    def _zone(self, rule: Rule, costs: CostMap, graph: GraphSnapshot) -> NDArray[np.bool_]:
        """bool [H, W]: where the rule forbids any part of the robot."""
        zone = np.zeros(costs.passable.shape, bool)
        for room in self._rooms(rule, graph):
            x0, y0, x1, y1 = room.aabb_xy
            part, xy = _window(costs, (x0, y0), (x1, y1))
            zone[part] |= in_polygon(xy, room.polygon_xy).reshape(zone[part].shape)
        for node in self._things(rule, graph):
            reach = np.hypot(*node.obb_size_m[:2]) / 2 + float(rule.metres or 0.0)
            centre = np.array(node.obb_center_m[:2])
            part, xy = _window(costs, centre - reach, centre + reach)
            zone[part] |= (_to_box(xy, node) <= float(rule.metres or 0.0)).reshape(zone[part].shape)
        return zone


def _window(
    costs: CostMap, low_xy: Sequence[float] | NDArray[np.float64], high_xy: Sequence[float] | NDArray[np.float64]
) -> tuple[tuple[slice, slice], NDArray[np.float64]]:
    """The cells of a map between two corners, and their centres [N, 2] row after row."""
    limit = np.array(costs.passable.shape)
    ends = costs.frame.cells_of(np.array([low_xy, high_xy], np.float64))
    (r0, c0), (r1, c1) = np.clip(ends[0], 0, limit), np.clip(ends[1] + 1, 0, limit)
    rows, cols = np.mgrid[r0:r1, c0:c1]
    return (slice(r0, r1), slice(c0, c1)), costs.frame.centres_of(np.stack([rows.ravel(), cols.ravel()], 1))


_NAMED = 0.4  # label evidence from which a thing is kept away from; less than a goal needs: caution costs little


def _to_box(xy: NDArray[np.floating], node: InstanceNode) -> NDArray[np.float64]:
    """[N] plan distance of places [N, 2] to a thing's upright box."""
    cos, sin = np.cos(node.obb_yaw_rad), np.sin(node.obb_yaw_rad)
    local = (np.asarray(xy, np.float64) - node.obb_center_m[:2]) @ np.array([[cos, -sin], [sin, cos]])
    outside = np.maximum(np.abs(local) - np.asarray(node.obb_size_m[:2]) / 2, 0.0)
    return np.asarray(np.hypot(*outside.T), np.float64)
