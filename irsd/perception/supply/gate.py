"""The accuracy gate: what a model answers on this machine's pictures, and how far a quantised one departs from it.

Pure comparisons; 1 is the same answer everywhere. Published int8 and fp16 files are known to lose half of their quality in silence,
so that no quantised file is used that has not passed here, on its own user's pictures.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from irsd.perception.assemble import ModelOpener
from irsd.perception.catalogue import Model
from irsd.perception.roles import Boxes, Masks, Tags

Floats = NDArray[np.float32]
Picture = NDArray[np.uint8]

PROMPTS = tuple(
    [
        "chair",
        "table",
        "sofa",
        "bed",
        "lamp",
        "door",
        "window",
        "cabinet",
        "plant",
        "television",
        "sink",
        "refrigerator",
    ]
)
TEXTS = tuple(f"{article}{word}" for article in ("", "a photo of a ", "an old ", "two of a ") for word in PROMPTS)
_TIE = 0.1  # standard deviations of the similarities: picks that are this close are the same pick
_FEW = 2.0  # boxes a picture: with fewer, lower scores are compared, too
_MATCH_IOU = 0.5
_WORST = 5.0  # per cent: the cosine that counts is that of the worst in twenty


@dataclass(frozen=True, slots=True)
class Answers:
    """What a model says. images: float32 [crops, D]; texts: float32 [texts, D]; the others one per picture."""

    images: Floats | None = None
    texts: Floats | None = None
    boxes: tuple[Boxes, ...] = ()
    masks: tuple[Masks, ...] = ()
    tags: tuple[Tags, ...] = ()


@dataclass(frozen=True, slots=True)
class Verdict:
    """measured: by the names of the floors. failed: which of them are below their floor."""

    measured: Mapping[str, float]
    floors: Mapping[str, float]

    @property
    def failed(self) -> tuple[str, ...]:
        # "not >=", since a broken network measures NaN
        return tuple(name for name, value in self.measured.items() if not value >= self.floors.get(name, 0.0))

    def __str__(self) -> str:
        return ", ".join(f"{n} {v:.3f} (floor {self.floors.get(n, 0.0):g})" for n, v in self.measured.items())


def answers(opener: ModelOpener, name: str, pictures: Sequence[Picture]) -> Answers:
    """What the model says to the pictures, in all its roles. ModelError when it can't be opened or run."""
    roles = opener.model(name).roles
    images = texts = None
    boxes: tuple[Boxes, ...] = ()
    masks: tuple[Masks, ...] = ()
    tags: tuple[Tags, ...] = ()
    if "image_encoder" in roles:
        encoder = opener.image_encoder(name)
        images = encoder.encode_images([crop for picture in pictures for crop in crops_of(picture)])
    if "text_encoder" in roles:
        texts = opener.text_encoder(name).encode_texts(TEXTS)
    if "detector" in roles:
        detector = opener.detector(name, threshold=0.0)
        boxes = tuple(detector.detect(picture, PROMPTS) for picture in pictures)
    if "segmenter" in roles:
        segmenter = opener.segmenter(name)
        masks = tuple(segmenter.segment(picture, boxes_of(picture)) for picture in pictures)
    if "tagger" in roles:
        tagger = opener.tagger(name)
        tags = tuple(tagger.tag(picture) for picture in pictures)
    return Answers(images, texts, boxes, masks, tags)


def judge(model: Model, reference: Answers, candidate: Answers) -> Verdict:
    """How far the candidate's answers to the same pictures depart from the reference's."""
    measured: dict[str, float] = {}
    spaces = ((reference.images, candidate.images), (reference.texts, candidate.texts))
    pairs = [(ours, theirs) for ours, theirs in spaces if ours is not None and theirs is not None]
    if pairs:
        measured["cosine"] = min(worst_cosine(ours, theirs) for ours, theirs in pairs)
        (asked, asked_by), (among, among_by) = pairs[0], pairs[-1]  # pictures among texts, where there are both
        measured["retrieval"] = retrieval_agreement(asked @ among.T, asked_by @ among_by.T, len(pairs) == 1)
    if reference.boxes:
        threshold = working_threshold(reference.boxes, model.thresholds.get("score", 0.0))
        measured |= box_agreement(reference.boxes, candidate.boxes, threshold)
    if reference.masks:
        measured["mask_iou"] = mask_iou(reference.masks, candidate.masks)
    if reference.tags:
        measured["tag_agreement"] = tag_agreement(reference.tags, candidate.tags)
    return Verdict(measured, model.floors)


# ---------------------------------------------------------------------------------------------------------- comparisons
def worst_cosine(reference: Floats, candidate: Floats) -> float:
    """Cosine between the rows of two float32 [n, D] with unit rows: that of the worst in twenty."""
    return float(np.percentile((reference * candidate).sum(1), _WORST))


def retrieval_agreement(reference: Floats, candidate: Floats, itself: bool = False) -> float:
    """Share of rows whose best column the candidate finds, similarities float32 [n, m]; near ties count as found.

    itself: rows and columns are the same things, of which none is its own neighbour.
    """
    ours, theirs = reference.astype(np.float64), candidate.astype(np.float64)
    tie = _TIE * float(ours.std())
    if itself:
        np.fill_diagonal(ours, -np.inf)
        np.fill_diagonal(theirs, -np.inf)
    picked = np.take_along_axis(ours, theirs.argmax(1)[:, None], 1)[:, 0]
    return float((picked >= ours.max(1) - tie).mean()) if np.isfinite(theirs.max(1)).all() else float("nan")


def working_threshold(boxes: Sequence[Boxes], threshold: float) -> float:
    """The model's own threshold, or the lower one that leaves _FEW boxes a picture to compare."""
    scores = np.sort(np.concatenate([b.scores for b in boxes]))[::-1]
    wanted = round(_FEW * len(boxes))
    if len(scores) == 0:
        return threshold
    return float(min(threshold, scores[min(wanted, len(scores)) - 1]))


def box_agreement(reference: Sequence[Boxes], candidate: Sequence[Boxes], threshold: float) -> dict[str, float]:
    """box_agreement: F1 of the boxes above the threshold, matched one to one by prompt and IoU >= 0.5; box_iou: mean IoU of those."""
    overlaps: list[float] = []
    counted = 0
    for ours, theirs in zip(reference, candidate, strict=True):
        a, b = np.nonzero(ours.scores >= threshold)[0], np.nonzero(theirs.scores >= threshold)[0]
        counted += len(a) + len(b)
        iou = _box_iou(ours.boxes_px[a], theirs.boxes_px[b])
        iou[ours.prompt[a][:, None] != theirs.prompt[b][None]] = 0.0
        while iou.size and (best := float(iou.max())) >= _MATCH_IOU:
            row, column = np.unravel_index(int(iou.argmax()), iou.shape)
            overlaps.append(best)
            iou[row], iou[:, column] = 0.0, 0.0
    if not counted:
        return {"box_iou": float("nan"), "box_agreement": float("nan")}
    mean = float(np.mean(overlaps)) if overlaps else 0.0
    return {"box_iou": mean, "box_agreement": 2.0 * len(overlaps) / counted}


def _box_iou(a: Floats, b: Floats) -> Floats:
    """float32 [n, m] of boxes [n, 4] and [m, 4]."""
    low, high = np.maximum(a[:, None, :2], b[None, :, :2]), np.minimum(a[:, None, 2:], b[None, :, 2:])
    common = np.clip(high - low, 0, None).prod(2)
    size_a, size_b = (np.clip(x[:, 2:] - x[:, :2], 0, None).prod(1) for x in (a, b))
    return np.asarray(common / np.maximum(size_a[:, None] + size_b[None] - common, 1e-9), np.float32)


def mask_iou(reference: Sequence[Masks], candidate: Sequence[Masks]) -> float:
    """Mean IoU of masks of the same prompts; two empty masks agree."""
    values: list[float] = []
    for ours, theirs in zip(reference, candidate, strict=True):
        both = (ours.masks & theirs.masks).sum((1, 2))
        either = (ours.masks | theirs.masks).sum((1, 2))
        values += np.where(either > 0, both / np.maximum(either, 1), 1.0).tolist()
    return float(np.mean(values)) if values else float("nan")


def tag_agreement(reference: Sequence[Tags], candidate: Sequence[Tags]) -> float:
    """Mean over the pictures of common tags among all tags; two silent answers agree."""
    shares = []
    for ours, theirs in zip(reference, candidate, strict=True):
        a, b = set(ours.labels), set(theirs.labels)
        shares.append(len(a & b) / len(a | b) if a | b else 1.0)
    return float(np.mean(shares)) if shares else float("nan")


# ------------------------------------------------------------------------------------------------------------ questions
def crops_of(picture: Picture) -> list[Picture]:
    """The whole picture, its quarters and its middle."""
    h, w = picture.shape[0] // 2, picture.shape[1] // 2
    corners = [picture[y : y + h, x : x + w] for y in (0, h) for x in (0, w)]
    return [picture, *corners, picture[h // 2 : h // 2 + h, w // 2 : w // 2 + w]]


def boxes_of(picture: Picture) -> Floats:
    """float32 [6, 4]: a spread of boxes to segment."""
    height, width = picture.shape[:2]
    shares = np.array(
        [
            (0.05, 0.3, 0.35, 0.9),
            (0.3, 0.2, 0.7, 0.8),
            (0.6, 0.4, 0.95, 0.95),
            (0.1, 0.05, 0.4, 0.35),
            (0.45, 0.5, 0.6, 0.7),
            (0.7, 0.1, 0.9, 0.5),
        ],
        np.float32,
    )
    return shares * np.array([width, height, width, height], np.float32)
