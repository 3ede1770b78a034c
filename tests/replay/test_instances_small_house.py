"""Lifting and fusion on a recorded house (25 s, drifting odometry, noisy masks) against its ground truth."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from irsd.core.types import InstanceState
from irsd.instances.lift import LiftSettings, lift
from irsd.instances.memory import FusionSettings, InstanceMemory
from irsd.mapping.mapper import Mapper, MappingSettings
from irsd.perception.detections import DetectionPairer
from irsd.sensors.decode import decode, decode_detection_ids
from irsd.sensors.replay import read_messages
from irsd.sensors.sync import Synchronizer, SyncSettings

KINDS = {
    "/lidar/points": "lidar",
    "/odom": "odometry",
    "/tf_static": "tf_static",
    "/camera/camera_info": "camera_info",
}
TOPICS = [*KINDS, "/detections/ids", "/detections/info"]


def embed_with(truth: dict[str, object]):  # type: ignore[no-untyped-def]
    """Vectors by name: each name its own axis, the unambiguous synonyms of the recording that of their label."""
    meanings: dict[str, set[str]] = {}
    for thing in truth["instances"]:  # type: ignore[attr-defined]
        for name in (thing["label"], *thing["synonyms"]):
            meanings.setdefault(name, set()).add(thing["label"])
    labels = {thing["label"] for thing in truth["instances"]}  # type: ignore[attr-defined]
    axes: dict[str, int] = {}

    def embed(names: Sequence[str]) -> NDArray[np.float32]:
        out = np.zeros((len(names), 256), np.float32)
        for k, name in enumerate(names):
            labelled = meanings.get(name, {name})
            head = next(iter(labelled)) if name not in labels and len(labelled) == 1 else name
            out[k, axes.setdefault(head, len(axes))] = 1.0
        return out

    return embed


def build(house: Path, truth: dict[str, object]) -> tuple[InstanceState, ...]:
    synchronizer, mapper, pairer = Synchronizer(SyncSettings()), Mapper(MappingSettings()), DetectionPairer()
    memory = InstanceMemory(FusionSettings(), embed_with(truth))
    recordings = [house / "small_house_short.mcap", house / "small_house.detections.mcap"]
    end_ns = max(m.log_time_ns for m in read_messages(recordings[:1], ["/odom"]))
    for message in read_messages(recordings, TOPICS):
        if message.log_time_ns > end_ns:
            break
        if message.topic in KINDS:
            for sensed in decode(KINDS[message.topic], message.data):
                synchronizer.push(sensed)
        else:
            is_ids = message.topic == "/detections/ids"
            paired = pairer.push_ids(decode_detection_ids(message.data)) if is_ids else pairer.push_info(message.data)
            if paired is not None:
                synchronizer.push(paired)
        for frame in synchronizer.pop():
            mapper.integrate(frame)
            for view in frame.views:
                points, structure = mapper.visible(view.map_T_camera, view.camera, LiftSettings().max_range_m)
                memory.observe(view, lift(view, points, structure, LiftSettings()), None)
            memory.collect(frame.stamp_ns)
    return memory.states()


@pytest.fixture(scope="module")
def truth(shared_data: Path) -> dict[str, object]:
    document: dict[str, object] = json.loads((shared_data / "small_house" / "ground_truth.json").read_text())
    return document


@pytest.fixture(scope="module")
def states(shared_data: Path, truth: dict[str, object]) -> tuple[InstanceState, ...]:
    return build(shared_data / "small_house", truth)


def test_things_are_found_each_once(states: tuple[InstanceState, ...], truth: dict[str, object]) -> None:
    assert 15 <= len(states) <= 80
    assert [s.id for s in states] == sorted(s.id for s in states)
    sofas = [s for s in states if s.labels[0][0] == "sofa" and len(s.points_map) > 200]
    assert len(sofas) <= 1
    large = [s for s in states if len(s.points_map) > 150]
    assert len(large) >= 8


def test_no_voxel_has_two_owners(states: tuple[InstanceState, ...]) -> None:
    points = np.concatenate([s.points_map for s in states])
    assert len(np.unique(points, axis=0)) == len(points)


def test_labels_are_those_of_the_place(states: tuple[InstanceState, ...], truth: dict[str, object]) -> None:
    known = {n for thing in truth["instances"] for n in (thing["label"], *thing["synonyms"])}  # type: ignore[attr-defined]
    assert all(s.labels[0][0] in known for s in states if s.observations > 10)
    assert all(sum(score for _, score in s.labels) <= 1.0 + 1e-6 for s in states)
    assert all(0.0 < s.existence <= 1.0 for s in states)
