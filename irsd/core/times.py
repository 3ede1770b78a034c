"""Sensor time: what happens every so often, by stamps that may be set back."""

from __future__ import annotations


def is_due(stamp_ns: int, due_ns: int, period_ns: int) -> bool:
    """Whether what happens every ``period_ns``, next at ``due_ns``, is due at ``stamp_ns``.

    A stamp from before the last time means that the clock was set back: then it is due at once, not when the old time comes again.
    """
    return not due_ns - period_ns <= stamp_ns < due_ns
