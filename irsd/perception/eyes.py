"""From the configuration to a chain that is ready to look: models opened by role, and what they are believed to cost."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from irsd.core.errors import ModelError
from irsd.perception import meter
from irsd.perception.assemble import ModelOpener, ModelSettings
from irsd.perception.box_masks import BoxMaskSettings, draw_depth, masks_of_boxes
from irsd.perception.budget import Stage
from irsd.perception.catalogue import find_model
from irsd.perception.chain import Chain, ModelSet
from irsd.perception.everything import GridPrompter
from irsd.perception.families.prompted import PromptedSegmenter
from irsd.perception.job import Sight
from irsd.perception.kernels import Floats
from irsd.perception.models import Cancel
from irsd.perception.nano import COSTS, nano_status, open_nano_chain
from irsd.perception.roles import Masks, Segmenter, Tagger, TextEncoder
from irsd.perception.seer import Seer
from irsd.perception.settings import INDOOR, PerceptionSettings
from irsd.perception.tagging import CLIP_LIKENESS, SIGLIP_LIKENESS, ZeroShotTagger

_log = logging.getLogger(__name__)

_UNKNOWN_MS = 500.0  # of a network that nobody measured


@dataclass(frozen=True, slots=True)
class Opened:
    """A chain, the (fixed, each) CPU seconds that its stages are believed to cost, the threads that the networks made, and what runs
    on what."""

    chain: Seer
    costs: dict[Stage, tuple[float, float]]
    threads: frozenset[int]
    models: Callable[[], list[dict[str, Any]]]


def open_eyes(settings: PerceptionSettings, where: ModelSettings) -> Opened:
    """The models that the settings name, else the shipped ones. Raises ModelError with what to do."""
    return _open_named(settings, where) if settings.image_encoder else _open_nano(settings, where)


def _open_nano(settings: PerceptionSettings, where: ModelSettings) -> Opened:
    before = meter.thread_ids()
    chain = open_nano_chain(settings, where, Cancel())
    return Opened(chain, dict(COSTS), meter.thread_ids() - before, nano_status)


def _open_named(settings: PerceptionSettings, where: ModelSettings) -> Opened:
    before = meter.thread_ids()
    cancel = Cancel()
    opener = ModelOpener(where, cancel=cancel)
    s, vocabulary = settings, settings.vocabulary or INDOOR
    images = opener.image_encoder(s.image_encoder)
    texts = _text_encoder(opener, s)
    likeness = SIGLIP_LIKENESS if find_model(opener.catalogue, s.image_encoder)[0].family == "siglip" else CLIP_LIKENESS

    def resembling(top: int, threshold: float) -> ZeroShotTagger | None:
        if texts is None:
            return None
        return ZeroShotTagger(images, texts, vocabulary, likeness=likeness, top=top, threshold=threshold)

    tagger: Tagger | None = opener.tagger(s.tagger) if s.tagger else None
    segmenter = opener.segmenter(s.segmenter) if s.segmenter else None
    role_set = ModelSet(
        image_encoder=images,
        names=resembling(s.top_labels, 0.0),
        tagger=resembling(s.zero_shot_tags, 0.01) if s.prompts == "zero_shot" else tagger,
        detector=opener.detector(s.detector) if s.detector else None,
        segmenter=segmenter,
        everything=None if s.detector else _everything(segmenter, s),
        box_masks=partial(_box_masks, s.boxes),
        cancel=cancel.request,
        clear=cancel.clear,
    )
    chain = Chain(settings, role_set, vocabulary)
    return Opened(chain, stage_costs(opener, settings), meter.thread_ids() - before, opener.status)


def _everything(segmenter: Segmenter | None, settings: PerceptionSettings) -> GridPrompter:
    """Who makes masks without a detector. ModelError when the models can't."""
    if not isinstance(segmenter, PromptedSegmenter):
        raise ModelError(
            "without perception.detector, perception.segmenter must be one that points can prompt (SAM and its kin)"
        )
    return GridPrompter(segmenter, settings.grid)


def _box_masks(settings: BoxMaskSettings, boxes_px: Floats, sight: Sight, hw: tuple[int, int]) -> Masks:
    depth = draw_depth(sight.pixel, sight.depth_m, sight.structural, hw, settings)
    return masks_of_boxes(boxes_px, depth, hw, settings)


def stage_costs(opener: ModelOpener, settings: PerceptionSettings) -> dict[Stage, tuple[float, float]]:
    """(fixed, each) CPU seconds by stage, in the order of the chain, by the catalogue and the files that were opened."""
    ms: dict[tuple[str, str], float] = {}
    for opened in opener.status():
        cost = opener.catalogue[opened["model"]].costs.get(opened["part"])
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


def _text_encoder(opener: ModelOpener, settings: PerceptionSettings) -> TextEncoder | None:
    """The one that is named, which must be there; else the image encoder's own, where there is one.

    It is used once and not kept: names don't change, and it holds some hundred MB.
    """
    try:
        return opener.text_encoder(settings.text_encoder or settings.image_encoder)
    except ModelError as error:
        if settings.text_encoder or settings.prompts == "zero_shot":
            raise
        _log.warning("things get names only from the detector: %s", error)
        return None
