"""A short walk over every target of ``make fuzz``; hypothesis chooses which inputs, and shrinks to the smallest number that fails."""

from __future__ import annotations

import time

import pytest
from fuzz_targets import Target, bomb, one_input, refused, targets
from hypothesis import given, seed, settings
from hypothesis import strategies as st

from irsd.core.errors import DecodeError
from irsd.sensors.decode import decode_compressed_image, decode_detection_ids

HANG_S = 1.0  # of CPU: ten times the bar, so that a busy machine's caches can't fail it; make fuzz holds the bar itself


@pytest.mark.parametrize("target", targets(), ids=lambda target: target.name)
def test_only_refusals(target: Target) -> None:
    if target.name.startswith("decode"):
        target.run(target.seeds[0])

    @seed(1)
    @settings(max_examples=40, deadline=None, database=None)
    @given(st.integers(0, 10**6))
    def walk(number: int) -> None:
        data = one_input(target, number)
        began_s = time.thread_time()
        try:
            target.run(data)
        except Exception as error:
            if not refused(error):
                raise
        assert time.thread_time() - began_s < HANG_S

    walk()


def test_what_was_found_stays_found() -> None:
    """Inputs of earlier findings: a chunk's length of gigabytes made OpenCV ask for them."""
    by_name = {target.name: target for target in targets()}
    for name, number in (("decode.image_compressed", 658), ("decode.detections_ids", 1862), ("codec.occupancy", 40)):
        with pytest.raises(DecodeError):
            by_name[name].run(one_input(by_name[name], number))


def test_decompression_bombs_are_refused_by_their_header() -> None:
    for read in (decode_compressed_image, decode_detection_ids):
        with pytest.raises(DecodeError, match="claim 30000 x 30000"):
            read(bomb(30000, 30000))
