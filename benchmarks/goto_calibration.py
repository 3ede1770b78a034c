"""Are the scores of goals chances? Sentences on known buildings, how often each score was right, and the curve fitted anew."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from known_buildings import Known, Sentence, explored, recorded

from irsd.perception.encoder import LabelEncoder
from nav_bridge.calibration import isotonic
from nav_bridge.config import BridgeSettings
from nav_bridge.planner import Planner, World
from nav_bridge.resolution import Ambiguous, Resolution, Resolved
from nav_bridge.resolve import ResolveSettings

_BINS = (0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 0.95, 1.0)


class Case(NamedTuple):
    """A candidate that an answer gave. chosen: the robot would have set off to it; meant: how far the sentence means it, 1 / k of k
    that it fits. by_chance: named by irsd's own eyes."""

    evidence: float
    score: float
    chosen: bool
    meant: float
    by_chance: bool


def calibrate(seeds: Iterable[int], folders: Iterable[Path], truth: Path, cache: Path, *, nano: bool = False) -> str:
    """The tables in Markdown. cache: folder that keeps the explored buildings; nano: they are seen with irsd's own eyes."""
    encoder = LabelEncoder.load()
    known = [recorded(folder, truth, encoder.aliases) for folder in folders]
    known += [explored(seed, cache, encoder, nano=nano) for seed in seeds]
    # Nothing is held back for a small chance here: the curve is to be fitted on all answers.
    settings = replace(BridgeSettings(), resolve=replace(ResolveSettings(), min_chance=0.0))
    cases: list[Case] = []
    kinds: dict[str, Counter[str]] = defaultdict(Counter)
    for building in known:
        planner = Planner(encoder, settings)
        world = World(building.map.graph, lambda: None, building.map.points_of, (0.0, 0.0, 0.0))
        for sentence in building.sentences:
            _, resolution = planner.resolve(sentence.text, world)
            cases += _cases(resolution, sentence, building)
            kinds[sentence.kind][_verdict(resolution, sentence, building)] += 1
    names = ", ".join(building.name for building in known)
    count = sum(len(building.sentences) for building in known)
    return "\n".join(
        [
            f"{count} sentences on {names}.",
            "",
            *_kinds(kinds),
            "",
            *_curve(cases),
            "",
            *_fit(cases),
        ]
    )


def _cases(resolution: Resolution, sentence: Sentence, building: Known) -> list[Case]:
    if isinstance(resolution, Resolved):
        given, chosen = (resolution.target,), True
    elif isinstance(resolution, Ambiguous):
        given, chosen = resolution.candidates, False
    else:
        return []
    fits = [building.true_of.get(c.instance) in sentence.accept for c in given]
    # Of several that the sentence fits it means one, and each is as likely as the others.
    share = 1.0 / max(1, sum(fits)) if not chosen else 1.0
    return [Case(c.evidence, c.score, chosen, share * fit, c.by_chance) for c, fit in zip(given, fits, strict=True)]


def _verdict(resolution: Resolution, sentence: Sentence, building: Known) -> str:
    if isinstance(resolution, Resolved):
        return "right" if building.true_of.get(resolution.target.instance) in sentence.accept else "wrong"
    if isinstance(resolution, Ambiguous):
        found = {building.true_of.get(c.instance) for c in resolution.candidates} & sentence.accept
        return "right" if len(sentence.accept) > 1 and found else "asks"
    return "not found" if sentence.accept else "right"


def _kinds(kinds: dict[str, Counter[str]]) -> list[str]:
    rows = ["| sentences | n | right | asks | not found | wrong thing |", "| --- | --- | --- | --- | --- | --- |"]
    for kind, verdicts in kinds.items():
        n = sum(verdicts.values())
        rows.append(
            f"| {kind} | {n} | {verdicts['right'] / n:.3f} | {verdicts['asks']} | {verdicts['not found']} | {verdicts['wrong']} |"
        )
    return rows


def _curve(cases: list[Case]) -> list[str]:
    """The reliability curve: of the candidates with a score about so high, how many were meant."""
    score, meant = np.array([c.score for c in cases]), np.array([c.meant for c in cases])
    rows = ["| score | candidates | mean score | meant |", "| --- | --- | --- | --- |"]
    error = 0.0
    for low, high in pairwise(_BINS):
        here = (score >= low) & ((score < high) | (high == 1.0))
        if here.any():
            rows.append(
                f"| {low:.2f} .. {high:.2f} | {here.sum()} | {score[here].mean():.3f} | {meant[here].mean():.3f} |"
            )
            error += here.mean() * abs(score[here].mean() - meant[here].mean())
    return [*rows, "", f"Expected calibration error: {error:.3f}."]


def _fit(cases: list[Case]) -> list[str]:
    rows = []
    for by_chance, curve in ((False, "CURVE"), (True, "CURVE_OF_CHANCES")):
        chosen = [c for c in cases if c.chosen and c.by_chance == by_chance]
        if not chosen:
            continue
        steps = isotonic(np.array([c.evidence for c in chosen]), np.array([c.meant for c in chosen], np.float64))
        rows += [f"Fitted anew on the answers with one target (`{curve}` of `nav_bridge/calibration.py`):", ""]
        rows += ["| evidence | answers | meant |", "| --- | --- | --- |"]
        rows += [f"| {evidence:.3f} | {count} | {share:.3f} |" for evidence, share, count in steps]
    return rows
