"""The chain of the paper on one picture: prompts -> boxes -> masks -> three views of each mask -> embedding and names.

Knows of no clock: each run of a model goes through a ``Runner``, which may refuse it or end it early, and the chain makes the best of
what it got. What was found and not looked into is said to be unsure, so that nothing follows from it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from irsd.core.types import Detections
from irsd.perception.budget import FULL, Rung, Stage
from irsd.perception.fuse_views import VIEWS, fuse, views_of
from irsd.perception.job import PerceptionJob, Sight
from irsd.perception.kernels import Bools, Floats, Rows, best_boxes, paint, share_with_known
from irsd.perception.roles import Detector, ImageEncoder, Masks, Segmenter, Tagger
from irsd.perception.settings import PerceptionSettings
from irsd.perception.tagging import ZeroShotTagger

T = TypeVar("T")

_UNNAMED = "object"


class Runner(Protocol):
    """Who decides whether and when a model runs, and counts what it costs."""

    def run_stage(self, stage: Stage, items: int, work: Callable[[], T]) -> T | None:
        """The work's result; None when it was refused or ended early."""
        ...

    def batch(self, stage: Stage, most: int) -> int:
        """How many of ``most`` items should go into one run."""
        ...

    def drop(self, what: str, amount: int) -> None:
        """Note what was left out."""
        ...

    def pictured(self, masks: int, crops: int) -> None:
        """Note how many masks a picture has, and how many crops of them would be worth embedding."""
        ...


class Everything(Protocol):
    """Masks without words, for a chain without a detector."""

    def segment_all(self, image_rgb: NDArray[np.uint8]) -> Masks:
        """Masks of all that can be told apart."""
        ...


class BoxMasks(Protocol):
    """Masks of boxes from the map's depth, for a chain without a segmenter."""

    def __call__(self, boxes_px: Floats, sight: Sight, hw: tuple[int, int]) -> Masks: ...


@dataclass(frozen=True, slots=True)
class ModelSet:
    """Opened models by role. names: what embeddings are called, where a text encoder shares their space. tagger: the model of that
    role, or one by resemblance. cancel: ends what runs; clear: lets runs start again."""

    image_encoder: ImageEncoder
    names: ZeroShotTagger | None
    tagger: Tagger | None
    detector: Detector | None
    segmenter: Segmenter | None
    everything: Everything | None
    box_masks: BoxMasks
    cancel: Callable[[], None]
    clear: Callable[[], None]


@dataclass(frozen=True, slots=True)
class _Found:
    """Masks with what the detector said of them: label '' where it said nothing; row of the known thing or -1."""

    masks: Bools
    scores: Floats
    labels: tuple[str, ...]
    known: Rows
    ids_px: NDArray[np.uint16]


class Chain:
    """Owner of the models' order and of the vocabulary's vectors. One thread."""

    def __init__(self, settings: PerceptionSettings, models: ModelSet, vocabulary: tuple[str, ...]) -> None:
        """vocabulary: names of things, what the detector is asked for where no tags are."""
        self.settings, self.models, self.vocabulary = settings, models, vocabulary

    @property
    def dimension(self) -> int:
        """Of the embeddings."""
        return self.models.image_encoder.dimension

    def see(self, job: PerceptionJob, rung: Rung, runner: Runner) -> Detections | None:
        """What the job's picture shows; None when not even the first stage could run."""
        assert job.view.image is not None
        full_hw = job.view.image.bgr.shape[:2]
        image, scale = _reduced(job.view.image.bgr, rung.side_px)
        unsure = np.zeros(image.shape[:2], np.bool_)
        sight = _scaled(job.sight, scale)
        found = self._find(image, sight, rung, runner, unsure)
        if found is None:
            return None
        found = self._recognise(found, sight, job)
        embedding, measured = self._embed(image, found, job, rung, runner)
        keep = np.flatnonzero(embedding.any(1))
        unsure |= np.isin(found.ids_px, 1 + np.flatnonzero(~embedding.any(1)))
        ids = _renumbered(found.ids_px, keep)
        names = [self._named(found.labels[k], float(found.scores[k]), embedding[k]) for k in keep.tolist()]
        return Detections(
            job.view.stamp_ns,
            job.view.camera.frame_id,
            _enlarged(ids, full_hw),
            np.arange(1, len(keep) + 1, dtype=np.int32),
            np.array([ranked[0][1] for ranked in names], np.float32),
            tuple(ranked[0][0] for ranked in names),
            tuple(names),
            embedding[keep],
            measured[keep],
            _enlarged(unsure.view(np.uint8), full_hw).astype(np.bool_) if unsure.any() else None,
        )

    # ------------------------------------------------------------------------------------------------ masks
    def _find(self, image: NDArray[np.uint8], sight: Sight, rung: Rung, runner: Runner, unsure: Bools) -> _Found | None:
        """Masks with labels, and in ``unsure`` the boxes that were passed over."""
        detector, everything = self.models.detector, self.models.everything
        hw = (image.shape[0], image.shape[1])
        if detector is None:
            if everything is None or not rung.segment:
                return None
            got = runner.run_stage(Stage.SEGMENT, 1, lambda: everything.segment_all(image))
            return None if got is None else self._solid(got, ("",) * len(got.scores), got.scores, rung, unsure)
        prompts = self._prompts(image, runner)
        if not prompts:
            return None
        boxes = runner.run_stage(Stage.DETECT, 1, lambda: detector.detect(image, prompts))
        if boxes is None:
            return None
        order = best_boxes(boxes.boxes_px, boxes.scores, boxes.prompt, self.settings.nms_iou)
        runner.drop("masks: more than the rung allows", max(len(order) - rung.masks, 0))
        for x0, y0, x1, y1 in np.clip(boxes.boxes_px[order[rung.masks :]], 0, max(hw)).astype(int).tolist():
            unsure[y0:y1, x0:x1] = True
        order = order[: rung.masks]
        corners, masks = np.ascontiguousarray(boxes.boxes_px[order], np.float32), None
        segmenter = self.models.segmenter
        if segmenter is not None and rung.segment and len(order):
            masks = runner.run_stage(Stage.SEGMENT, len(order), lambda: segmenter.segment(image, corners))
        if masks is None:
            masks = self.models.box_masks(corners, sight, hw)
        labels = tuple(prompts[p] for p in boxes.prompt[order].tolist())
        return self._solid(masks, labels, boxes.scores[order], rung, unsure)

    def _prompts(self, image: NDArray[np.uint8], runner: Runner) -> tuple[str, ...]:
        """What the detector is asked for; the whole vocabulary where tags can't be had."""
        tagger = self.models.tagger
        if tagger is None or self.settings.prompts == "vocabulary":
            return self.vocabulary
        stage = Stage.TAG if self.settings.prompts == "tags" else Stage.EMBED
        tags = runner.run_stage(stage, 1, lambda: tagger.tag(image))
        return self.vocabulary if tags is None else tags.labels

    def _solid(self, masks: Masks, labels: tuple[str, ...], scores: Floats, rung: Rung, unsure: Bools) -> _Found:
        """The masks that are large enough to be seen once all are painted; best first, at most as many as the rung allows."""
        order = np.argsort(-scores, kind="stable")
        for k in order[rung.masks :].tolist():
            unsure |= masks.masks[k]
        order = order[: rung.masks]
        ids = paint(masks.masks[order])
        size = np.bincount(ids.reshape(-1), minlength=len(order) + 1)[1:]
        keep = np.flatnonzero(size >= self.settings.min_mask_px)
        chosen = order[keep]
        return _Found(
            masks.masks[chosen],
            np.asarray(scores[chosen], np.float32),
            tuple(labels[k] for k in chosen.tolist()),
            np.full(len(chosen), -1, np.int32),
            _renumbered(ids, keep),
        )

    def _recognise(self, found: _Found, sight: Sight, job: PerceptionJob) -> _Found:
        """Which masks are things that are known already: each mask the thing that it shares most with, if it is enough."""
        count, things = len(found.scores), len(job.known.id)
        if not count or not things:
            return found
        share = share_with_known(found.ids_px, sight.pixel, sight.of_point, count, things)
        best = share.argmax(1)
        has_meaning = np.asarray(job.known.embedding.any(1))
        sure = (share[np.arange(count), best] >= self.settings.known_iou) & has_meaning[best]
        known = np.where(sure, best, -1).astype(np.int32)
        return _Found(found.masks, found.scores, found.labels, known, found.ids_px)

    # ------------------------------------------------------------------------------------------------ meaning
    def _embed(
        self, image: NDArray[np.uint8], found: _Found, job: PerceptionJob, rung: Rung, runner: Runner
    ) -> tuple[Floats, Bools]:
        """(embedding float32 [n, D], zero where there is none; whether it was measured [n]): new things first, then what was
        looked at least often; what is known well enough keeps what is known of it."""
        count = len(found.scores)
        embedding, measured = np.zeros((count, self.dimension), np.float32), np.zeros(count, np.bool_)
        old = found.known >= 0
        embedding[old] = job.known.embedding[found.known[old]]
        looks = np.where(old, job.known.looks[found.known] if len(job.known.looks) else 0, -1)
        waits = np.where(old, job.known.last_seen_ns[found.known] if len(job.known.id) else 0, 0)
        encoder = self.models.image_encoder
        due = [k for k in np.lexsort((waits, looks)).tolist() if looks[k] < rung.looks]
        worth = int((looks < FULL.looks).sum())
        runner.pictured(count, VIEWS * worth)
        runner.drop("refinement: known well enough for the rung", worth - len(due))
        while due:
            some = due[: max(runner.batch(Stage.EMBED, VIEWS * len(due)) // VIEWS, 1)]
            crops = [view for k in some for view in views_of(image, found.masks[k])]
            got = runner.run_stage(Stage.EMBED, len(crops), partial(encoder.encode_images, crops))
            if got is None:
                runner.drop("crops: not embedded", VIEWS * len(due))
                break
            embedding[some], measured[some] = fuse(got, self.settings.views.weights), True
            due = due[len(some) :]
        return embedding, measured

    def _named(self, label: str, score: float, embedding: Floats) -> tuple[tuple[str, float], ...]:
        """The best names with scores that sum to at most 1: the detector's word as far as it is sure, the rest by resemblance."""
        ranked = {label: score} if label else {}
        if self.models.names is not None:
            tags = self.models.names.tags_of(embedding)
            rest = (1.0 - score if label else 1.0) / max(float(tags.scores.sum()), 1.0)
            for name, share in zip(tags.labels, tags.scores.tolist(), strict=True):
                ranked[name] = ranked.get(name, 0.0) + rest * share
        if not ranked:
            return ((_UNNAMED, score),)
        best = sorted(ranked.items(), key=lambda pair: (-pair[1], pair[0]))
        return tuple((name, min(value, 1.0)) for name, value in best[: self.settings.top_labels])


def _reduced(bgr: NDArray[np.uint8], side_px: int) -> tuple[NDArray[np.uint8], float]:
    """(RGB whose longer side is at most side_px, its scale)."""
    scale = min(side_px / max(bgr.shape[:2]), 1.0)
    if scale < 1.0:
        size = (max(round(bgr.shape[1] * scale), 1), max(round(bgr.shape[0] * scale), 1))
        bgr = np.asarray(cv2.resize(bgr, size, interpolation=cv2.INTER_AREA), np.uint8)
    return np.ascontiguousarray(bgr[..., ::-1]), scale


def _scaled(sight: Sight, scale: float) -> Sight:
    pixel = ((sight.pixel + 0.5) * scale - 0.5).astype(np.float32) if scale < 1.0 else sight.pixel
    return Sight(pixel, sight.depth_m, sight.of_point, sight.structural)


def _renumbered(ids_px: NDArray[np.uint16], keep: NDArray[np.int64]) -> NDArray[np.uint16]:
    """1, 2 .. for the masks ``keep`` in their order, 0 for all others."""
    table = np.zeros(int(ids_px.max(initial=0)) + 1, np.uint16)
    table[keep + 1] = np.arange(1, len(keep) + 1)
    return np.asarray(table[ids_px], np.uint16)


def _enlarged(pixels: NDArray[Any], hw: tuple[int, ...]) -> NDArray[Any]:
    """Numbers [h, w] at another size; each pixel takes the nearest one's."""
    if pixels.shape == tuple(hw):
        return pixels
    return np.asarray(cv2.resize(pixels, (hw[1], hw[0]), interpolation=cv2.INTER_NEAREST))
