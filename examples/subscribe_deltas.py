"""Prints what changes in a robot's scene graph: python subscribe_deltas.py [ROBOT] [ENDPOINT]."""

import json
import sys

import zenoh

robot, *endpoints = sys.argv[1:] or ["*"]  # * = every robot
config = zenoh.Config()
if endpoints:  # such as tcp/127.0.0.1:7447; without one, zenoh finds peers by multicast
    config.insert_json5("connect/endpoints", json.dumps(endpoints))
with zenoh.open(config) as session:
    # Subscribe before asking for the snapshot: nothing can fall between the two.
    deltas = session.declare_subscriber(f"irs/{robot}/graph/delta", zenoh.handlers.RingChannel(1000))
    seq = {}
    for reply in session.get(f"irs/{robot}/graph/snapshot"):
        if reply.ok is not None:
            snapshot = json.loads(reply.ok.payload.to_string())
            seq[str(reply.ok.key_expr).split("/")[1]] = snapshot["seq"]
            print(f"revision {snapshot['seq']}: {len(snapshot['rooms'])} rooms, {len(snapshot['instances'])} things")
    for sample in deltas:
        delta = json.loads(sample.payload.to_string())
        if delta["seq"] > seq.get(str(sample.key_expr).split("/")[1], 0):
            things = [f"{node['id']} {node['label']} in {node['room']}" for node in delta["instances"]]
            rooms = [f"{node['id']} {node['label']}" for node in delta["rooms"]]
            print(
                f"revision {delta['seq']}:",
                ", ".join(rooms + things),
                "| gone:",
                ", ".join(delta["removed"]),
                flush=True,
            )
