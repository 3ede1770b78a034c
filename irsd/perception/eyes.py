"""From the configuration to a chain that is ready to look: models opened by role, and what they are believed to cost."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import Any

import numpy as np

from irsd.core.errors import ModelError
from irsd.perception import meter
from irsd.perception.assemble import ModelOpener, ModelSettings
from irsd.perception.budget import Stage
from irsd.perception.chain import Chain, ModelSet
from irsd.perception.job import Sight
from irsd.perception.kernels import Floats
from irsd.perception.models import Cancel
from irsd.perception.roles import Masks
from irsd.perception.settings import INDOOR, PerceptionSettings

_log = logging.getLogger(__name__)

_UNKNOWN_MS = 500.0  # of a network that nobody measured


@dataclass(frozen=True, slots=True)
class Opened:
    """A chain, the (fixed, each) CPU seconds that its stages are believed to cost, and the threads that the networks made."""

    chain: Chain
    costs: dict[Stage, tuple[float, float]]
    threads: frozenset[int]
    models: ModelOpener

    def status(self) -> list[dict[str, Any]]:
        """What runs, and on what."""
        return self.models.status()


def open_eyes(settings: PerceptionSettings, where: ModelSettings) -> Opened:
    """Opens every model that the settings name. Raises ModelError with what to do."""
    before = meter.thread_ids()
    cancel = Cancel()
    models = ModelOpener(where, cancel=cancel)
    s = settings
    vocabulary = s.vocabulary or INDOOR
    role_set = ModelSet(
        image_encoder=models.image_encoder(s.image_encoder),
        tagger=models.tagger(s.tagger) if s.tagger else None,
        detector=models.detector(s.detector) if s.detector else None,
        segmenter=models.segmenter(s.segmenter) if s.segmenter else None,
        everything=None,
        box_masks=_whole_boxes,
        cancel=cancel.request,
        clear=cancel.clear,
    )
    chain = Chain(settings, role_set, vocabulary, _vectors(models, s, vocabulary))
    return Opened(chain, stage_costs(models, settings), meter.thread_ids() - before, models)


def _whole_boxes(boxes_px: Floats, sight: Sight, hw: tuple[int, int]) -> Masks:
    """Boxes as they are: the coarsest masks there can be."""
    masks = np.zeros((len(boxes_px), *hw), np.bool_)
    for k, (x0, y0, x1, y1) in enumerate(np.clip(boxes_px, 0, max(hw)).astype(int).tolist()):
        masks[k, y0:y1, x0:x1] = True
    return Masks(masks, np.ones(len(boxes_px), np.float32))


def stage_costs(models: ModelOpener, settings: PerceptionSettings) -> dict[Stage, tuple[float, float]]:
    """(fixed, each) CPU seconds by stage, in the order of the chain, by the catalogue and the files that were opened."""
    ms: dict[tuple[str, str], float] = {}
    for opened in models.status():
        cost = models.catalogue[opened["model"]].costs.get(opened["part"])
        pair = (None, None) if cost is None else cost.cpu_ms
        known = pair[1] if opened["precision"] == "int8" else pair[0]
        ms[opened["model"], opened["part"]] = _UNKNOWN_MS if known is None else known
    out: dict[Stage, tuple[float, float]] = {}
    for stage, name in (
        (Stage.TAG, settings.tagger),
        (Stage.DETECT, settings.detector),
        (Stage.SEGMENT, settings.segmenter),
    ):
        mine = {part: cost for (model, part), cost in ms.items() if model == name.partition("@")[0]}
        if name:
            each = mine.pop("decoder", 0.0)
            out[stage] = (sum(mine.values()) * 1e-3, each * 1e-3)
    encoder = settings.image_encoder.partition("@")[0]
    out[Stage.EMBED] = (0.0, ms.get((encoder, "image"), _UNKNOWN_MS) * 1e-3)
    return out


def _vectors(models: ModelOpener, settings: PerceptionSettings, names: tuple[str, ...]) -> Floats | None:
    """float32 [n, D] of names in the image encoder's space; None where no text encoder shares it, which only one named must.

    The encoder is not kept: names don't change, and it would hold some hundred MB.
    """
    try:
        encoder = models.text_encoder(settings.text_encoder or settings.image_encoder)
    except ModelError as error:
        if settings.text_encoder:
            raise
        _log.warning("things get names only from the detector: %s", error)
        return None
    if encoder.name != settings.image_encoder.partition("@")[0]:
        raise ModelError(f"{encoder.name} does not share the space of {settings.image_encoder}")
    return encoder.encode_texts([f"a photo of a {name}" for name in names])
