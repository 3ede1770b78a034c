"""When each point of a sweep was measured: the unit and the zero of a cloud's time field, which no standard fixes.

Known writers: ``t`` uint32 ns since the stamp (Ouster); ``offset_time`` uint32 ns since the stamp (Livox); ``time`` float32 s
relative to the stamp, also negative (Velodyne, and us in some forks); ``timestamp`` float64, absolute seconds (Hesai, RoboSense),
absolute ns (Livox driver 2), or seconds since the stamp.

Rules, each physical rather than by name:
1. a unit that would make more points per second than any sensor does (``MAX_POINTS_PER_S``) is none;
2. whole numbers count ns, else us, else ms; fractional numbers count s, else ms, us, ns: the first unit with which all points lie
   within ``MAX_SWEEP_S`` of the stamp;
3. with each unit, numbers count from the stamp or from the epoch, whichever lies nearer to the stamp; an epoch that float32
   can't resolve to 1 ms is not believed;
4. a clock of its own (sensor not synchronised) still tells differences: counted from the first point, in the first unit that
   makes it one sweep;
5. anything else is a DecodeError: a guess would bend every wall.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from irsd.core.errors import DecodeError

TIME_FIELDS = ("offset_time", "t", "time", "timestamp", "time_stamp")

MAX_SWEEP_S = 1.5
"""No point of a sweep is farther than this from its stamp: LiDARs turn at 1 Hz or faster, stamped at start, middle or end."""

MAX_POINTS_PER_S = 10e6
"""The densest spinning LiDARs make 5.2 million points a second (128 beams, 20 Hz, dual return)."""

_WHOLE_UNITS_S = (1e-9, 1e-6, 1e-3)
_FRACTIONAL_UNITS_S = (1.0, 1e-3, 1e-6, 1e-9)


def offsets_s(raw: NDArray[Any], stamp_ns: int, name: str) -> NDArray[np.float32]:
    """float32 [N] seconds after ``stamp_ns`` of the raw time field [N] of any number type; NaN where it holds none.

    Raises DecodeError when no unit makes it a sweep.
    """
    if raw.size == 0:
        return np.zeros(0, np.float32)
    epoch, values = _from_first(raw)
    usable = values[np.isfinite(raw)]
    if usable.size == 0:
        return np.full(raw.shape, np.nan, np.float32)
    low, high = float(usable.min()), float(usable.max())
    ordered = _WHOLE_UNITS_S if raw.dtype.kind in "ui" else _FRACTIONAL_UNITS_S
    units_s = [unit_s for unit_s in ordered if not _too_dense(raw.size, (high - low) * unit_s)]
    for unit_s in units_s:
        zeros_s = [
            epoch * unit_s,
            _since_stamp_s(epoch, unit_s, stamp_ns),
        ]  # of the first point, either way of counting
        if raw.dtype.itemsize == 4 and raw.dtype.kind == "f" and np.spacing(np.float32(epoch)) * unit_s > 1e-3:
            zeros_s.pop()
        reach = [max(abs(zero + low * unit_s), abs(zero + high * unit_s)) for zero in zeros_s]
        best = int(np.argmin(reach))
        if reach[best] <= MAX_SWEEP_S:
            return np.asarray(values * unit_s + zeros_s[best], np.float32)
    for unit_s in units_s:
        if (high - low) * unit_s <= MAX_SWEEP_S:
            return np.asarray((values - low) * unit_s, np.float32)
    raise DecodeError(
        f"PointCloud2: field {name} ({raw.dtype.name}) spans {high - low:g}: no unit makes that one sweep"
    )


def _from_first(raw: NDArray[Any]) -> tuple[float | int, NDArray[np.float64]]:
    """The first usable value, and all values minus it as float64 [N]. Whole numbers stay exact (epoch ns need 61 bits)."""
    if raw.dtype.kind == "f":
        values = raw.astype(np.float64)
        usable = np.flatnonzero(np.isfinite(values))
        first = float(values[usable[0]]) if usable.size else 0.0
        with np.errstate(invalid="ignore", over="ignore"):
            return first, values - first
    whole = raw.astype(np.int64)
    return int(whole[0]), (whole - whole[0]).astype(np.float64)


def _since_stamp_s(epoch: float | int, unit_s: float, stamp_ns: int) -> float:
    """Seconds from the stamp to ``epoch`` units after 1970, exact where epoch is a whole number of ns."""
    if isinstance(epoch, int):
        return (epoch * round(unit_s * 1e9) - stamp_ns) * 1e-9
    per_second = round(1 / unit_s)
    seconds, nanos = divmod(stamp_ns, 1_000_000_000)
    whole, rest = divmod(epoch, per_second) if abs(epoch) < 1e300 else (epoch, 0.0)
    return (whole - seconds) + rest * unit_s - nanos * 1e-9


def _too_dense(count: int, span_s: float) -> bool:
    """Whether ``count`` points in this time are more than a sensor can make. All at one instant (a flash) is not dense."""
    return span_s > 0 and count > MAX_POINTS_PER_S * span_s
