"""The chain of our own small networks on one picture: masks of all that stands out, and a vector for each in the space of names.

No detector and no words: names come later, from the vectors of many pictures and from the shape (``naming``).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from irsd.core.types import Detections
from irsd.perception.budget import FULL, Rung, Stage
from irsd.perception.found import Found, enlarged, looks_of, recognise, reduced, renumbered, scaled, solid
from irsd.perception.job import PerceptionJob, Sight
from irsd.perception.kernels import Bools, Floats
from irsd.perception.naming import UNKNOWN
from irsd.perception.nano_image import Geometry
from irsd.perception.roles import Masks
from irsd.perception.seer import Runner, Trial
from irsd.perception.settings import PerceptionSettings

_HW = (480, 640)


class SceneSegmenter(Protocol):
    """Masks of all that stands out, by picture and map."""

    def segment_scene(self, image_rgb: NDArray[np.uint8], sight: Sight) -> Masks:
        """Disjoint masks, best first; scores: the chance that a mask is a thing."""
        ...


class MaskEncoder(Protocol):
    """Masks of a picture as vectors."""

    @property
    def dimension(self) -> int:
        """Of the embeddings."""
        ...

    def encode_masks(
        self, image_rgb: NDArray[np.uint8], masks: Bools, sight: Sight, geometry: Geometry | None
    ) -> Floats:
        """float32 [n, D], unit rows; zero where nothing can be said."""
        ...


class NanoChain:
    """A ``Seer``. One thread."""

    def __init__(
        self,
        settings: PerceptionSettings,
        segmenter: SceneSegmenter,
        encoder: MaskEncoder,
        *,
        cancel: Callable[[], None],
        clear: Callable[[], None],
    ) -> None:
        """cancel: ends what runs; clear: lets runs start again."""
        self._settings, self._segmenter, self._encoder = settings, segmenter, encoder
        self.cancel, self.clear = cancel, clear

    @property
    def dimension(self) -> int:
        return self._encoder.dimension

    def see(self, job: PerceptionJob, rung: Rung, runner: Runner) -> Detections | None:
        """See ``Seer.see``."""
        assert job.view.image is not None
        full_hw = job.view.image.bgr.shape[:2]
        image, scale = reduced(job.view.image.bgr, rung.side_px)
        sight = scaled(job.sight, scale)
        masks = runner.run_stage(Stage.SEGMENT, 1, lambda: self._segmenter.segment_scene(image, sight))
        if masks is None:
            return None
        unsure = np.zeros(image.shape[:2], np.bool_)
        runner.drop("masks: more than the rung allows", max(len(masks.scores) - rung.masks, 0))
        sure = masks.scores >= self._settings.least_mask_score
        masks = Masks(masks.masks[sure], masks.scores[sure])
        found = solid(masks, ("",) * len(masks.scores), masks.scores, rung, self._settings.min_mask_px, unsure)
        found = recognise(found, sight, job, self._settings.known_iou)
        geometry = Geometry.of(job.view, scale, job.floor_z_m)
        embedding, measured = self._embed(image, found, sight, geometry, job, rung, runner)
        keep = np.flatnonzero(embedding.any(1))
        unsure |= np.isin(found.ids_px, 1 + np.flatnonzero(~embedding.any(1)))
        scores = found.scores[keep]
        return Detections(
            job.view.stamp_ns,
            job.view.camera.frame_id,
            enlarged(renumbered(found.ids_px, keep), full_hw),
            np.arange(1, len(keep) + 1, dtype=np.int32),
            scores,
            (UNKNOWN,) * len(keep),
            tuple(((UNKNOWN, float(score)),) for score in scores),
            embedding[keep],
            measured[keep],
            enlarged(unsure.view(np.uint8), full_hw).astype(np.bool_) if unsure.any() else None,
        )

    def _embed(
        self,
        image: NDArray[np.uint8],
        found: Found,
        sight: Sight,
        geometry: Geometry,
        job: PerceptionJob,
        rung: Rung,
        runner: Runner,
    ) -> tuple[Floats, Bools]:
        """(embedding float32 [n, D], zero where there is none; whether it was measured [n]); what is known well stays as known."""
        count = len(found.scores)
        embedding, measured = np.zeros((count, self.dimension), np.float32), np.zeros(count, np.bool_)
        old = found.known >= 0
        embedding[old] = job.known.embedding[found.known[old]]
        looks, order = looks_of(found, job.known)
        due = [k for k in order.tolist() if looks[k] < rung.looks]
        worth = int((looks < FULL.looks).sum())
        runner.pictured(count, worth)
        runner.drop("refinement: known well enough for the rung", worth - len(due))
        while due:
            some = due[: max(runner.batch(Stage.EMBED, len(due)), 1)]
            work = partial(self._encoder.encode_masks, image, found.masks[some], sight, geometry)
            got = runner.run_stage(Stage.EMBED, len(some), work)
            if got is None:
                runner.drop("crops: not embedded", len(due))
                break
            embedding[some], measured[some] = got, True
            due = due[len(some) :]
        return embedding, measured

    def trials(self) -> Iterator[Trial]:
        """See ``Seer.trials``."""
        rng = np.random.default_rng(0)
        image = rng.integers(0, 256, (*_HW, 3), dtype=np.uint8)
        none = np.zeros(0, np.float32)
        sight = Sight(np.zeros((0, 2), np.float32), none, none.astype(np.int32), none.astype(np.bool_))
        yield Stage.SEGMENT, 1, lambda: self._segmenter.segment_scene(image, sight)
        masks = np.zeros((6, *_HW), np.bool_)
        masks[:, :200, :200] = True
        for count in (2, 6):
            yield Stage.EMBED, count, partial(self._encoder.encode_masks, image, masks[:count], sight, None)
