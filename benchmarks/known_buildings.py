"""Buildings whose truth is known, as nav_bridge sees them: maps of the embedded world, and folders of ``irsctl replay``.

From the truth alone sentences are made, each with the true things that it may mean: names, synonyms, rooms by their true kind,
neighbours, what lies on what, choices, and things that are not there.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from irsd.config import IrsdConfig, with_pictures
from irsd.ctl.outputs import write_outputs
from irsd.ctl.recordings import NANO, Offline, own_eyes
from irsd.ingest import SensorDecoder
from irsd.perception.encoder import AliasTable, LabelEncoder
from irsd.pipeline import MapPipeline
from irsd.sensors.sync import Synchronizer
from irsd.sim.building import Building
from irsd.sim.robot import RobotSettings
from irsd.sim.world import World, WorldSettings
from nav_bridge.offline import OfflineMap, load_map

TICK_S, EXPLORE_LIMIT_S, SETTLE_S = 0.02, 400.0, 3.0
_REACH_M = 0.1  # points of a found thing lie in the box of the true one, or so far beyond it
_BESIDE_M, _APART_M = 0.5, 1.5  # gaps at which people say next to, and no longer
_ON_M = 0.12


@dataclass(frozen=True, slots=True)
class TrueThing:
    """A thing of the truth, map frame. rooms: kinds of the rooms that it may be said to be in."""

    id: int
    names: tuple[str, ...]
    rooms: tuple[str, ...]
    low_m: NDArray[np.float64]
    high_m: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Sentence:
    """A goal in words. accept: ids of the true things that it may mean; empty where nothing fits."""

    text: str
    kind: str
    accept: frozenset[int]


@dataclass(frozen=True, slots=True)
class Known:
    """A map with its truth. true_of: id of the true thing that each instance is (absent: none)."""

    name: str
    map: OfflineMap
    things: tuple[TrueThing, ...]
    true_of: Mapping[str, int]
    sentences: tuple[Sentence, ...]


def explored(seed: int, cache: Path, encoder: LabelEncoder, *, nano: bool = False) -> Known:
    """The building of a seed, explored by the simulated sensors with exact odometry: what is judged here is language, not drift.

    nano: seen with irsd's own eyes, in place of the simulated detector.
    """
    folder = cache / (f"building-{seed}-nano" if nano else f"building-{seed}")
    exact = RobotSettings(odom_scale_error=0.0, odom_yaw_rad_per_sqrt_m=0.0, odom_turn_error=0.0)
    world = World(seed, replace(WorldSettings(), robot=exact, detections=not nano), sensing=not folder.exists())
    if not folder.exists():
        config = with_pictures(IrsdConfig()) if nano else IrsdConfig()
        eyes, namer = own_eyes(config, NANO, encoder) if nano else (None, None)
        pipeline = MapPipeline(config.pipeline, encoder, map_id=f"building-{seed}", eyes=eyes, namer=namer)
        offline = Offline(SensorDecoder(config.ingest), Synchronizer(config.sync), pipeline, eyes)
        left_s = SETTLE_S
        while left_s > 0 and (world.now_ns - world.start_ns) * 1e-9 < EXPLORE_LIMIT_S:
            left_s -= TICK_S if world.phase != "exploring" else 0.0
            for message in world.step(TICK_S):
                offline.feed(message)
        graph = offline.finish().snapshot
        write_outputs(folder, graph, pipeline.arrays(), pipeline.navigation_grid(), {})
    known = load_map(folder)
    things = things_of(world.building)
    sentences = made_sentences(things, encoder.aliases, np.random.default_rng([seed, 71]))
    return Known(f"building {seed}", known, things, matched(known, things), sentences)


def things_of(building: Building) -> tuple[TrueThing, ...]:
    return tuple(
        TrueThing(
            t.id,
            (t.label, *t.synonyms),
            (building.rooms[t.room].label,) if t.room >= 0 else (),
            t.aabb_min_m,
            t.aabb_max_m,
        )
        for t in building.things
        if not t.structural
    )


def recorded(folder: Path, data: Path, aliases: AliasTable) -> Known:
    """A folder of ``irsctl replay`` on a recording with ground truth; its own sentences, and ours."""
    document = json.loads((data / "ground_truth.json").read_text())
    start = document["start_pose"]
    cos, sin = np.cos(-start["yaw"]), np.sin(-start["yaw"])
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    names = {room["id"]: room["name"] for room in document["rooms"]}
    things = []
    for item in document["instances"]:
        corners = np.array(np.meshgrid(*np.array([item["aabb"]["min"], item["aabb"]["max"]]).T)).reshape(3, -1).T
        corners = (corners - [start["x"], start["y"], 0.0]) @ turn.T
        rooms = tuple(names[room] for room in item["rooms_accepted"] if room in names)
        if item["observable"] and not item["structural"]:
            things.append(
                TrueThing(item["id"], (item["label"], *item["synonyms"]), rooms, corners.min(0), corners.max(0))
            )
    known = load_map(folder)
    own = tuple(
        Sentence(q["text"], "recorded", frozenset(q["accept"]) if q["resolves"] else frozenset())
        for q in document["queries"]
    )
    made = made_sentences(tuple(things), aliases, np.random.default_rng(71))
    return Known(data.name, known, tuple(things), matched(known, tuple(things)), own + made)


def matched(known: OfflineMap, things: Sequence[TrueThing]) -> dict[str, int]:
    """Per instance the true thing in whose box most of its points lie; of those that hold nearly as many, the smallest."""
    out = {}
    for node in known.graph.instances:
        points = known.points_of(node.id)
        if not len(points):
            continue
        inside = np.array(
            [((points >= t.low_m - _REACH_M) & (points <= t.high_m + _REACH_M)).all(1).mean() for t in things]
        )
        if inside.max() >= 0.5:
            volume = np.array([float(np.prod(t.high_m - t.low_m + 0.1)) for t in things])
            out[node.id] = things[int(np.where(inside >= inside.max() - 0.1, volume, np.inf).argmin())].id
    return out


def made_sentences(
    things: Sequence[TrueThing], aliases: AliasTable, rng: np.random.Generator, absent: int = 25
) -> tuple[Sentence, ...]:
    """Sentences about a truth; the same truth and generator give the same."""

    def called(name: str) -> list[TrueThing]:
        return [t for t in things if any(n == name or aliases.is_a(n, name) for n in t.names)]

    def ids(found: Sequence[TrueThing]) -> frozenset[int]:
        return frozenset(t.id for t in found)

    out: list[Sentence] = []
    rooms = sorted({room for t in things for room in t.rooms})
    for label in sorted({t.names[0] for t in things}):
        alike = called(label)
        out.append(Sentence(f"the {label}", "name", ids(alike)))
        out.append(Sentence(f"any {label}", "any", ids(alike)))
        for other in sorted({n for t in alike for n in t.names[1:]})[:2]:
            out.append(Sentence(f"go to the {other}", "synonym", ids(called(other))))
        here = {room for t in alike for room in t.rooms}
        for room in rooms:
            if room in here:
                out.append(Sentence(f"the {label} in the {room}", "room", ids([t for t in alike if room in t.rooms])))
        if elsewhere := [room for room in rooms if room not in here]:
            out.append(Sentence(f"the {label} in the {rng.choice(elsewhere)}", "absent", frozenset()))
    out += _related(things, called)
    missing = [
        n for n in aliases.things if not any(aliases.is_a(m, n) or aliases.is_a(n, m) for t in things for m in t.names)
    ]
    out += [Sentence(f"the {name}", "absent", frozenset()) for name in rng.choice(missing, absent, replace=False)]
    return tuple(out)


def _related(things: Sequence[TrueThing], called) -> list[Sentence]:  # type: ignore[no-untyped-def]
    out: dict[str, Sentence] = {}
    for t in things:
        for other in things:
            if other is t or not set(t.rooms) & set(other.rooms) or t.names[0] == other.names[0]:
                continue
            name, anchor = t.names[0], other.names[0]
            alike, anchors = called(name), called(anchor)
            gaps = {a.id: min((plan_gap(a, b) for b in anchors if b.id != a.id), default=np.inf) for a in alike}
            if plan_gap(t, other) < _BESIDE_M and not any(_BESIDE_M <= gap < _APART_M for gap in gaps.values()):
                near = frozenset(k for k, gap in gaps.items() if gap < _BESIDE_M)
                text = f"the {name} next to the {anchor}"
                out[text] = Sentence(text, "near", near)
            resting = frozenset(a.id for a in alike if any(rests(a, b) for b in anchors if b.id != a.id))
            if t.id in resting and rests(t, other):
                text = f"the {name} on the {anchor}"
                out[text] = Sentence(text, "on", resting)
    return [out[text] for text in sorted(out)]


def plan_gap(a: TrueThing, b: TrueThing) -> float:
    """Metres between two boxes in plan, 0 where they overlap."""
    return float(np.hypot(*np.maximum(0.0, np.maximum(a.low_m - b.high_m, b.low_m - a.high_m)[:2])))


def rests(a: TrueThing, b: TrueThing) -> bool:
    """Whether a's box stands on b's."""
    middle = (a.low_m + a.high_m)[:2] / 2
    above = bool((middle >= b.low_m[:2]).all() and (middle <= b.high_m[:2]).all())
    return above and abs(float(a.low_m[2] - b.high_m[2])) <= _ON_M
