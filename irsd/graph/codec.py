"""The wire and file forms of the graph: JSON documents, raw arrays and map pictures. Same value in, same bytes out.

Every document starts with ``schema`` (``irs/<name>/<version>``), ``seq`` and ``frame``; the rest are the fields of the type in
``graph.model``, under their own names and in their own order. JSON Schemas: docs/schema.
"""

from __future__ import annotations

import dataclasses
import functools
import json
import math
import re
import sys
import types
import typing
from collections.abc import Mapping
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from irsd.core.errors import DecodeError
from irsd.core.png import png_size
from irsd.graph.model import (
    SCHEMA_VERSION,
    BuildingNode,
    DoorEdge,
    Edit,
    GraphDelta,
    GraphSnapshot,
    InstanceNode,
    Place,
    RoomNode,
)

Node = BuildingNode | RoomNode | DoorEdge | InstanceNode
T = TypeVar("T")

_NAMES: Mapping[type[Any], str] = types.MappingProxyType(
    {
        GraphSnapshot: "graph/snapshot",
        GraphDelta: "graph/delta",
        BuildingNode: "graph/building",
        RoomNode: "graph/room",
        DoorEdge: "graph/door",
        InstanceNode: "graph/instance",
        Edit: "edit",
    }
)
_NODE_OF_LETTER: Mapping[str, type[Any]] = types.MappingProxyType(
    {"B": BuildingNode, "R": RoomNode, "D": DoorEdge, "I": InstanceNode}
)

_HINTS: Mapping[type[Any], dict[str, Any]] = types.MappingProxyType(
    {kind: typing.get_type_hints(kind) for kind in (*_NAMES, Place)}
)
_DTYPES = frozenset(f"{kind}{bits}" for kind in ("int", "uint") for bits in (8, 16, 32, 64))
_DTYPES |= {"float16", "float32", "float64", "bool"}


def schema_name(kind: type[Any]) -> str:
    """``irs/graph/delta/1`` for GraphDelta, and so on."""
    return f"irs/{_NAMES[kind]}/{SCHEMA_VERSION}"


# ---------------------------------------------------------------------------------------------------- documents
def snapshot_to_json(snapshot: GraphSnapshot) -> bytes:
    """The whole graph; also the content of graph.json."""
    return _dump(_headed(snapshot, snapshot.seq, snapshot.frame))


def snapshot_from_json(payload: bytes | str) -> GraphSnapshot:
    """Inverse of ``snapshot_to_json``. DecodeError names the field that is wrong."""
    return _from_headed(GraphSnapshot, _load(payload))


def delta_to_json(delta: GraphDelta) -> bytes:
    """One step of the graph."""
    return _dump(_headed(delta, delta.seq, delta.frame))


def delta_from_json(payload: bytes | str) -> GraphDelta:
    """Inverse of ``delta_to_json``. DecodeError names the field that is wrong."""
    return _from_headed(GraphDelta, _load(payload))


def node_to_json(node: Node, *, seq: int, frame: str) -> bytes:
    """One node as its own resource; seq: the revision of the graph in which it last changed."""
    return _dump(_headed(node, seq, frame))


def node_from_json(payload: bytes | str) -> Node:
    """Inverse of ``node_to_json``: the kind is told by the first letter of the id."""
    document = _load(payload)
    kind = _NODE_OF_LETTER.get(str(document.get("id", ""))[:1])
    if kind is None:
        raise DecodeError(f"id = {document.get('id')!r}: a node's id starts with B, R, D or I")
    node: Node = _from_headed(kind, document)
    return node


def edit_to_json(edit: Edit, *, seq: int, frame: str) -> bytes:
    """One line of the journal; seq: the revision of the graph that holds its effect, or its undoing."""
    return _dump(_headed(edit, seq, frame))


def edit_from_json(payload: bytes | str) -> Edit:
    """Inverse of ``edit_to_json``. DecodeError names the field that is wrong."""
    return _from_headed(Edit, _load(payload))


def rooms_document(snapshot: GraphSnapshot) -> list[dict[str, Any]]:
    """The content of rooms.json: one entry per room."""
    return [
        {
            "id": room.id,
            "label": room.label,
            "polygon": [list(map(_rounded, xy)) for xy in room.polygon_xy],
            "aabb": list(map(_rounded, room.aabb_xy)),
            "floor_z": _rounded(room.floor_z_m),
            "ceiling_z": None if room.ceiling_z_m is None else _rounded(room.ceiling_z_m),
            "floor": room.floor,
        }
        for room in snapshot.rooms
    ]


def as_published(node: T) -> T:
    """The value as its document says it: floats rounded. Two values with equal ``as_published`` have equal documents."""
    made: T = _build(type(node), _fields(node), type(node).__name__)
    return made


def _headed(value: Any, seq: int, frame: str) -> dict[str, Any]:
    return {"schema": schema_name(type(value)), "seq": seq, "frame": frame, **_fields(value)}


def _from_headed(kind: type[T], document: dict[str, Any]) -> T:
    schema = document.pop("schema", None)
    if schema != schema_name(kind):
        raise DecodeError(f"schema = {schema!r}: expected {schema_name(kind)!r}")
    if kind not in (GraphSnapshot, GraphDelta):
        document.pop("seq", None)
        document.pop("frame", None)
    return _build(kind, document, _NAMES[kind])


def _dump(document: Any) -> bytes:
    return json.dumps(document, ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode()


def _load(payload: bytes | str) -> dict[str, Any]:
    try:
        document = json.loads(payload)
    except (ValueError, RecursionError) as error:
        raise DecodeError(f"not JSON: {error}") from error
    if not isinstance(document, dict):
        raise DecodeError("expected a JSON object")
    return document


# ---------------------------------------------------------------------------------------------------- values
def _rounded(value: float, digits: int = 4) -> float:
    """0.1 mm; adding zero turns -0.0 into 0.0, which JSON would tell apart. Raises ValueError for NaN and infinity."""
    if not math.isfinite(value):
        raise ValueError(f"{value} has no place in a document")
    return round(float(value), digits) + 0.0


def _plain(value: Any, digits: int) -> Any:
    if isinstance(value, float):
        return _rounded(value, digits)
    if isinstance(value, tuple):
        return [_plain(item, digits) for item in value]
    if dataclasses.is_dataclass(value):
        return _fields(value)
    return value


def _fields(value: Any) -> dict[str, Any]:
    """A dataclass as a mapping in field order. Volumes keep a cubic centimetre, everything else 1e-4."""
    names = _HINTS[type(value)]
    return {name: _plain(getattr(value, name), 6 if name.endswith("_m3") else 4) for name in names}


def _build(kind: type[T], document: Any, path: str) -> T:
    hints = _HINTS[kind]
    if not isinstance(document, dict):
        raise DecodeError(f"{path}: expected an object, got {type(document).__name__}")
    # A field with a default may be missing: it is younger than the document.
    missing, extra = (
        hints.keys() - document.keys() - _defaults(typing.cast(typing.Hashable, kind)),
        document.keys() - hints.keys(),
    )
    if missing or extra:
        raise DecodeError(f"{path}: missing {sorted(missing)}, unknown {sorted(extra)}")
    return kind(**{name: _value(hints[name], document[name], f"{path}.{name}") for name in hints if name in document})


@functools.cache
def _defaults(kind: Any) -> frozenset[str]:
    return frozenset(field.name for field in dataclasses.fields(kind) if field.default is not dataclasses.MISSING)


def _value(wanted: Any, value: Any, path: str) -> Any:
    """The JSON value as the declared type. Whole numbers pass as floats."""
    kind, arguments = _shape(wanted)
    if kind == "dataclass":
        return _build(typing.cast(type[Any], wanted), value, path)
    if kind == "optional":
        return None if value is None else _value(arguments[0], value, path)
    if kind == "tuple":
        return _tuple(arguments, value, path)
    if wanted is float and isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value):
        return float(value)
    if type(value) is not wanted or wanted is float:
        raise DecodeError(f"{path} = {value!r}: expected {wanted.__name__}")
    return value


def _tuple(wanted: tuple[Any, ...], value: Any, path: str) -> tuple[Any, ...]:
    """A JSON list as a tuple of these types; (X, ...) is one of any length."""
    if not isinstance(value, list):
        raise DecodeError(f"{path}: expected a list, got {type(value).__name__}")
    if len(wanted) == 2 and wanted[1] is ...:
        wanted = (wanted[0],) * len(value)
    if len(value) != len(wanted):
        raise DecodeError(f"{path}: expected {len(wanted)} items, got {len(value)}")
    # Numbers are most of a map, and paths are for errors only. A sum that is finite has no term that is not.
    if all(w is float and type(v) is float for w, v in zip(wanted, value, strict=True)) and math.isfinite(sum(value)):
        return tuple(value)
    return tuple(_value(w, v, f"{path}[{k}]") for k, (w, v) in enumerate(zip(wanted, value, strict=True)))


@functools.cache
def _shape(wanted: Any) -> tuple[str, tuple[Any, ...]]:
    """What kind of type a declared one is, and its parts."""
    origin, arguments = typing.get_origin(wanted), typing.get_args(wanted)
    if dataclasses.is_dataclass(wanted):
        return "dataclass", ()
    if origin is types.UnionType:  # X | None is the only union in the model
        return "optional", arguments
    return ("tuple" if origin is tuple else "plain"), arguments


# ---------------------------------------------------------------------------------------------------- arrays
def array_to_bytes(array: NDArray[Any]) -> tuple[bytes, bytes]:
    """(raw little-endian bytes in C order, attachment): the attachment is JSON {"dtype": "float32", "shape": [n, 3]}."""
    if array.dtype.kind not in "fiub":
        raise ValueError(f"arrays of {array.dtype} have no wire form")
    little = np.ascontiguousarray(array).astype(array.dtype.newbyteorder("<"), copy=False)
    return little.tobytes(), _dump({"dtype": array.dtype.name, "shape": list(array.shape)})


def array_from_bytes(payload: bytes, attachment: bytes | str) -> NDArray[Any]:
    """Inverse of ``array_to_bytes``, in this machine's byte order. DecodeError when the two don't agree."""
    header = _load(attachment)
    name, shape = header.get("dtype"), header.get("shape")
    if not isinstance(name, str) or name not in _DTYPES:
        raise DecodeError(f"dtype = {name!r}: expected one of {', '.join(sorted(_DTYPES))}")
    if not isinstance(shape, list) or not all(type(n) is int and 0 <= n < 2**31 for n in shape):
        raise DecodeError(f"shape = {shape!r}: expected a list of whole numbers")
    dtype = np.dtype(name).newbyteorder("<")
    if math.prod(shape) * dtype.itemsize != len(payload):
        raise DecodeError(f"{name} {shape} needs {math.prod(shape) * dtype.itemsize} bytes, got {len(payload)}")
    array = np.frombuffer(payload, dtype).reshape(shape)
    return array.astype(dtype.newbyteorder("="), copy=sys.byteorder != "little")


# ---------------------------------------------------------------------------------------------------- map picture
_FREE, _OCCUPIED, _UNKNOWN = 254, 0, 205  # as map_server writes them
_MAX_CELLS = 64 * 2**20  # 400 x 400 m in cells of 5 cm
_PGM = re.compile(rb"P5\s(?:#[^\n]*\n|\s)*(\d{1,6})\s+(\d{1,6})\s")


def occupancy_to_png(cells: NDArray[np.int8]) -> bytes:
    """Grey PNG of cells int8 [H, W] (-1 unknown, 0..49 free, 50..100 occupied); its top row is the row of largest y."""
    import cv2  # noqa: PLC0415  0.1 s that a reader of JSON alone shall not pay

    grid = np.asarray(cells)
    if grid.ndim != 2 or not grid.size:
        raise ValueError(f"expected cells [H, W] with H, W > 0, got {grid.shape}")
    grey = np.where(grid < 0, _UNKNOWN, np.where(grid >= 50, _OCCUPIED, _FREE)).astype(np.uint8)
    done, png = cv2.imencode(".png", np.ascontiguousarray(grey[::-1]))
    if not done:
        raise ValueError(f"no PNG of {grid.shape} cells can be made")
    return bytes(png)


def png_to_occupancy(payload: bytes) -> NDArray[np.int8]:
    """Cells int8 [H, W] of a map_server picture: -1 unknown, 0 free, 100 occupied (thresholds 0.196 and 0.65 as usual).

    A PNG, or a binary PGM as map_saver writes it. Raises DecodeError for anything else, and for what is larger than a map can be.
    """
    import cv2  # noqa: PLC0415  as above

    pgm = _PGM.match(payload[:512])
    if pgm is None:
        png_size(payload, _MAX_CELLS)
    elif int(pgm[1]) * int(pgm[2]) > min(len(payload), _MAX_CELLS):
        raise DecodeError(f"map picture: {len(payload)} bytes claim {int(pgm[1])} x {int(pgm[2])} cells")
    try:
        grey = cv2.imdecode(np.frombuffer(payload, np.uint8), cv2.IMREAD_GRAYSCALE)
    except cv2.error as error:
        raise DecodeError(f"map picture: {error}") from error
    if grey is None:
        raise DecodeError("map picture: not an image")
    occupied = (255 - grey[::-1].astype(np.float32)) / 255
    return np.where(occupied > 0.65, 100, np.where(occupied < 0.196, 0, -1)).astype(np.int8)
