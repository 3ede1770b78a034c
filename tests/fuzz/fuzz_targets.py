"""What is fuzzed: every decoder and every question that irsd and nav_bridge answer, with valid messages to start from.

A target takes bytes and may only accept them or refuse them as an error of ours. Mutations are of the kind that breaks parsers: cut,
flip, repeat, splice, and lengths that lie. The same seed gives the same bytes.
"""

from __future__ import annotations

import json
import random
import struct
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from itertools import count

import cv2
import navigation_house as house
import numpy as np

from irsd.commands import read_edit, read_place, read_question
from irsd.core.errors import DecodeError, IrsdError
from irsd.core.geometry import make_pose
from irsd.core.grid import GridFrame
from irsd.core.types import (
    CameraImage,
    CameraModel,
    InstanceState,
    InstanceUpdate,
    LidarScan,
    Localisation,
    OdomSample,
    Plan,
    StaticTransform,
)
from irsd.graph import codec
from irsd.graph.builder import GraphBuilder, GraphSettings
from irsd.graph.model import GraphDelta
from irsd.ingest import IngestSettings, SensorDecoder
from irsd.io import cdr, keys
from irsd.io.localisation import localisation_from_json, localisation_to_json
from irsd.io.messages import error_text, parameters
from irsd.perception.aliases import AliasTable
from irsd.perception.detections import DetectionPairer
from irsd.perception.encoder import LabelEncoder
from irsd.plans import plan_from_bytes, plan_to_bytes
from irsd.sensors import encode
from irsd.sensors.decode import KINDS, decode, decode_detection_ids
from irsd.sensors.sync import Synchronizer, SyncSettings
from irsd.sensors.watch import SensorWatch, WatchSettings
from irsd.sim.orders import Orders
from nav_bridge.language import parse
from nav_bridge.requests import checked_goto, request_of

UPRIGHT = np.array([0.0, 0.0, 0.0, 1.0])
STAMP_NS = 1_700_000_000_250_000_000


@dataclass(frozen=True)
class Target:
    """run: given any bytes, returns or raises an IrsdError. seeds: bytes that are right."""

    name: str
    seeds: tuple[bytes, ...]
    run: Callable[[bytes], object]


# ------------------------------------------------------------------------------------------------------------ mutations
_LIES = (0, 1, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 10**9, 0x7FFFFFFF, 0x80000000, 0xFFFFFFF0, 0xFFFFFFFF)
_TEXTS = (
    "\u0000",
    "é" * 40,
    "\ud7ff",
    "🤖" * 30,
    "../../../etc/passwd",
    "irs/**/$*",
    "%s%n",
    "\u202e",
    "[" * 500,
    "{" * 500,
    "1e999",
)


def mutate(seed: bytes, rng: random.Random) -> bytes:
    """One to six changes to a valid message."""
    out = bytearray(seed)
    for _ in range(rng.randint(1, 6)):
        at = rng.randrange(len(out) + 1) if rng.random() < 0.5 else rng.randrange(min(len(out), 96) + 1)
        kind = rng.randrange(8)
        if kind == 0:
            out[at : at + 1] = bytes([rng.randrange(256)])
        elif kind == 1:
            out[at : at + 4] = struct.pack(rng.choice("<>") + "I", rng.choice(_LIES))
        elif kind == 2:
            del out[at:]
        elif kind == 3:
            del out[at : at + rng.randint(1, 16)]
        elif kind == 4:
            out[at:at] = out[at : at + rng.randint(1, 64)] * rng.randint(1, 8)
        elif kind == 5:
            out[at : at + 8] = struct.pack("<d", rng.choice((np.nan, np.inf, -np.inf, 1e308, 5e-324, -0.0)))
        elif kind == 6:
            out[at : at + 4] = struct.pack("<f", rng.choice((np.nan, np.inf, -np.inf, 3e38, 1e-45)))
        else:
            out[at:at] = rng.choice(_TEXTS).encode("utf-8", "surrogatepass")
    return bytes(out)


def one_input(target: Target, number: int) -> bytes:
    """The input of that number, always the same: a mutation of a seed, now and then noise, now and then a megabyte."""
    rng = random.Random(f"{target.name}:{number}")
    seed = target.seeds[number % len(target.seeds)]
    draw = rng.random()
    if draw < 0.03:
        return rng.randbytes(rng.randrange(200))
    if draw < 0.04:
        return mutate(seed, rng) + rng.choice((b"a", b"\xff", b" ", b"[", "ß".encode())) * 1_000_000
    return mutate(seed, rng)


# -------------------------------------------------------------------------------------------------------------- targets
def targets() -> tuple[Target, ...]:
    """All of them."""
    return (*_decoders(), _chain(), *_documents(), *_questions(), *_commands())


def _decoders() -> Iterator[Target]:
    sensed = sensor_messages()
    for kind in KINDS:
        yield Target(f"decode.{kind}", sensed[kind], lambda data, kind=kind: decode(kind, data))  # type: ignore[misc]
    yield Target("decode.detections_ids", sensed["detections_ids"], decode_detection_ids)
    yield Target("decode.detections_info", sensed["detections_info"], lambda data: DetectionPairer().push_info(data))
    yield Target("cdr.result_status", (b"\0\1\0\0\4",), cdr.decode_result_status)
    goals = (cdr.encode_goal_pose(b"0" * 16, STAMP_NS, "map", (1, 2, 3)), cdr.encode_cancel(b"1" * 16))
    for name in (
        cdr.SEND_GOAL_POSE,
        cdr.CANCEL_REQUEST,
        cdr.CANCEL_RESPONSE,
        cdr.SEND_GOAL_RESPONSE,
        cdr.NAVIGATE_FEEDBACK,
        cdr.PATH,
    ):
        yield Target(f"cdr.{name.rpartition('/')[2]}", goals, lambda data, name=name: cdr.read(data, name))  # type: ignore[misc]


@cache
def sensor_messages() -> Mapping[str, tuple[bytes, ...]]:
    """Valid messages of every kind."""
    rng = np.random.default_rng(1)
    points = rng.normal(0, 3, (40, 3)).astype(np.float32)
    timed = LidarScan(STAMP_NS, "lidar", points, np.linspace(0, 0.1, 40, dtype=np.float32))
    image = CameraImage(STAMP_NS, "camera", rng.integers(0, 255, (12, 16, 3)).astype(np.uint8))
    camera = CameraModel("camera", 16, 12, np.array([[9.0, 0, 8], [0, 9.0, 6], [0, 0, 1]]), "plumb_bob", np.zeros(5))
    pose = OdomSample(STAMP_NS, "odom", "base_link", np.zeros(3), UPRIGHT)
    mounts = [
        StaticTransform(a, b, make_pose(np.zeros(3), UPRIGHT)) for a, b in ("ab", "bc", "ca", ("base_link", "lidar"))
    ]
    ids = np.zeros((12, 16), np.uint16)
    ids[3:6, 4:9] = 7
    info = {
        "stamp_ns": STAMP_NS,
        "frame_id": "camera",
        "detections": [{"id": 7, "label": "tv", "score": 0.5, "labels": [["tv", 0.5]]}],
    }
    return {
        "lidar": (
            encode.encode_pointcloud2(timed),
            encode.encode_pointcloud2(LidarScan(STAMP_NS, "lidar", points, None)),
        ),
        "image": (encode.encode_image(image),),
        "image_compressed": (
            encode.encode_compressed_image(image),
            encode.encode_compressed_image(image, "png"),
            bomb(30000, 30000),
        ),
        "camera_info": (encode.encode_camera_info(camera, STAMP_NS),),
        "odometry": (encode.encode_odometry(pose),),
        "tf_static": (encode.encode_tf(mounts),),
        "detections_ids": (_png_message(ids), bomb(8000, 8000)),
        "detections_info": (json.dumps(info).encode(),),
    }


def _png_message(ids: np.ndarray) -> bytes:
    return _compressed(cv2.imencode(".png", ids)[1].tobytes())


def _compressed(file: bytes) -> bytes:
    data = np.frombuffer(file, np.uint8)
    return cdr.write(
        cdr.make(cdr.COMPRESSED_IMAGE, header=cdr.make_header(STAMP_NS, "camera"), format="png", data=data)
    )


def bomb(width: int, height: int) -> bytes:
    """A CompressedImage of a few kilobytes whose PNG claims, and would unpack to, width x height pixels of zeros."""

    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    head = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    rows = zlib.compress(b"\0" * min((width + 1) * height, 4_000_000), 9)
    return _compressed(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", rows) + chunk(b"IEND", b""))


def _chain() -> Target:
    """Three messages of any topics through decoder, watch and synchroniser, as the map thread does it."""
    topics = {
        "lidar": "/lidar/points", "odometry": "/odom", "tf_static": "/tf_static", "camera_info": "/camera/camera_info",
        "detections_ids": "/detections/ids", "detections_info": "/detections/info", "image_compressed": "/camera/image/compressed",
    }  # fmt: skip
    decoder = SensorDecoder(IngestSettings(images=True))

    def run(data: bytes) -> None:
        sync, watch = Synchronizer(SyncSettings(keep_images=True)), SensorWatch(WatchSettings())
        rng = random.Random(data)
        for step in range(3):
            kind = rng.choice(sorted(topics))
            seed = rng.choice(sensor_messages()[kind])
            payload = mutate(seed, rng) if step else seed
            values = decoder.decode(topics[kind], payload)
            watch.hear(topics[kind], kind, payload, step * 10**8, values)
            for value in values:
                sync.push(value)
            for frame in sync.pop():
                assert np.isfinite(frame.scan.points_map).all()
                assert np.isfinite(frame.map_T_base).all()
        sync.flush()
        watch.refresh(10**9)
        watch.findings(10**9)

    return Target("chain", (b"0123456789",), run)


def _documents() -> Iterator[Target]:
    """What comes back over the network to nav_bridge and irsctl, and what the world takes."""
    graph = house.GRAPH
    delta = GraphDelta(
        1, 2, "m", "map", graph.rooms, graph.doors, graph.instances[:3], ("I9",), ("R4 split into R4, R9",)
    )
    nodes = [
        codec.node_to_json(node, seq=1, frame="map") for node in (graph.building, graph.rooms[0], graph.instances[0])
    ]
    yield Target("codec.snapshot", (codec.snapshot_to_json(graph),), codec.snapshot_from_json)
    yield Target("codec.delta", (codec.delta_to_json(delta),), codec.delta_from_json)
    yield Target("codec.node", tuple(nodes), codec.node_from_json)
    array, attached = codec.array_to_bytes(np.zeros((4, 3), np.float32))
    yield Target("codec.array", (attached,), lambda data: codec.array_from_bytes(array, data))
    grid = codec.occupancy_to_png(np.zeros((20, 30), np.int8))
    yield Target("codec.occupancy", (grid,), codec.png_to_occupancy)
    order = json.dumps({"waypoints": [[0, 0, 0], [1, 1, 1]], "plan": "p", "seq": 1, "valid_s": 1.0}).encode()
    yield Target("sim.orders", (order,), _order)
    yield Target("messages", (b"a=1;b=2", b'{"error": "x"}'), lambda data: (parameters(_text(data)), error_text(data)))
    yield Target("keys", (b"0/lidar/points/sensor_msgs::msg::dds_::PointCloud2_/RIHS01_ab",), _key)


def _order(data: bytes) -> None:
    try:
        Orders().hear(data, 1.0)
    except ValueError as error:  # what the world logs and drops
        raise DecodeError(str(error)) from error


def _key(data: bytes) -> None:
    keys.parse_ros_key(_text(data), "bot")
    keys.parse_ros_attachment(data)
    keys.service_key_of(_text(data), "/s")
    keys.robot_of(_text(data))
    keys.check_robot_name(_text(data))


@dataclass(frozen=True)
class Asked:
    """As much of a Query as a request is made of."""

    payload: bytes
    parameters: Mapping[str, str]


def _questions() -> Iterator[Target]:
    names = AliasTable.load()
    goal = json.dumps(
        {"query": "the red chair next to the window in the office", "within_m": 0.4, "from": [0, 1], "priority": 3}
    )

    def asked(data: bytes) -> None:
        for query in (Asked(data, {}), Asked(b"", {"query": _text(data)})):
            request = request_of("goto", query)  # type: ignore[arg-type]
            goto = checked_goto(request.document)
            parse(goto.query, names)

    yield Target(
        "nav.goto", (goal.encode(), "去实验室的电视".encode(), '{"query": "к холодильнику на кухне"}'.encode()), asked
    )


def _commands() -> Iterator[Target]:
    """What operators' questions are made of, and files that come from elsewhere."""
    state = InstanceState(1, np.ones((5, 3), np.float32), None, (("chair", 0.9),), 0, 9, 0.9, 1, 2)
    builder = GraphBuilder(GraphSettings(), LabelEncoder.load(), "map", "m")
    builder.build(None, InstanceUpdate(5, (state,), (), ()), 9)
    numbers = count(2)
    teach = b'{"kind": "teach", "target": "I1", "name": "centrifuge"}'
    merge = b'{"kind": "merge", "target": "I1", "others": ["I2", "../x"]}'

    def edit(data: bytes) -> None:
        builder.edit(read_edit(read_question(data)), 7, lambda: next(numbers))
        builder.undo(8)

    plan = Plan(GridFrame((0.0, 0.0), 0.05, 12, 9), 0.0, *np.ones((2, 12, 9), np.bool_))
    yield Target("cmd.edit", (teach, merge), edit)
    place = b'{"at": [1.0, 2.0, 0.5], "begin": false}'
    yield Target("cmd.relocalise", (place,), lambda data: read_place(read_question(data)))
    yield Target("plan", (plan_to_bytes(plan),), plan_from_bytes)
    where = Localisation(5, "odom", np.eye(4), np.eye(4), "map")
    yield Target("localisation", (localisation_to_json(where, seq=1, frame="map"),), localisation_from_json)


def _text(data: bytes) -> str:
    return data.decode(errors="replace")


def refused(error: BaseException) -> bool:
    """Whether an error is a refusal, and not a finding."""
    return isinstance(error, IrsdError)
