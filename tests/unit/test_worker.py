"""The eyes live: real threads, a real network, the process's own clocks. What must hold whenever it happens, not when it happens."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from tiny_onnx import image_encoder, slow_image_encoder

from irsd.core.runtime import Event, Stopper, Worker, monotonic_s, sleep_s
from irsd.core.types import CameraImage, CameraModel, CameraView, KnownThings
from irsd.perception.budget import BudgetSettings, Governor, Stage
from irsd.perception.chain import Chain, ModelSet
from irsd.perception.families.clip import ClipImageEncoder
from irsd.perception.inline import InlineEyes
from irsd.perception.job import PerceptionJob, PerceptionResult, Sight
from irsd.perception.models import Cancel, Session
from irsd.perception.roles import Boxes, Masks
from irsd.perception.settings import PerceptionSettings
from irsd.perception.worker import LiveEyes

WAIT_S = 60.0
HW = (48, 64)
PLENTY = BudgetSettings(cpu_cores=64.0, latency_p95_ms=1e6, rss_mb=64_000.0)


class OneBox:
    """Finds the middle of every picture."""

    def detect(self, image_rgb: NDArray[np.uint8], prompts: tuple[str, ...]) -> Boxes:
        return Boxes(np.array([[16, 12, 48, 36]], np.float32), np.ones(1, np.float32), np.zeros(1, np.int32))


def whole_boxes(boxes_px: NDArray[np.float32], sight: Sight, hw: tuple[int, int]) -> Masks:
    masks = np.zeros((len(boxes_px), *hw), np.bool_)
    for k, (x0, y0, x1, y1) in enumerate(boxes_px.astype(int).tolist()):
        masks[k, y0:y1, x0:x1] = True
    return Masks(masks, np.ones(len(boxes_px), np.float32))


def job(seq: int, dimension: int = 8) -> PerceptionJob:
    bgr = np.full((*HW, 3), seq % 200 + 20, np.uint8)
    camera = CameraModel("camera", HW[1], HW[0], np.eye(3), "plumb_bob", np.zeros(0))
    view = CameraView(seq * 1_000_000_000, np.eye(4), camera, None, CameraImage(seq, "camera", bgr))
    none, nobody = np.zeros(0, np.float32), np.zeros(0, np.int32)
    known = KnownThings(
        nobody, nobody.astype(np.int64), np.zeros((0, dimension), np.float32), nobody, nobody, nobody.astype(np.int64)
    )
    sight = Sight(np.zeros((0, 2), np.float32), none, nobody, np.zeros(0, np.bool_))
    return PerceptionJob(seq, view, np.zeros((0, 3), np.float32), np.zeros(0, np.uint8), sight, known)


def chain_on(path: Path) -> Chain:
    cancel = Cancel()
    encoder = ClipImageEncoder(Session(path, cancel=cancel), "colours", side_px=8)
    models = ModelSet(encoder, None, None, OneBox(), None, None, whole_boxes, cancel.request, cancel.clear)
    return Chain(PerceptionSettings(), models, ("thing",))


@contextmanager
def running(eyes: LiveEyes) -> Iterator[Event]:
    """The eyes' threads; the event that results set."""
    stopper, wake, failures = Stopper(), Event(), []
    workers = [
        Worker("perception", lambda: eyes.run(stopper, lambda thread: None, wake), failures.append),
        Worker("watch", lambda: eyes.watch(stopper), failures.append),
    ]
    for worker in workers:
        worker.start()
    try:
        yield wake
    finally:
        stopper.request("test over")
        assert all(worker.join(WAIT_S) for worker in workers)
        assert not failures


def until(condition: Callable[[], bool]) -> bool:
    deadline_s = monotonic_s() + WAIT_S
    while not condition():
        if monotonic_s() > deadline_s:
            return False
        sleep_s(0.01)
    return True


@pytest.fixture
def quick(tmp_path: Path) -> Chain:
    return chain_on(image_encoder(tmp_path / "quick.onnx", np.eye(3, 8)))


def test_results_carry_their_job_and_the_latest_picture_wins(quick: Chain) -> None:
    eyes = LiveEyes(quick, Governor(PLENTY, {Stage.DETECT: (0.001, 0.0), Stage.EMBED: (0.0, 0.001)}), threads=())
    eyes.warm_up()
    for seq in (1, 2, 3):
        eyes.offer(job(seq))  # nobody takes them yet: 3 replaces 2 replaces 1
    results: list[PerceptionResult] = []
    with running(eyes) as wake:
        assert wake.wait(WAIT_S)
        assert until(lambda: bool(results) or bool(results.extend(eyes.results())) or bool(results))
    (result,) = results
    assert result.job.seq == 3
    assert result.detections.stamp_ns == 3_000_000_000
    assert result.detections.label == ("thing",)
    report = eyes.report()
    assert (report["jobs"], report["jobs_replaced"]) == (3, 2)
    assert report["costs"]["embed"]["runs"] >= 2  # the warm-up's


def test_an_over_long_run_is_ended_and_said(tmp_path: Path) -> None:
    slow = chain_on(slow_image_encoder(tmp_path / "slow.onnx"))
    eyes = LiveEyes(slow, Governor(PLENTY, {Stage.DETECT: (0.001, 0.0), Stage.EMBED: (0.0, 1e-6)}), threads=())
    eyes.offer(job(1, 3))
    with running(eyes):
        assert until(lambda: eyes.report().get("dropped", {}).get("embed: over-long, ended", 0) > 0)
        assert until(lambda: eyes.answers_wait)
    (result,) = eyes.results()
    assert len(result.detections.number) == 0  # found, and not looked into
    assert result.detections.unsure_px is not None
    assert result.detections.unsure_px[12:36, 16:48].all()


def test_a_late_map_keeps_the_eyes_shut(quick: Chain) -> None:
    settings = BudgetSettings(cpu_cores=64.0, rss_mb=64_000.0)
    eyes = LiveEyes(quick, Governor(settings, {Stage.DETECT: (0.001, 0.0), Stage.EMBED: (0.0, 0.001)}), threads=())
    with running(eyes):
        for _ in range(20):
            eyes.note_lag(3.0)
        assert until(lambda: eyes.rooms_every > 1)
        assert eyes.report()["why"].startswith("latency")
        assert not eyes.wants(0)


def test_stopping_ends_a_run_that_would_go_on(tmp_path: Path) -> None:
    slow = chain_on(slow_image_encoder(tmp_path / "slow.onnx"))
    eyes = LiveEyes(slow, Governor(PLENTY, {Stage.DETECT: (0.001, 0.0), Stage.EMBED: (0.0, 1e6)}), threads=())
    eyes.offer(job(1, 3))
    with running(eyes):
        assert until(lambda: not eyes.waiting)
    # ``running`` asserts that the threads have ended


def test_where_map_and_models_do_not_fit_the_models_go_and_the_map_goes_on(quick: Chain) -> None:
    settings = BudgetSettings(cpu_cores=64.0, latency_p95_ms=1e6, rss_mb=1.0)
    eyes = LiveEyes(quick, Governor(settings, {Stage.DETECT: (0.001, 0.0), Stage.EMBED: (0.0, 0.001)}), threads=())
    with running(eyes):
        assert until(lambda: eyes.report().get("ended_for_memory") == 1)
        assert eyes.report()["rung"] == "no detection"
        assert not eyes.wants(0)


def test_inline_the_same_jobs_give_the_same_answers_at_the_counted_rate(quick: Chain) -> None:
    counts = []
    for _ in range(2):
        eyes = InlineEyes(quick, BudgetSettings(cpu_cores=0.5), {Stage.DETECT: (0.6, 0.0), Stage.EMBED: (0.0, 0.04)})
        seen = []
        for tick in range(400):  # 100 s of pictures at 4 Hz
            if eyes.wants(tick * 250_000_000):
                eyes.offer(job(tick))
                seen += eyes.results()
        counts.append([(r.job.seq, r.detections.ids_px.tobytes()) for r in seen])
    assert counts[0] == counts[1]
    # 0.3 cores are left, a keyframe of 0.6 + 3 * 0.04 CPU s every 2.4 s
    assert 35 <= len(counts[0]) <= 45
