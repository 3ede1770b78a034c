"""Kernels over the points of one part of the map: how large it is, how thin, and of which pieces it consists."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from irsd.instances.settle import connected_parts
from irsd.instances.voxels import Floats


def diagonal(points: Floats) -> float:
    """Of the box of points [n, 3], n >= 1."""
    return float(np.linalg.norm(points.max(0) - points.min(0)))


def across(points: Floats) -> float:
    """Second largest by largest standard deviation of points [n, 3] along their principal axes; 0 for a line."""
    values = np.linalg.eigvalsh(np.cov(points.astype(np.float64).T))
    return float(np.sqrt(max(values[1], 0.0) / max(values[2], 1e-12)))


def pieces_of(points: Floats, link_m: float, least: int) -> NDArray[np.int64]:
    """Which piece each of points [n, 3] belongs to: connected ones of at least ``least`` points, smaller ones with the nearest."""
    part = np.asarray(connected_parts(points, link_m), np.int64)
    size = np.bincount(part, minlength=1)
    large = np.flatnonzero(size >= least)
    if len(large) < 2:
        return np.zeros(len(points), np.int64)
    number = np.full(len(size), -1, np.int64)
    number[large] = np.arange(len(large))
    out = number[part]
    rest = np.flatnonzero(out < 0)
    if len(rest):
        kept = np.flatnonzero(out >= 0)
        distance, nearest = cKDTree(points[kept]).query(points[rest])
        order = np.lexsort((distance, part[rest]))
        first = np.unique(part[rest][order], return_index=True)[1]
        of_part = dict(zip(part[rest][order][first].tolist(), out[kept[nearest[order][first]]].tolist(), strict=True))
        out[rest] = [of_part[p] for p in part[rest].tolist()]
    return out
