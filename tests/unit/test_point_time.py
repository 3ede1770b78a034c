"""The unit and zero of per-point time, for every writer that is known and for some that lie."""

from __future__ import annotations

import numpy as np
import pytest

from irsd.core.errors import DecodeError
from irsd.sensors.point_time import offsets_s

STAMP_NS = 1_700_000_000_250_000_000
OFFSETS = np.random.default_rng(1).permutation(np.linspace(0, 0.1, 8000))
NS = (OFFSETS * 1e9).astype(np.int64)

WRITERS = {
    "t uint32 ns (Ouster)": (NS.astype(np.uint32), "t"),
    "offset_time uint32 ns (Livox)": (NS.astype(np.uint32), "offset_time"),
    "time float32 s": (OFFSETS.astype(np.float32), "time"),
    "time float64 s": (OFFSETS, "time"),
    "time float32 us": ((OFFSETS * 1e6).astype(np.float32), "time"),
    "time float32 ms": ((OFFSETS * 1e3).astype(np.float32), "time"),
    "time float32 ns": ((OFFSETS * 1e9).astype(np.float32), "time"),
    "t uint32 us": ((NS // 1000).astype(np.uint32), "t"),
    "timestamp float64 s, absolute": (STAMP_NS * 1e-9 + OFFSETS, "timestamp"),
    "timestamp float64 ns, absolute": ((STAMP_NS + NS).astype(np.float64), "timestamp"),
    "timestamp uint64 ns, absolute": ((STAMP_NS + NS).astype(np.uint64), "timestamp"),
    "timestamp float64 s, offset": (OFFSETS, "timestamp"),
    "timestamp uint64 us, absolute": (((STAMP_NS + NS) // 1000).astype(np.uint64), "timestamp"),
}


@pytest.mark.parametrize("writer", WRITERS)
def test_every_known_writer(writer: str) -> None:
    raw, name = WRITERS[writer]
    got = offsets_s(raw, STAMP_NS, name)
    assert got.dtype == np.float32
    np.testing.assert_allclose(got, OFFSETS, atol=2e-6)


@pytest.mark.parametrize("writer", WRITERS)
def test_big_endian_is_the_same(writer: str) -> None:
    raw, name = WRITERS[writer]
    np.testing.assert_array_equal(
        offsets_s(raw.astype(raw.dtype.newbyteorder(">")), STAMP_NS, name), offsets_s(raw, STAMP_NS, name)
    )


def test_no_points_no_times() -> None:
    assert offsets_s(np.zeros(0, np.float32), STAMP_NS, "time").shape == (0,)


def test_stamps_at_the_end_or_the_middle_of_the_turn() -> None:
    np.testing.assert_allclose(
        offsets_s((OFFSETS - 0.1).astype(np.float32), STAMP_NS, "time"), OFFSETS - 0.1, atol=1e-6
    )
    absolute = STAMP_NS * 1e-9 + OFFSETS - 0.05
    np.testing.assert_allclose(offsets_s(absolute, STAMP_NS, "timestamp"), OFFSETS - 0.05, atol=1e-6)
    signed = (NS - 100_000_000).astype(np.int32)
    np.testing.assert_allclose(offsets_s(signed, STAMP_NS, "t"), OFFSETS - 0.1, atol=1e-6)


def test_simulated_clocks_that_start_at_zero() -> None:
    for stamp_s in (3.0, 0.5, 600.0):
        stamp_ns = round(stamp_s * 1e9)
        np.testing.assert_allclose(offsets_s(stamp_s + OFFSETS, stamp_ns, "timestamp"), OFFSETS, atol=1e-6)
        np.testing.assert_allclose(offsets_s(OFFSETS.astype(np.float32), stamp_ns, "time"), OFFSETS, atol=1e-6)


def test_a_sensor_with_its_own_clock_still_tells_differences() -> None:
    for raw in (OFFSETS + 4242.5, (NS + 4_242_500_000_000).astype(np.uint64)):
        np.testing.assert_allclose(offsets_s(raw, STAMP_NS, "timestamp"), OFFSETS, atol=1e-6)


def test_few_points_in_ns_are_not_taken_for_us() -> None:
    few = np.array([0, 1_500_000], np.uint32)  # the start of a turn with nothing else in range
    np.testing.assert_allclose(offsets_s(few, STAMP_NS, "offset_time"), [0, 0.0015], atol=1e-9)


def test_a_flash_measures_all_at_once() -> None:
    np.testing.assert_array_equal(offsets_s(np.zeros(100_000, np.uint32), STAMP_NS, "t"), np.zeros(100_000))


def test_missing_times_stay_missing() -> None:
    raw = OFFSETS.astype(np.float32)
    raw[[0, 7]] = np.nan
    got = offsets_s(raw, STAMP_NS, "time")
    assert np.flatnonzero(np.isnan(got)).tolist() == [0, 7]
    assert np.isnan(offsets_s(np.full(3, np.nan), STAMP_NS, "time")).all()


@pytest.mark.parametrize("raw", [np.array([0.0, 1e300]), np.array([0, 2**63], np.uint64), np.array([-1e308, 1e308])])
def test_what_no_unit_explains_is_refused(raw: np.ndarray) -> None:
    with pytest.raises(DecodeError, match="no unit"):
        offsets_s(raw, STAMP_NS, "timestamp")
