"""The chain of the paper on one picture: prompts -> boxes -> masks -> three views of each mask -> embedding and names.

Knows of no clock: each run of a model goes through a ``Runner``, which may refuse it or end it early, and the chain makes the best of
what it got. What was found and not looked into is said to be unsure, so that nothing follows from it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from irsd.core.types import Detections
from irsd.perception.budget import FULL, Rung, Stage
from irsd.perception.found import Found, enlarged, looks_of, recognise, reduced, renumbered, scaled, solid
from irsd.perception.fuse_views import VIEWS, fuse, views_of
from irsd.perception.job import PerceptionJob, Sight
from irsd.perception.kernels import Bools, Floats, best_boxes
from irsd.perception.roles import Detector, ImageEncoder, Masks, Segmenter, Tagger
from irsd.perception.seer import Runner, Trial
from irsd.perception.settings import PerceptionSettings
from irsd.perception.tagging import ZeroShotTagger
from irsd.perception.trial import trials

_UNNAMED = "object"


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


class Chain:
    """Owner of the models' order and of the vocabulary's vectors. One thread."""

    def __init__(self, settings: PerceptionSettings, models: ModelSet, vocabulary: tuple[str, ...]) -> None:
        """vocabulary: names of things, what the detector is asked for where no tags are."""
        self.settings, self.models, self.vocabulary = settings, models, vocabulary

    @property
    def dimension(self) -> int:
        """Of the embeddings."""
        return self.models.image_encoder.dimension

    def cancel(self) -> None:
        """See ``Seer.cancel``."""
        self.models.cancel()

    def clear(self) -> None:
        """See ``Seer.clear``."""
        self.models.clear()

    def trials(self) -> Iterator[Trial]:
        """See ``Seer.trials``."""
        return trials(self.models, self.vocabulary)

    def see(self, job: PerceptionJob, rung: Rung, runner: Runner) -> Detections | None:
        """What the job's picture shows; None when not even the first stage could run."""
        assert job.view.image is not None
        full_hw = job.view.image.bgr.shape[:2]
        image, scale = reduced(job.view.image.bgr, rung.side_px)
        unsure = np.zeros(image.shape[:2], np.bool_)
        sight = scaled(job.sight, scale)
        found = self._find(image, sight, rung, runner, unsure)
        if found is None:
            return None
        found = recognise(found, sight, job, self.settings.known_iou)
        embedding, measured = self._embed(image, found, job, rung, runner)
        keep = np.flatnonzero(embedding.any(1))
        unsure |= np.isin(found.ids_px, 1 + np.flatnonzero(~embedding.any(1)))
        ids = renumbered(found.ids_px, keep)
        names = [self._named(found.labels[k], float(found.scores[k]), embedding[k]) for k in keep.tolist()]
        return Detections(
            job.view.stamp_ns,
            job.view.camera.frame_id,
            enlarged(ids, full_hw),
            np.arange(1, len(keep) + 1, dtype=np.int32),
            np.array([ranked[0][1] for ranked in names], np.float32),
            tuple(ranked[0][0] for ranked in names),
            tuple(names),
            embedding[keep],
            measured[keep],
            enlarged(unsure.view(np.uint8), full_hw).astype(np.bool_) if unsure.any() else None,
        )

    # ------------------------------------------------------------------------------------------------ masks
    def _find(self, image: NDArray[np.uint8], sight: Sight, rung: Rung, runner: Runner, unsure: Bools) -> Found | None:
        """Masks with labels, and in ``unsure`` the boxes that were passed over."""
        detector, everything = self.models.detector, self.models.everything
        hw = (image.shape[0], image.shape[1])
        if detector is None:
            if everything is None or not rung.segment:
                return None
            got = runner.run_stage(Stage.SEGMENT, 1, lambda: everything.segment_all(image))
            least = self.settings.min_mask_px
            return None if got is None else solid(got, ("",) * len(got.scores), got.scores, rung, least, unsure)
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
        return solid(masks, labels, boxes.scores[order], rung, self.settings.min_mask_px, unsure)

    def _prompts(self, image: NDArray[np.uint8], runner: Runner) -> tuple[str, ...]:
        """What the detector is asked for; the whole vocabulary where tags can't be had."""
        tagger = self.models.tagger
        if tagger is None or self.settings.prompts == "vocabulary":
            return self.vocabulary
        stage = Stage.TAG if self.settings.prompts == "tags" else Stage.EMBED
        tags = runner.run_stage(stage, 1, lambda: tagger.tag(image))
        return self.vocabulary if tags is None else tags.labels

    # ------------------------------------------------------------------------------------------------ meaning
    def _embed(
        self, image: NDArray[np.uint8], found: Found, job: PerceptionJob, rung: Rung, runner: Runner
    ) -> tuple[Floats, Bools]:
        """(embedding float32 [n, D], zero where there is none; whether it was measured [n]): new things first, then what was
        looked at least often; what is known well enough keeps what is known of it."""
        count = len(found.scores)
        embedding, measured = np.zeros((count, self.dimension), np.float32), np.zeros(count, np.bool_)
        old = found.known >= 0
        embedding[old] = job.known.embedding[found.known[old]]
        looks, order = looks_of(found, job.known)
        encoder = self.models.image_encoder
        due = [k for k in order.tolist() if looks[k] < rung.looks]
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
