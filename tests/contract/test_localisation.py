"""``irs/<robot>/map/odom`` over real zenoh sessions, its schema, and the same as TF."""

from __future__ import annotations

import json
import math
import socket
from collections.abc import Iterator
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from irsd.core.errors import DecodeError
from irsd.core.geometry import invert, pose_from_xy_yaw, yaw_of
from irsd.core.runtime import Ring, monotonic_s, sleep_s
from irsd.core.types import Localisation
from irsd.io import cdr
from irsd.io.keys import RobotKeys
from irsd.io.localisation import (
    LocalisationPublisher,
    MapFrame,
    TfPublisher,
    localisation_from_json,
    localisation_to_json,
)
from irsd.io.session import Sample, Session, ZenohSettings, open_session

KEYS = RobotKeys("r")
SCHEMA = Path(__file__).parents[2] / "docs" / "schema" / "localisation.json"
small = st.floats(-100, 100)


def where(x: float, y: float, yaw: float, state: str = "map") -> Localisation:
    return Localisation(5, "odom", pose_from_xy_yaw(x, y, yaw, 0.25), pose_from_xy_yaw(y, x, -yaw), state)


@pytest.fixture
def sessions() -> Iterator[tuple[Session, Session]]:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        settings = ZenohSettings(endpoint=f"tcp/127.0.0.1:{probe.getsockname()[1]}")
    with open_session(settings, "hub") as hub, open_session(settings, "peer") as peer:
        yield hub, peer


def eventually(check: object) -> None:
    end_s = monotonic_s() + 10.0
    while not check():  # type: ignore[operator]
        assert monotonic_s() < end_s
        sleep_s(0.02)


@settings(max_examples=40, deadline=None)
@given(small, small, st.floats(-3.1, 3.1), st.sampled_from(["map", "odometry", "off"]))
def test_documents_keep_their_schema_and_their_values(x: float, y: float, yaw: float, state: str) -> None:
    document = localisation_to_json(where(x, y, yaw, state), seq=1, frame="map")
    jsonschema.Draft202012Validator(json.loads(SCHEMA.read_text())).validate(json.loads(document))
    back = localisation_from_json(document)
    assert (back.stamp_ns, back.odom_frame, back.state) == (5, "odom", state)
    np.testing.assert_allclose(back.map_T_odom, where(x, y, yaw).map_T_odom, atol=1e-5)
    np.testing.assert_allclose(back.map_T_base, where(x, y, yaw).map_T_base, atol=1e-5)


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"[]",
        b"{}",
        b"\xff",
        b'{"schema": "irs/localisation/1", "state": "map"}',
        b"[" * 100_000,
        localisation_to_json(where(1, 2, 3), seq=1, frame="map").replace(b'"stamp_ns": 5', b'"stamp_ns": 1e999'),
        localisation_to_json(where(1, 2, 3), seq=1, frame="map").replace(b'"yaw": 3.0', b'"yaw": NaN'),
    ],
)
def test_other_bytes_are_refused(payload: bytes) -> None:
    with pytest.raises(DecodeError, match="irs/localisation/1"):
        localisation_from_json(payload)


def test_who_comes_late_asks_and_who_is_there_is_told(sessions: tuple[Session, Session]) -> None:
    hub, peer = sessions
    early = MapFrame(peer, KEYS)
    assert early.where is None
    assert early.to_map((1.0, 2.0, 0.5)) == pytest.approx((1.0, 2.0, 0.5))
    publisher = LocalisationPublisher(hub, KEYS, "map")
    eventually(lambda: publisher.publish(where(1.0, -2.0, 0.5)) or early.where is not None)
    late = MapFrame(peer, KEYS)
    assert late.where is not None
    expected = pose_from_xy_yaw(1.0, -2.0, 0.5) @ pose_from_xy_yaw(3.0, 4.0, 3.0)
    for frame in (early, late):
        x, y, yaw = frame.to_map((3.0, 4.0, 3.0))
        assert (x, y, yaw) == pytest.approx((*expected[:2, 3], yaw_of(expected)), abs=1e-4)
        assert -math.pi <= yaw <= math.pi
    peer.put(KEYS.map_odom, b"nonsense")
    eventually(lambda: early.bad_documents == 1)
    assert early.where is not None
    for handle in (early, late, publisher):
        handle.close()


def test_tf_says_the_same_under_the_keys_of_both_bridges(sessions: tuple[Session, Session]) -> None:
    hub, peer = sessions
    heard: Ring[Sample] = Ring(100)
    handles = [peer.subscribe("tf", heard), peer.subscribe("0/tf/**", heard)]
    publisher = LocalisationPublisher(hub, KEYS, "map", tf=TfPublisher(hub))
    told = where(1.0, -2.0, 0.5)
    samples: dict[str, Sample] = {}

    def both() -> bool:
        publisher.publish(told)
        samples.update({sample.key.split("/")[0]: sample for sample in heard.drain()})
        return set(samples) == {"tf", "0"}

    eventually(both)
    for sample in samples.values():
        (transform,) = cdr.read(sample.payload, cdr.TF_MESSAGE).transforms
        assert (transform.header.frame_id, transform.child_frame_id) == ("map", "odom")
        t, q = transform.transform.translation, transform.transform.rotation
        assert (t.x, t.y, t.z) == pytest.approx((1.0, -2.0, 0.25))
        assert yaw_of(invert(told.map_T_odom)) == pytest.approx(-2 * math.atan2(q.z, q.w))
    assert samples["0"].attachment
    for handle in (*handles, publisher):
        handle.close()
