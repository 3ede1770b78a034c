"""Reading what ``training.render`` wrote, and spoiling pictures as cameras do."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from irsd.instances.part import ProposalSettings
from irsd.instances.settle import connected_parts
from irsd.perception.job import Sight

Rng = np.random.Generator
_LINK_M, _LEAST_POINTS = 0.08, 12  # of what is in sight: some of the voxels between are not
_STRUCTURE = np.array([0, 1, 2, 3, 4, 5, 2], np.uint8)  # of the renderer's parts; a carpet is floor


@dataclass(frozen=True, slots=True)
class Frame:
    """jpeg uint8 [n]; thing uint16 [240, 320]; part uint8 of the same size, ``Structure`` (empty where not known); points float16 [M, 4] (u, v, depth, structural); pose, matrix; names of things 1.."""

    jpeg: NDArray[np.uint8]
    thing: NDArray[np.uint16]
    part: NDArray[np.uint8]
    points: NDArray[np.float16]
    pose: NDArray[np.float64]
    matrix: NDArray[np.float64]
    names: tuple[str, ...]

    def rgb(self) -> NDArray[np.uint8]:
        image = cv2.imdecode(self.jpeg, cv2.IMREAD_COLOR)
        assert image is not None
        return np.ascontiguousarray(image[..., ::-1])


class Frames:
    """All frames of a folder; kept in memory (40 kB each packed, 0.2 MB with their ids)."""

    def __init__(self, folder: Path) -> None:
        self.frames: list[Frame] = []
        for path in sorted(folder.glob("scene_??????.npz")):
            with np.load(path) as data:
                self.frames += list(_frames({key: data[key] for key in data.files}))


def _frames(data: dict[str, NDArray]):
    jpeg, point = (np.concatenate([[0], np.cumsum(data[key])]) for key in ("jpeg_len", "pixel_len"))
    names = tuple(data["names"].tolist())
    for k in range(len(data["pose"])):
        yield Frame(
            data["jpeg"][jpeg[k] : jpeg[k + 1]], data["thing"][k], _STRUCTURE[data["part"][k]], data["pixel"][point[k] : point[k + 1]],
            data["pose"][k], data["matrix"][k], names,
        )  # fmt: skip


def sight_of(points: NDArray[np.floating], matrix: NDArray[np.float64] | None = None) -> Sight:
    """Rows (u, v, depth, structural) as the product has them. matrix: the camera's; with it, what hangs together of what is in sight
    and no structure is a part of the map that stands alone."""
    p = points.astype(np.float32)
    part = None if matrix is None else _parts(p, matrix)
    return Sight(p[:, :2], p[:, 2], np.full(len(p), -1, np.int32), p[:, 3] > 0.5, part)


def _parts(p: NDArray[np.float32], matrix: NDArray[np.float64]) -> NDArray[np.int32]:
    """Number of the part that each row (u, v, depth, structural) belongs to, 0 for structure, specks and heaps: int32 [M]."""
    across = (p[:, 0] - matrix[0, 2]) / matrix[0, 0] * p[:, 2]
    down = (p[:, 1] - matrix[1, 2]) / matrix[1, 1] * p[:, 2]
    xyz = np.stack([across, down, p[:, 2]], -1).astype(np.float32)
    loose = np.flatnonzero(p[:, 3] < 0.5)
    part = np.asarray(connected_parts(xyz[loose], _LINK_M))
    out = np.zeros(len(p), np.int32)
    for k in np.flatnonzero(np.bincount(part, minlength=1) >= _LEAST_POINTS).tolist():
        mine = loose[part == k]
        if np.linalg.norm(np.ptp(xyz[mine], axis=0)) <= ProposalSettings().max_size_m:
            out[mine] = k + 1
    return out


def thinned(points: NDArray[np.float16], rng: Rng) -> NDArray[np.float32]:
    """The map of a shorter drive, now and then none at all; structure as a labeller says it that misses much of walls and ceilings:
    whole regions, or here and there a point (measured on recordings: half of the walls with windows)."""
    p = points.astype(np.float32)
    if rng.random() < 0.12:
        return p[:0]
    if rng.random() < 0.5:
        p = p[rng.random(len(p)) < rng.uniform(0.15, 1.0)]
    kind = rng.random()
    if kind < 0.15:
        p = p * np.array([1, 1, 1, 0], np.float32)
    elif kind < 0.8 and len(p):
        coarse = rng.random((int(rng.integers(1, 6)), int(rng.integers(1, 7)))).astype(np.float32)
        chance = cv2.resize(
            np.clip(coarse * rng.uniform(0.8, 2.0) - rng.uniform(0, 0.6), 0, 1),
            (32, 24),
            interpolation=cv2.INTER_LINEAR,
        )
        column, row = np.clip(p[:, :2] / 10, 0, (31, 23)).astype(np.int64).T
        p[:, 3] *= rng.random(len(p)) < chance[row, column]
    if rng.random() < 0.3:  # the pose is a little off
        p = p + np.array([*rng.normal(0, 1.5, 2), 0, 0], np.float32)
    return p


def spoiled(rgb: NDArray[np.uint8], rng: Rng) -> NDArray[np.uint8]:
    """White balance, exposure, contrast, hue, vignette, blur (out of focus or moving), noise, JPEG: each now and then."""
    image = rgb.astype(np.float32)
    if rng.random() < 0.8:
        image = image * rng.uniform(0.6, 1.35) * rng.normal(1, 0.07, 3)
    if rng.random() < 0.5:
        image = 255 * np.clip(image / 255, 0, 1) ** rng.uniform(0.6, 1.6)
    if rng.random() < 0.4:
        grey = image.mean(-1, keepdims=True)
        image = grey + (image - grey) * rng.uniform(0.0, 1.5)
    if rng.random() < 0.15:
        image = image[..., rng.permutation(3)]
    if rng.random() < 0.2:
        y, x = np.linspace(-1, 1, image.shape[0])[:, None], np.linspace(-1, 1, image.shape[1])[None]
        image = image * (1 - rng.uniform(0, 0.4) * (x**2 + y**2) / 2)[..., None]
    if rng.random() < 0.3:
        image = cv2.GaussianBlur(image, (0, 0), rng.uniform(0.3, 1.3))
    if rng.random() < 0.12:
        size = int(rng.integers(2, 7))
        image = cv2.blur(image, (size, 1) if rng.random() < 0.8 else (1, size))
    if rng.random() < 0.6:
        image = image + rng.normal(0, rng.uniform(1, 9), (*image.shape[:2], 1 if rng.random() < 0.5 else 3))
    out = np.clip(image, 0, 255).astype(np.uint8)
    if rng.random() < 0.25:
        _, blob = cv2.imencode(".jpg", out, [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(30, 90))])
        out = np.asarray(cv2.imdecode(blob, cv2.IMREAD_COLOR), np.uint8)
    return out
