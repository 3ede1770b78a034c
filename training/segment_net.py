"""The segmenter's network, and what it is taught: targets and loss."""

from __future__ import annotations

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn
from torch.nn import functional

from irsd.perception.nano_decode import OFFSET_CELLS
from irsd.perception.nano_map import COLUMNS, ROWS, draw_map
from irsd.perception.nano_segmenter import CHANNELS, PARTS
from training.render_data import Frame, spoiled, thinned

Rng = np.random.Generator
CROP_ROWS, CROP_COLUMNS = 192, 256
_LEAST_CELLS = 6
_OF_PART = torch.tensor([1.0, 1.0, 1.0, 1.0, 2.0, 1.5])  # what a cell of a part counts in the loss: doors are rare


def conv(inputs: int, outputs: int, stride: int = 1, side: int = 3) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, side, stride, side // 2, bias=False), nn.BatchNorm2d(outputs), nn.ReLU(inplace=True)
    )


class Residual(nn.Module):
    def __init__(self, channels: int) -> None:
        super().__init__()
        self.body = nn.Sequential(
            conv(channels, channels), nn.Conv2d(channels, channels, 3, 1, 1, bias=False), nn.BatchNorm2d(channels)
        )

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return functional.relu(x + self.body(x))


_METRES = 2  # channels that ``placed`` adds to the map's three


class SegmentNet(nn.Module):
    """image [B, 3, H, W] (0..1) and map [B, 5, H/2, W/2] (``placed``) to heads and parts [B, 5 + 6, H/2, W/2]: a U-Net with its work at an eighth and
    below."""

    def __init__(self) -> None:
        super().__init__()
        self.stem = conv(3, 16, 2)
        self.down = nn.ModuleList(
            [
                nn.Sequential(conv(19 + _METRES, 32, 2), conv(32, 32)),
                nn.Sequential(conv(32, 64, 2), Residual(64)),
                nn.Sequential(conv(64, 96, 2), Residual(96)),
                nn.Sequential(conv(96, 128, 2), Residual(128)),
            ]
        )
        self.narrow = nn.ModuleList(
            [conv(128, 96, side=1), conv(96, 64, side=1), conv(64, 32, side=1), conv(32, 19, side=1)]
        )
        self.up = nn.ModuleList([conv(96, 96), conv(64, 64), conv(32, 32), conv(19, 19)])
        self.head = nn.Conv2d(19, CHANNELS + PARTS, 1)
        nn.init.constant_(self.head.bias, 0.0)
        self.head.bias.data[:3] = -2.0

    def forward(self, image: torch.Tensor, map_: torch.Tensor) -> torch.Tensor:
        x = torch.cat([self.stem(image * 4 - 2), map_], 1)
        levels = [x]
        for block in self.down:
            x = block(x)
            levels.append(x)
        for k, (narrow, up) in enumerate(zip(self.narrow, self.up, strict=True)):
            below = levels[-2 - k][:, : up[0].in_channels]
            x = functional.interpolate(narrow(x), size=below.shape[-2:], mode="nearest")
            x = up(x + below)
        return self.head(x)


def placed(map_: torch.Tensor, down: torch.Tensor, across: torch.Tensor) -> torch.Tensor:
    """The map's three channels [B, 3, h, w] and where its cells lie: below and right of the optical axis, in metres but for the focal
    length. down [B, h, 1], across [B, 1, w]: cells' places from the picture's middle, as shares of its width."""
    depth = (map_[:, 0] > 0).float() / map_[:, 0].clamp(min=0.05)
    return torch.cat([map_, (depth * down).clamp(-3, 3)[:, None], (depth * across).clamp(-6, 6)[:, None] / 2], 1)


class Whole(nn.Module):
    """The network with the product's inputs: whole pictures, their middle on the optical axis."""

    def __init__(self, net: SegmentNet) -> None:
        super().__init__()
        self.net = net
        self.register_buffer("down", ((torch.arange(ROWS) + 0.5) / COLUMNS - ROWS / COLUMNS / 2).reshape(1, ROWS, 1))
        self.register_buffer("across", ((torch.arange(COLUMNS) + 0.5) / COLUMNS - 0.5).reshape(1, 1, COLUMNS))

    def forward(self, image: torch.Tensor, map_: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        out = self.net(image, placed(map_, self.down, self.across))
        return out[:, :CHANNELS], out[:, CHANNELS:]


# ------------------------------------------------------------------------------------------------ what it is taught
def example(frame: Frame, rng: Rng) -> tuple[NDArray, NDArray, NDArray, NDArray, NDArray, NDArray]:
    """(image uint8 [3, H, W], map float32 [3, H/2, W/2], numbers of things and parts [H/2, W/2], cells' places down [H/2, 1] and across [1, W/2] for
    ``placed``) of a spoiled crop at another scale."""
    scale = float(np.exp(rng.uniform(np.log(0.8), np.log(1.45))))
    rgb, thing, points = frame.rgb(), frame.thing, thinned(frame.points, rng)
    size = (max(round(rgb.shape[1] * scale), CROP_COLUMNS), max(round(rgb.shape[0] * scale), CROP_ROWS))
    rgb_hw = rgb.shape[:2]
    across, down = size[0] / rgb.shape[1], size[1] / rgb.shape[0]
    rgb = cv2.resize(rgb, size, interpolation=cv2.INTER_LINEAR if scale > 1 else cv2.INTER_AREA)
    thing, part = (cv2.resize(a, size, interpolation=cv2.INTER_NEAREST) for a in (thing, frame.part))
    left, top = int(rng.integers(0, size[0] - CROP_COLUMNS + 1)), int(rng.integers(0, size[1] - CROP_ROWS + 1))
    rgb, thing, part = (a[top : top + CROP_ROWS, left : left + CROP_COLUMNS] for a in (rgb, thing, part))
    places_down = ((np.arange(CROP_ROWS // 2) * 2 + 1 + top) / size[1] - 0.5) * rgb_hw[0] / rgb_hw[1]
    places_across = (np.arange(CROP_COLUMNS // 2) * 2 + 1 + left) / size[0] - 0.5
    pixel = (points[:, :2] + 0.5) * np.array([across, down], np.float32) - 0.5 - np.array([left, top], np.float32)
    if rng.random() < 0.5:
        rgb, thing, part = rgb[:, ::-1], thing[:, ::-1], part[:, ::-1]
        places_across = -places_across[::-1]
        pixel = pixel * np.array([-1, 1], np.float32) + np.array([CROP_COLUMNS - 1, 0], np.float32)
    shown = draw_map(
        np.ascontiguousarray(pixel, np.float32), np.ascontiguousarray(points[:, 2]), points[:, 3] > 0.5, 0.5, 0.5
    )[:, : CROP_ROWS // 2, : CROP_COLUMNS // 2]
    image = spoiled(np.ascontiguousarray(rgb), rng).transpose(2, 0, 1)
    where = places_down[:, None].astype(np.float32), places_across[None].astype(np.float32)
    return image, shown, thing[::2, ::2].astype(np.int32), part[::2, ::2], *where


def targets(thing: NDArray[np.int32], part: NDArray[np.uint8]) -> NDArray[np.float32]:
    """float32 [7, h, w] of numbers [h, w]: thing, border between things, nearness to a middle, offset across and down, weight, part."""
    h, w = thing.shape
    out = np.zeros((7, h, w), np.float32)
    out[0], out[5], out[6] = thing > 0, 1.0, part
    for one, other in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
        meet = (thing[one] != thing[other]) & (thing[one] > 0) & (thing[other] > 0)
        out[1][one] = np.maximum(out[1][one], meet)
        out[1][other] = np.maximum(out[1][other], meet)
    y, x = np.mgrid[:h, :w].astype(np.float32)
    count = np.bincount(thing.reshape(-1))
    for k in np.flatnonzero(count):
        if k == 0:
            continue
        mask = thing == k
        cy, cx, size = y[mask].mean(), x[mask].mean(), float(count[k])
        out[3][mask], out[4][mask] = (cx - x[mask]) / OFFSET_CELLS, (cy - y[mask]) / OFFSET_CELLS
        out[5][mask] = np.clip((300 / size) ** 0.5, 0.5, 4.0)
        if size >= _LEAST_CELLS:
            sigma = np.clip(0.12 * np.sqrt(size), 1.0, 5.0)
            bell = np.exp(-((x - round(cx)) ** 2 + (y - round(cy)) ** 2) / (2 * sigma**2))
            out[2] = np.maximum(out[2], bell)
    return out


def loss(heads: torch.Tensor, target: torch.Tensor) -> torch.Tensor:
    """Cross-entropy of thing, border and part, CenterNet's focal loss of middles (Zhou et al. 2019), L1 of the offsets on things."""
    weight = target[:, 5]
    thing = (functional.binary_cross_entropy_with_logits(heads[:, 0], target[:, 0], reduction="none") * weight).mean()
    border = functional.binary_cross_entropy_with_logits(heads[:, 1], target[:, 1], pos_weight=torch.tensor(3.0))
    p = torch.sigmoid(heads[:, 2]).clamp(1e-4, 1 - 1e-4)
    peak = target[:, 2] > 0.999
    right = -((1 - p) ** 2 * p.log())[peak].sum()
    wrong = -((1 - target[:, 2]) ** 4 * p**2 * (1 - p).log())[~peak].sum()
    middle = (right + wrong) / peak.sum().clamp(min=1)
    on = target[:, 0] * weight
    part = functional.cross_entropy(heads[:, CHANNELS:], target[:, 6].long(), weight=_OF_PART)
    offset = ((heads[:, 3:CHANNELS] - target[:, 3:5]).abs().sum(1) * on).sum() / on.sum().clamp(min=1)
    return thing + 0.5 * border + 0.3 * middle + 0.7 * offset + 0.4 * part
