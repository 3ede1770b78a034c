"""Whether a picture can show anything: dark, covered, or without one sharp edge. A pure judgement of one picture."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

_WIDTH_PX = 320  # pictures are judged at this width: pixel noise is averaged away, a harmful blur is not
_DARK_LEVEL = 20.0  # of 255; the brightest twentieth of the picture is below
_PLAIN_LEVELS = 10.0  # less than this between the darkest and the brightest twentieth
_EDGE_LEVELS = 40.0  # contrast within a window that makes it an edge
_EDGE_PX = 15  # the window
_MIN_EDGE_SHARE = 0.003  # of the picture; with fewer edges nothing is said about sharpness
_SHARP = 0.45  # see ``sharpness``


def judge_picture(bgr: NDArray[np.uint8]) -> tuple[str, str]:
    """(code of the fault, what was measured) of a picture uint8 [H, W, 3]; ("", "") when it is good enough to see by."""
    gray = _small(bgr)
    low, high = (float(v) for v in np.percentile(gray, (5, 95)))
    if high < _DARK_LEVEL:
        return "camera_dark", f"95 % of the picture are darker than {high:.0f} of 255"
    if high - low < _PLAIN_LEVELS:
        return "camera_covered", f"the picture is plain: {high - low:.0f} levels between dark and bright"
    sharp = sharpness(gray)
    if sharp is not None and sharp < _SHARP:
        width_px = 2.0 / sharp * bgr.shape[1] / gray.shape[1]
        return "camera_blurred", f"the sharpest edges are about {width_px:.0f} px wide"
    return "", ""


def sharpness(gray: NDArray[np.uint8]) -> float | None:
    """Steepest slope over contrast at the sharpest tenth of a picture's edges: 1 for steps, None without enough edges.

    A step blurred by a Gaussian of s pixels has a slope of contrast / (s sqrt(2 pi)) per pixel; the slope is taken over two pixels, so
    the value is about 0.8 / s. The threshold 0.45 is a blur of s = 1.8 of 320 pixels: no edge of the picture is drawn in under 1 % of
    its width. Noise hardly moves it, because slope and contrast are both of the same strong edges.
    """
    levels = gray.astype(np.float32)
    slope = np.maximum(
        np.abs(cv2.Sobel(levels, cv2.CV_32F, 1, 0, ksize=3)), np.abs(cv2.Sobel(levels, cv2.CV_32F, 0, 1, ksize=3))
    )
    window = np.ones((_EDGE_PX, _EDGE_PX), np.uint8)
    contrast = cv2.dilate(levels, window) - cv2.erode(levels, window)
    edges = contrast > _EDGE_LEVELS
    if edges.mean() < _MIN_EDGE_SHARE:
        return None
    steepest = cv2.dilate(slope, window) / 4.0  # Sobel's weights add up to 4, over two pixels
    return float(np.percentile(steepest[edges] / contrast[edges], 90))


def _small(bgr: NDArray[np.uint8]) -> NDArray[np.uint8]:
    scale = _WIDTH_PX / bgr.shape[1]
    if scale < 1.0:
        size = (_WIDTH_PX, max(1, round(bgr.shape[0] * scale)))
        bgr = np.asarray(cv2.resize(bgr, size, interpolation=cv2.INTER_AREA), np.uint8)
    return np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2GRAY), np.uint8)
