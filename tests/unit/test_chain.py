"""The chain on pictures of coloured blocks: the encoder is a real ONNX file, the detector and the segmenter know colours."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeVar

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from tiny_onnx import image_encoder

from irsd.core.errors import ConfigError
from irsd.core.types import CameraImage, CameraModel, CameraView, Detections, KnownThings
from irsd.perception.budget import FULL, BudgetSettings, Stage
from irsd.perception.chain import Chain, ModelSet
from irsd.perception.families.clip import ClipImageEncoder
from irsd.perception.fuse_views import ViewSettings, check_weights, fuse, views_of
from irsd.perception.inline import InlineEyes
from irsd.perception.job import PerceptionJob, Sight
from irsd.perception.kernels import best_boxes, paint, share_with_known
from irsd.perception.models import Session
from irsd.perception.roles import Boxes, Masks, Tags
from irsd.perception.settings import PerceptionSettings, check_perception
from irsd.perception.tagging import ZeroShotTagger

T = TypeVar("T")

HW = (120, 160)
COLOURS = {"chair": (220, 30, 30), "lamp": (30, 220, 30), "sofa": (30, 30, 220), "plant": (200, 200, 30)}
CAMERA = CameraModel("camera", HW[1], HW[0], np.eye(3), "plumb_bob", np.zeros(0))
NOTHING_KNOWN = KnownThings(
    np.zeros(0, np.int32), np.zeros(0, np.int64), np.zeros((0, 8), np.float32), np.zeros(0, np.int32),
    np.zeros(0, np.int32), np.zeros(0, np.int64),
)  # fmt: skip
NO_SIGHT = Sight(np.zeros((0, 2), np.float32), np.zeros(0, np.float32), np.zeros(0, np.int32), np.zeros(0, np.bool_))
COSTS = {Stage.TAG: (0.01, 0.0), Stage.DETECT: (0.01, 0.0), Stage.SEGMENT: (0.01, 0.0), Stage.EMBED: (0.0, 0.01)}


def where(image_rgb: NDArray[np.uint8], name: str) -> NDArray[np.bool_]:
    return np.asarray((np.abs(image_rgb.astype(int) - COLOURS[name]) < 40).all(-1))


class ColourDetector:
    """Boxes of the connected parts of a prompt's colour; each twice, the second a little off and less sure."""

    def detect(self, image_rgb: NDArray[np.uint8], prompts: tuple[str, ...]) -> Boxes:
        rows = []
        for k, name in enumerate(prompts):
            if name in COLOURS:
                _, _, stats, _ = cv2.connectedComponentsWithStats(where(image_rgb, name).astype(np.uint8))
                for x, y, w, h, _ in stats[1:].tolist():
                    rows += [(x, y, x + w, y + h, 0.9, k), (x + 1, y, x + w + 1, y + h, 0.5, k)]
        table = np.array(rows, np.float32).reshape(-1, 6)
        return Boxes(np.ascontiguousarray(table[:, :4]), table[:, 4], table[:, 5].astype(np.int32))


class ColourSegmenter:
    """Of the pixels in a box those that are coloured."""

    def segment(self, image_rgb: NDArray[np.uint8], boxes_px: NDArray[np.float32]) -> Masks:
        coloured = np.ptp(image_rgb.astype(int), axis=-1) > 100
        masks = np.zeros((len(boxes_px), *coloured.shape), np.bool_)
        for k, (x0, y0, x1, y1) in enumerate(boxes_px.astype(int).tolist()):
            masks[k, y0:y1, x0:x1] = coloured[y0:y1, x0:x1]
        return Masks(masks, np.ones(len(boxes_px), np.float32))

    def segment_all(self, image_rgb: NDArray[np.uint8]) -> Masks:
        found = [where(image_rgb, name) for name in COLOURS]
        masks = np.array([mask for mask in found if mask.any()])
        return Masks(masks, np.full(len(masks), 0.7, np.float32))


class LampTagger:
    """Sees lamps in every picture."""

    def tag(self, image_rgb: NDArray[np.uint8]) -> Tags:
        return Tags(("lamp",), np.ones(1, np.float32))


class ColourWords:
    """A text encoder that knows what the names of colours' blocks look like to the image encoder."""

    def __init__(self, images: ClipImageEncoder) -> None:
        self.name, self.dimension = images.name, images.dimension
        blocks = {name: picture((name, 10, 10)) for name in COLOURS}
        self.vectors = {
            name: fuse(images.encode_images(views_of(block, where(block, name))), ViewSettings().weights)[0]
            for name, block in blocks.items()
        }

    def encode_texts(self, texts: Sequence[str]) -> NDArray[np.float32]:
        return np.stack([next(v for name, v in self.vectors.items() if name in text) for text in texts])


class Unwilling:
    """A runner that refuses one stage."""

    def __init__(self, refused: Stage) -> None:
        self.refused = refused
        self.dropped: dict[str, int] = {}

    def run_stage(self, stage: Stage, items: int, work: Callable[[], T]) -> T | None:
        return None if stage is self.refused else work()

    def batch(self, stage: Stage, most: int) -> int:
        return most

    def drop(self, what: str, amount: int) -> None:
        self.dropped[what] = self.dropped.get(what, 0) + amount

    def pictured(self, masks: int, crops: int) -> None:
        return


def whole_boxes(boxes_px: NDArray[np.float32], sight: Sight, hw: tuple[int, int]) -> Masks:
    masks = np.zeros((len(boxes_px), *hw), np.bool_)
    for k, (x0, y0, x1, y1) in enumerate(boxes_px.astype(int).tolist()):
        masks[k, y0:y1, x0:x1] = True
    return Masks(masks, np.ones(len(boxes_px), np.float32))


@pytest.fixture(scope="module")
def encoder(tmp_path_factory: pytest.TempPathFactory) -> ClipImageEncoder:
    weights = np.random.default_rng(3).normal(size=(3, 8))
    path = image_encoder(tmp_path_factory.mktemp("models") / "image.onnx", weights)
    return ClipImageEncoder(Session(path), "colours", side_px=8)


@pytest.fixture
def models(encoder: ClipImageEncoder) -> ModelSet:
    return ModelSet(
        encoder, None, None, ColourDetector(), ColourSegmenter(), None, whole_boxes, lambda: None, lambda: None
    )


def picture(*blocks: tuple[str, int, int], size: int = 30, scale: int = 1) -> NDArray[np.uint8]:
    """Grey with coloured squares at (x, y), as RGB."""
    image = np.full((*HW, 3), 90, np.uint8)
    for name, x, y in blocks:
        image[y : y + size, x : x + size] = COLOURS[name]
    return np.asarray(image.repeat(scale, 0).repeat(scale, 1), np.uint8)


def job_of(
    image_rgb: NDArray[np.uint8], sight: Sight = NO_SIGHT, known: KnownThings = NOTHING_KNOWN, stamp: int = 7
) -> PerceptionJob:
    image = CameraImage(stamp, "camera", np.ascontiguousarray(image_rgb[..., ::-1]))
    view = CameraView(stamp, np.eye(4), CAMERA, None, image)
    return PerceptionJob(1, view, np.zeros((0, 3), np.float32), np.zeros(0, np.uint8), sight, known)


def chain_of(models: ModelSet, **changes: object) -> Chain:
    return Chain(replace(PerceptionSettings(), **changes), models, tuple(COLOURS))  # type: ignore[arg-type]


def seen(chain: Chain, job: PerceptionJob) -> Detections:
    eyes = InlineEyes(chain, BudgetSettings(), COSTS)
    eyes.offer(job)
    (result,) = eyes.results()
    assert result.job is job
    return result.detections


def test_every_thing_has_its_mask_its_name_and_its_embedding(models: ModelSet, encoder: ClipImageEncoder) -> None:
    image = picture(("chair", 10, 10), ("lamp", 100, 60))
    found = seen(chain_of(models), job_of(image))
    assert sorted(found.label) == ["chair", "lamp"]
    assert (found.stamp_ns, found.frame_id, found.unsure_px) == (7, "camera", None)
    for number, label, ranked in zip(found.number.tolist(), found.label, found.top_labels, strict=True):
        np.testing.assert_array_equal(found.ids_px == number, where(image, label))
        assert ranked[0] == (label, pytest.approx(0.9))
    assert found.embedding is not None
    assert found.measured is not None
    assert found.measured.all()
    np.testing.assert_allclose(np.linalg.norm(found.embedding, axis=1), 1.0, atol=1e-6)
    views = views_of(image, where(image, found.label[0]))
    parts = encoder.encode_images(views)
    weights = ViewSettings().weights
    mean = sum(w * p for w, p in zip(weights, parts, strict=True))
    np.testing.assert_allclose(found.embedding[0], mean / np.linalg.norm(mean), atol=1e-6)


def test_the_same_picture_gives_the_same_bytes(models: ModelSet) -> None:
    image = picture(("chair", 10, 10), ("lamp", 100, 60), ("sofa", 60, 20))
    one, two = (seen(chain_of(models), job_of(image)) for _ in range(2))
    assert one.embedding is not None
    assert two.embedding is not None
    assert (one.ids_px.tobytes(), one.embedding.tobytes(), one.top_labels) == (
        two.ids_px.tobytes(), two.embedding.tobytes(), two.top_labels,
    )  # fmt: skip


def test_an_empty_picture_is_a_normal_value(models: ModelSet) -> None:
    found = seen(chain_of(models), job_of(picture()))
    assert len(found.number) == 0
    assert not found.ids_px.any()


def test_what_the_rung_leaves_no_time_for_is_unsure(models: ModelSet) -> None:
    image = picture(("chair", 10, 10), ("chair", 60, 10), ("chair", 110, 10))
    runner = Unwilling(Stage.TAG)
    found = chain_of(models).see(job_of(image), replace(FULL, masks=2), runner)
    assert found is not None
    assert len(found.number) == 2
    assert found.unsure_px is not None
    np.testing.assert_array_equal(found.unsure_px, where(image, "chair") & (found.ids_px == 0))
    assert runner.dropped["masks: more than the rung allows"] == 1


def test_masks_that_could_not_be_embedded_are_unsure_and_not_things(models: ModelSet) -> None:
    image = picture(("chair", 10, 10))
    runner = Unwilling(Stage.EMBED)
    found = chain_of(models).see(job_of(image), FULL, runner)
    assert found is not None
    assert len(found.number) == 0
    assert found.unsure_px is not None
    np.testing.assert_array_equal(found.unsure_px, where(image, "chair"))
    assert runner.dropped["crops: not embedded"] == 3


def test_without_a_detector_run_there_is_no_keyframe(models: ModelSet) -> None:
    assert chain_of(models).see(job_of(picture(("chair", 10, 10))), FULL, Unwilling(Stage.DETECT)) is None


def test_boxes_stand_in_where_the_segmenter_may_not_run(models: ModelSet) -> None:
    found = chain_of(models).see(job_of(picture(("chair", 10, 10))), FULL, Unwilling(Stage.SEGMENT))
    assert found is not None
    assert found.label == ("chair",)


def test_without_a_detector_everything_is_segmented_and_named_by_resemblance(
    models: ModelSet, encoder: ClipImageEncoder
) -> None:
    image = picture(("chair", 10, 10), ("sofa", 100, 60))
    alone = replace(models, detector=None, everything=ColourSegmenter())
    names = ZeroShotTagger(encoder, ColourWords(encoder), tuple(COLOURS), threshold=0.0)
    found = seen(chain_of(replace(alone, names=names)), job_of(image))
    assert sorted(found.label) == ["chair", "sofa"]
    for ranked in found.top_labels:
        scores = [score for _, score in ranked]
        assert scores == sorted(scores, reverse=True)
        assert sum(scores) <= 1 + 1e-6
    unnamed = seen(chain_of(alone), job_of(image))
    assert set(unnamed.label) == {"object"}


def known_chair(image: NDArray[np.uint8], looks: int) -> tuple[Sight, KnownThings]:
    """The chair of a picture as a thing that was embedded ``looks`` times already."""
    row, column = np.nonzero(where(image, "chair"))
    pixel = np.stack([column, row], 1).astype(np.float32)[::5]
    owner = np.zeros(len(pixel), np.int32)
    known = KnownThings(
        owner, np.array([4]), np.eye(1, 8, dtype=np.float32), np.array([looks], np.int32), np.array([looks], np.int32),
        np.zeros(1, np.int64),
    )  # fmt: skip
    return Sight(pixel, np.ones(len(pixel), np.float32), owner, np.zeros(len(pixel), np.bool_)), known


@pytest.mark.parametrize(("looks", "measured"), [(1, True), (FULL.looks, False)])
def test_a_thing_that_is_known_well_is_not_embedded_again(models: ModelSet, looks: int, measured: bool) -> None:
    image = picture(("chair", 10, 10))
    sight, known = known_chair(image, looks)
    found = seen(chain_of(models), job_of(image, sight, known))
    assert found.measured is not None
    assert found.embedding is not None
    assert found.measured.tolist() == [measured]
    assert np.array_equal(found.embedding[0], known.embedding[0]) != measured


def test_a_large_picture_is_reduced_and_its_masks_are_not(models: ModelSet) -> None:
    image = picture(("chair", 10, 10), scale=4)
    sight, known = known_chair(image, FULL.looks)
    camera = replace(CAMERA, width_px=640, height_px=480)
    job = job_of(image, sight, known)
    job = replace(job, view=replace(job.view, camera=camera))
    found = chain_of(models).see(job, replace(FULL, side_px=160), Unwilling(Stage.TAG))
    assert found is not None
    assert found.measured is not None
    np.testing.assert_array_equal(found.ids_px > 0, where(image, "chair"))
    assert found.measured.tolist() == [
        False
    ]  # recognised through the map's points, which are in the large picture's pixels


def test_prompts_are_tags_or_what_the_picture_resembles(models: ModelSet, encoder: ClipImageEncoder) -> None:
    image = picture(("chair", 10, 10), ("lamp", 60, 10), ("sofa", 100, 60))
    tagged = replace(models, tagger=LampTagger())
    assert seen(chain_of(tagged, prompts="tags"), job_of(image)).label == ("lamp",)
    resembling = ZeroShotTagger(encoder, ColourWords(encoder), tuple(COLOURS), top=2, threshold=0.0)
    found = seen(chain_of(replace(models, tagger=resembling), prompts="zero_shot"), job_of(image))
    assert set(found.label) <= set(resembling.tag(image).labels)


def test_boxes_of_one_name_suppress_each_other_and_no_others() -> None:
    boxes = np.array([[0, 0, 10, 10], [1, 0, 11, 10], [0, 0, 10, 10], [50, 50, 60, 60]], np.float32)
    scores = np.array([0.5, 0.9, 0.4, 0.9], np.float32)
    assert best_boxes(boxes, scores, np.array([0, 0, 1, 0]), 0.5).tolist() == [1, 3, 2]
    assert best_boxes(boxes[:0], scores[:0], np.zeros(0, np.int32), 0.5).tolist() == []


def test_a_small_mask_lies_on_a_large_one() -> None:
    masks = np.zeros((2, 8, 8), np.bool_)
    masks[0, 2:4, 2:4], masks[1] = True, True
    ids = paint(masks)
    assert (ids[2:4, 2:4] == 1).all()
    assert (ids == 2).sum() == 60


def test_shares_are_iou_over_the_points_of_the_map() -> None:
    ids = np.zeros((10, 10), np.uint16)
    ids[:, :5], ids[:, 5:] = 1, 2
    x, y = np.meshgrid(np.arange(10), np.arange(10))
    pixel = np.stack([x.ravel(), y.ravel()], 1).astype(np.float32)
    owner = np.where(pixel[:, 0] < 6, 0, -1).astype(np.int32)
    share = share_with_known(ids, pixel, owner, 2, 1)
    np.testing.assert_allclose(share, [[50 / 60], [10 / 100]])


def test_views_show_the_mask_its_shape_and_its_surroundings() -> None:
    image = picture(("chair", 60, 40))
    mask = where(image, "chair")
    masked, binary, enhanced = views_of(image, mask)
    assert masked.shape == binary.shape
    assert set(np.unique(binary)) == {0, 255}
    assert (masked[binary[..., 0] == 0] == (122, 116, 104)).all()
    assert enhanced.shape[0] > masked.shape[0]
    assert (enhanced[0, 0] == 45).all()  # grey, dimmed
    one = np.zeros(HW, np.bool_)
    one[0, 0] = True
    assert min(views_of(image, one)[0].shape[:2]) >= 4  # at the picture's corner


def test_settings_that_contradict_each_other_are_refused() -> None:
    check_perception(PerceptionSettings())
    with pytest.raises(ConfigError, match=r"a1 \+ a2 \+ a3 = 1\.1"):
        check_weights(ViewSettings(0.6, 0.1, 0.4))
    with pytest.raises(ConfigError, match="needs an image encoder"):
        check_perception(PerceptionSettings(detector="owlvit-b32"))
    with pytest.raises(ConfigError, match="needs a perception"):
        check_perception(PerceptionSettings(image_encoder="clip-vit-b32", prompts="tags"))
