"""Settings of irsd's own eyes: which models, what they are asked for, how masks become embeddings."""

from __future__ import annotations

from dataclasses import dataclass, field

from irsd.core.errors import ConfigError
from irsd.core.settings import setting
from irsd.perception.box_masks import BoxMaskSettings
from irsd.perception.everything import GridSettings
from irsd.perception.fuse_views import ViewSettings, check_weights
from irsd.perception.naming import NamingSettings

_INDOOR = (
    "chair, armchair, stool, bench, sofa, dining table, coffee table, desk, wardrobe, cabinet, bookcase, shelf, chest of "
    "drawers, nightstand, tv stand, bed, pillow, lamp, television, monitor, computer, laptop, keyboard, printer, telephone, "
    "speaker, clock, refrigerator, stove, oven, microwave, dishwasher, sink, coffee machine, bottle, cup, bowl, trash can, "
    "washing machine, toilet, bathtub, shower, towel, mirror, curtain, rug, picture, vase, plant, fireplace, whiteboard, "
    "book, box, backpack, suitcase, shoes, air conditioner, fan, radiator, fire extinguisher, door, ladder, dumbbell, "
    "treadmill, ball, bicycle, piano, person"
)
INDOOR = tuple(_INDOOR.split(", "))
"""What is looked for where a site names nothing: common things, in the words of the alias table."""

_MORE = (
    "office chair, ottoman, side table, kitchen cabinet, kitchen utensils, tableware, cooking pot, seasoning jars, range hood, "
    "shoe rack, chandelier, ceiling lamp, pendant lamp, floor lamp, table lamp, wall lamp, photo frame, notice board, "
    "light switch, security camera, washbasin, workbench, exercise ball, weight bench, tablet, bag, copier, robot vacuum, window, "
    "fume hood, microscope, centrifuge, gas cylinder"
)
HOUSEHOLD = (*INDOOR, *_MORE.split(", "))
"""What the shipped networks may call things where a site names nothing: the above, and what else they were trained on."""


@dataclass(frozen=True)
class PerceptionSettings:
    """irsd's own eyes: the networks that it ships, or models that you name. Where detections come from outside, irsd's eyes rest."""

    nano: bool = setting(
        True,
        "where no image_encoder is named, irsd sees with the small networks that it ships; off: only with detections from outside",
    )

    tagger: str = setting("", "model that names what a picture shows, as in 'irsctl models list'; may be left out")
    detector: str = setting("", "model that finds boxes for names; without one everything is segmented")
    segmenter: str = setting("", "model that makes masks of boxes; without one the map's depth does")
    image_encoder: str = setting("", "model that gives masks their meaning; empty: the shipped networks see (nano)")
    text_encoder: str = setting("", "model that puts names into the image encoder's space; empty: the same model")
    prompts: str = setting(
        "vocabulary",
        "what the detector is asked for: the tagger's tags, all of the vocabulary, or what of it the picture resembles most",
        choices=("tags", "vocabulary", "zero_shot"),
    )
    vocabulary: tuple[str, ...] = setting((), "names of the things of this site; empty: irsd's own list for indoors")
    zero_shot_tags: int = setting(16, "names that are asked for with prompts: zero_shot", lo=1, hi=1000)
    nms_iou: float = setting(0.5, "of two boxes of one name that overlap by more, the better stays", lo=0.05, hi=1.0)
    min_mask_px: int = setting(64, "smaller masks are not things", lo=1, hi=100_000)
    known_iou: float = setting(
        0.5, "a mask that covers a known thing like this is that thing, and not embedded each time", lo=0.1, hi=1.0
    )
    top_labels: int = setting(5, "names with scores that each thing carries", lo=1, hi=100)
    least_mask_score: float = setting(
        0.5, "masks of the shipped segmenter with a smaller chance are dropped", lo=0.0, hi=1.0
    )
    naming: NamingSettings = field(default_factory=NamingSettings)
    views: ViewSettings = field(default_factory=ViewSettings)
    grid: GridSettings = field(default_factory=GridSettings)
    boxes: BoxMaskSettings = field(default_factory=BoxMaskSettings)


def check_perception(settings: PerceptionSettings) -> None:
    """ConfigError for settings that contradict each other."""
    check_weights(settings.views)
    s = settings
    if not s.image_encoder and (s.tagger or s.detector or s.segmenter):
        raise ConfigError("perception.image_encoder = '': the chain needs an image encoder, all else may be left out")
    if s.prompts == "tags" and s.image_encoder and not s.tagger:
        raise ConfigError("perception.prompts = 'tags': needs a perception.tagger")
