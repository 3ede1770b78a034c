"""The image encoder's network, and the masks, crops and names it is taught with."""

from __future__ import annotations

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn
from torch.nn import functional

from irsd.perception.encoder import DIMENSION, LabelEncoder
from irsd.perception.nano_image import CHANNELS, MEASURES, Geometry, network_inputs
from training.names import words
from training.render_data import Frame, sight_of, spoiled, thinned
from training.segment_net import Residual, conv

Rng = np.random.Generator
JUNK = "object"  # what two things at once, or a piece of wall, are called
_LEAST_PX = 80


class ImageNet(nn.Module):
    """crops [B, 5, 64, 64] and measures [B, 12] to unit vectors [B, 384]."""

    def __init__(self) -> None:
        super().__init__()
        self.body = nn.Sequential(
            conv(CHANNELS, 24, 2),
            conv(24, 48, 2),
            Residual(48),
            conv(48, 96, 2),
            Residual(96),
            conv(96, 160, 2),
            Residual(160),
        )
        self.size = nn.Sequential(nn.Linear(MEASURES, 64), nn.ReLU(), nn.Linear(64, 64), nn.ReLU())
        self.head = nn.Sequential(nn.Linear(160 + 64, 256), nn.ReLU(), nn.Dropout(0.15), nn.Linear(256, DIMENSION))

    def forward(self, crops: torch.Tensor, measures: torch.Tensor) -> torch.Tensor:
        seen = self.body(crops * 2 - 1)
        pooled = torch.cat([seen.mean((2, 3)), self.size(measures)], 1)
        return functional.normalize(self.head(pooled), dim=-1)


class Names:
    """Every name's vector, and which names are too much alike to be told apart."""

    def __init__(self, names: list[str], encoder: LabelEncoder) -> None:
        self.names = [*names, JUNK]
        self.number = {name: k for k, name in enumerate(self.names)}
        vectors = np.stack([encoder.encode(words(name)).mean(0) for name in self.names])
        self.vectors = torch.from_numpy(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))
        alike = self.vectors @ self.vectors.T > 0.75
        alike.fill_diagonal_(False)
        self.alike = alike

    def loss(self, embedding: torch.Tensor, number: torch.Tensor, scale: float = 20.0) -> torch.Tensor:
        """Cross-entropy over the cosines to all names, those alike to the right one left out."""
        logits = (embedding @ self.vectors.T * scale).masked_fill(self.alike[number], -30.0)
        return functional.cross_entropy(logits, number, label_smoothing=0.03)


def geometry_of(frame: Frame) -> Geometry:
    return Geometry(frame.matrix, frame.pose[2, :3], float(frame.pose[2, 3]))


def examples(frame: Frame, rng: Rng) -> tuple[NDArray, NDArray, list[str]]:
    """(crops, measures, names) of the things in a spoiled picture, their masks a little wrong, and of some junk."""
    masks, names = _masks(frame, rng)
    if not names:
        return np.zeros((0, CHANNELS, 64, 64), np.float32), np.zeros((0, MEASURES), np.float32), []
    rgb, points = spoiled(frame.rgb(), rng), thinned(frame.points, rng)
    if rng.random() < 0.5:
        rgb, masks = np.ascontiguousarray(rgb[:, ::-1]), np.ascontiguousarray(masks[:, :, ::-1])
        points = points * np.array([-1, 1, 1, 1], np.float32) + np.array([rgb.shape[1] - 1, 0, 0, 0], np.float32)
    geometry = None if rng.random() < 0.15 else geometry_of(frame)
    crops, measures = network_inputs(rgb, masks, sight_of(points), geometry)
    known = measures[:, 11:] > 0
    longer = rng.normal(0, 0.08, (len(measures), 1))  # things are a little larger elsewhere
    noise = np.concatenate(
        [np.repeat(longer, 2, 1), rng.normal(0, 0.04, (len(measures), 2)), rng.normal(0, 0.05, (len(measures), 2))], 1
    )
    measures[:, :6] += noise * known
    return crops, measures.astype(np.float32), names


def _masks(frame: Frame, rng: Rng) -> tuple[NDArray[np.bool_], list[str]]:
    size = np.bincount(frame.thing.reshape(-1), minlength=2)
    numbers = [k for k in range(1, len(size)) if size[k] >= _LEAST_PX]
    numbers = rng.permutation(numbers)[:8].tolist() if numbers else []
    masks, names = [], []
    for k in numbers:
        mask = frame.thing == k
        masks.append(_worn(mask, rng) if rng.random() < 0.4 else mask)
        names.append(frame.names[k - 1])
    if numbers and rng.random() < 0.25:
        masks.append(_junk(frame.thing, numbers, rng))
        names.append(JUNK)
    keep = [k for k, mask in enumerate(masks) if mask.sum() >= _LEAST_PX // 2]
    return np.array([masks[k] for k in keep]).reshape(-1, *frame.thing.shape), [names[k] for k in keep]


def _worn(mask: NDArray[np.bool_], rng: Rng) -> NDArray[np.bool_]:
    """A mask as a segmenter gives it: larger, smaller, or without an end."""
    kernel = np.ones((3, 3), np.uint8)
    out = mask.astype(np.uint8)
    kind = rng.integers(3)
    if kind == 0:
        out = cv2.dilate(out, kernel, iterations=int(rng.integers(1, 3)))
    elif kind == 1:
        out = cv2.erode(out, kernel, iterations=1)
    else:
        y, x = np.nonzero(mask)
        angle = rng.uniform(0, 2 * np.pi)
        along = x * np.cos(angle) + y * np.sin(angle)
        gone = along > np.quantile(along, rng.uniform(0.7, 1.0))
        out[y[gone], x[gone]] = 0
    return out.astype(np.bool_)


def _junk(thing: NDArray[np.uint16], numbers: list[int], rng: Rng) -> NDArray[np.bool_]:
    if rng.random() < 0.4 and len(numbers) > 2:
        return np.isin(thing, rng.choice(numbers, 2, replace=False))
    h, w = (int(rng.integers(12, 120)) for _ in range(2))
    top, left = int(rng.integers(0, thing.shape[0] - h)), int(rng.integers(0, thing.shape[1] - w))
    out = np.zeros(thing.shape, np.bool_)
    out[top : top + h, left : left + w] = True
    return out & (thing == 0)
