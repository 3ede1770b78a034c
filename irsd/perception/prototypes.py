"""What an operator taught, as further names: a thing that looks like the one that was named gets a say for its name.

The networks put things of one kind near each other, wherever the words lie: so an example is compared by cosine as a word is, less
``MARGIN``, which is about what two things of different kinds have in common beyond their words.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]
MARGIN = 0.2


@dataclass(frozen=True, slots=True)
class Example:
    """A taught name with what its thing is like: unit vectors float32 [D] by shape and by picture, None where there is none."""

    name: str
    shape: Floats | None
    image: Floats | None


def liken(examples: Sequence[Example], shape: Floats | None, image: Floats | None) -> dict[str, tuple[float, float]]:
    """For each taught name the best (cosine by shape, cosine by picture), less ``MARGIN``, as a word's cosines would be.

    Where a side has nothing to compare, the other's cosine stands in for it; an example without any common side says nothing.
    """
    out: dict[str, tuple[float, float]] = {}
    for example in examples:
        by_shape = _cosine(example.shape, shape)
        by_image = _cosine(example.image, image)
        if by_shape is None and by_image is None:
            continue
        known = [c for c in (by_shape, by_image) if c is not None]
        pair = (known[0] if by_shape is None else by_shape, known[-1] if by_image is None else by_image)
        less = (pair[0] - MARGIN, pair[1] - MARGIN)
        if example.name not in out or sum(less) > sum(out[example.name]):
            out[example.name] = less
    return out


def _cosine(one: Floats | None, other: Floats | None) -> float | None:
    if one is None or other is None or one.shape != other.shape or not one.any() or not other.any():
        return None
    return float(one @ other)
