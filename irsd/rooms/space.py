"""From plan evidence to the free space that rooms are cut from, and the walls around it."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from irsd.rooms.settings import SegmentSettings


@dataclass(frozen=True, slots=True)
class Plan:
    """What rooms are cut from: bool [H, W] each; lintel: structure above door height, None when that was not measured."""

    free: NDArray[np.bool_]
    wall: NDArray[np.bool_]
    lintel: NDArray[np.bool_] | None


def solid_walls(
    wall: NDArray[np.bool_], low: NDArray[np.bool_], settings: SegmentSettings, resolution_m: float
) -> NDArray[np.bool_]:
    """bool [H, W]: walls without the things that hang or stand alone, closed where nobody can pass between their parts.

    wall: structure above furniture height; low: anything at robot height. Gaps narrower than a passage are closed; where something
    stands at robot height as well (folded doors, a partition that barely reaches up), gaps of up to ``post_gap_m``.
    """
    _, labels, stats, _ = cv2.connectedComponentsWithStats(wall.astype(np.uint8), connectivity=8)
    extent = np.maximum(stats[:, cv2.CC_STAT_WIDTH], stats[:, cv2.CC_STAT_HEIGHT]) * resolution_m
    beneath = np.bincount(labels[low], minlength=len(stats))
    hangs = (extent <= settings.furniture_m) & (beneath < 0.2 * stats[:, cv2.CC_STAT_AREA])  # a lamp
    hangs[0] = True
    standing = ~hangs[labels]
    narrow = _bridged(standing, 0.75 * settings.opening_min_m / resolution_m)
    posts = _bridged(standing, settings.post_gap_m / resolution_m) & low
    return np.asarray(standing | narrow | posts)


def _bridged(mask: NDArray[np.bool_], gap: float) -> NDArray[np.bool_]:
    """Mask closed along straight lines of 12 directions over gaps of up to ``gap`` cells. Outside the grid nothing stands."""
    reach = round(gap / 2)
    padded = np.pad(mask, 2 * reach + 1).astype(np.uint8)
    result = np.asarray(padded)
    for angle in np.pi * np.arange(12) / 12:
        line = np.zeros((2 * reach + 1, 2 * reach + 1), np.uint8)
        step = np.rint(np.array([np.cos(angle), np.sin(angle)]) * reach).astype(int)
        cv2.line(line, (reach - step[0], reach - step[1]), (reach + step[0], reach + step[1]), 1)
        result = np.maximum(result, cv2.morphologyEx(padded, cv2.MORPH_CLOSE, line))
    inner = slice(2 * reach + 1, -(2 * reach + 1))
    return np.asarray(result[inner, inner] > 0)


def open_space(free: NDArray[np.bool_], settings: SegmentSettings, resolution_m: float) -> NDArray[np.bool_]:
    """bool [H, W]: free cells, and what stands or hides alone inside them and is too small to be structure."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats((~free).astype(np.uint8), connectivity=8)
    extent = np.maximum(stats[:, cv2.CC_STAT_WIDTH], stats[:, cv2.CC_STAT_HEIGHT]) * resolution_m
    touches = np.zeros(count, bool)
    for edge in (labels[0], labels[-1], labels[:, 0], labels[:, -1]):
        touches[edge] = True
    small = (extent <= settings.furniture_m) & ~touches
    small[0] = True
    space = np.asarray(small[labels])
    # Pieces smaller than a room, with nothing to merge with, are noise of the map.
    count, labels, stats, _ = cv2.connectedComponentsWithStats(space.astype(np.uint8), connectivity=4)
    large = stats[:, cv2.CC_STAT_AREA] * resolution_m**2 >= settings.min_room_m2
    large[0] = False
    return np.asarray(large[labels])
