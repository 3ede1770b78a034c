"""Rooms of scanned buildings against hand-drawn truth: never below the best published method (README of the maps)."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import cv2
import numpy as np
import pytest

from irsd.rooms.segment import segment_map

MAPS = ("Freiburg52_scan", "lab_c_scan", "lab_ipa", "office_a")


@pytest.fixture(scope="module")
def scorer(shared_tools: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location("evaluate_rooms", shared_tools / "evaluate_rooms.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(("suffix", "published_sym"), [("", 0.75), ("_furnitures", 0.58)])
def test_rooms_of_scanned_buildings(shared_data: Path, scorer: ModuleType, suffix: str, published_sym: float) -> None:
    found = []
    for name in MAPS:
        image = cv2.imread(str(shared_data / "room_maps" / f"{name}{suffix}.png"), cv2.IMREAD_GRAYSCALE)
        truth = scorer.read_gt(str(shared_data / "room_maps" / f"{name}_gt_segmentation.png"))
        found.append(scorer.evaluate(segment_map(image, 0.05).labels, truth)["miou_sym"])
    assert np.mean(found) >= published_sym, dict(zip(MAPS, found, strict=True))
