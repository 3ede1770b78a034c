"""Follows one room of a robot's scene graph: python subscribe_room.py ROBOT ROOM [ENDPOINT], such as bot1 R3."""

import json
import sys

import zenoh

robot, room, *endpoints = sys.argv[1:]
config = zenoh.Config()
if endpoints:  # such as tcp/127.0.0.1:7447; without one, zenoh finds peers by multicast
    config.insert_json5("connect/endpoints", json.dumps(endpoints))


def show(payload: zenoh.ZBytes) -> None:
    node = json.loads(payload.to_string())
    print(f"{node['id']} {node['label']}: {node['area_m2']:.1f} m2, holds {', '.join(node['instances'])}", flush=True)


with zenoh.open(config) as session:
    key = f"irs/{robot}/graph/rooms/{room}"
    changes = session.declare_subscriber(key, zenoh.handlers.RingChannel(10))
    for reply in session.get(key):  # its last value
        if reply.ok is not None:
            show(reply.ok.payload)
    for sample in changes:
        show(sample.payload)
