"""What operators change in the graph by hand: frozen edits, and what follows from a journal of them. Pure functions.

An edit never changes what perception remembers; it changes what is told of it. So it outranks perception for as long as it stands, and
undoing it gives back exactly what perception knows by then. Edits apply in the order of their numbers.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from irsd.core.errors import EditError
from irsd.core.types import InstanceState, Prototype
from irsd.graph.model import Edit, InstanceArrays, InstanceNode, Place, RoomNode

KINDS = ("teach", "rename", "forget", "merge", "split", "delete")
MAX_EDITS = 10_000
MAX_NAME = 80
_THING_OVERLAP = 0.5  # of the two boxes' union that must be shared to be the same thing
_NAMED_OVERLAP = 0.2  # the same where perception also calls both the same
_ROOM_OVERLAP = 0.5
_CELL_M = 0.1  # of the raster on which rooms are compared


@dataclass(frozen=True, slots=True)
class Request:
    """What an operator asks for. target, others: ids of nodes. A forget without target forgets a name wherever it was taught."""

    kind: str
    target: str = ""
    name: str = ""
    others: tuple[str, ...] = ()


Beneath = tuple[InstanceNode, InstanceArrays]
"""What perception says of a thing that is told otherwise."""


@dataclass(frozen=True, slots=True)
class Record:
    """What a step leaves on disk beside its delta. edits, prototypes (by number of their edit): new or changed.

    beneath: by id, what perception says where that is not what is told; None: the two are the same again. next_ids: the first
    free number by letter (I, R), so that numbers are not used twice after a restart.
    """

    edits: tuple[Edit, ...] = ()
    prototypes: Mapping[int, Prototype] = field(default_factory=dict)
    beneath: Mapping[str, Beneath | None] = field(default_factory=dict)
    next_ids: Mapping[str, int] = field(default_factory=dict)


# ---------------------------------------------------------------------------------------------------------- asking
def checked(request: Request) -> Request:
    """The request with its name trimmed. EditError when it can't mean anything, whatever the graph holds."""
    if request.kind not in KINDS:
        raise EditError(f"{request.kind!r}: an edit is one of {', '.join(KINDS)}")
    letters = "IR" if request.kind in ("teach", "rename", "forget") else "I"
    by_name = request.kind == "forget" and not request.target
    for node_id in (*(() if by_name else (request.target,)), *request.others):
        if node_id[:1] not in tuple(letters) or not node_id[1:].isascii() or not node_id[1:].isdigit():
            raise EditError(
                f"{node_id[:20]!r}: {request.kind} takes {'I7 or R3' if 'R' in letters else 'ids such as I7'}"
            )
    name = " ".join(request.name.split())
    if bool(name) != (request.kind in ("teach", "rename") or by_name):
        raise EditError(f"{request.kind}: {'takes no name' if name else 'a name is missing'}")
    if len(name) > MAX_NAME or not name.isprintable():
        raise EditError(f"a name has at most {MAX_NAME} characters, all printable")
    if (request.kind == "merge") != bool(request.others) or request.target in request.others:
        raise EditError("merge takes two or more different things, the first of which keeps its id; others take one")
    if len(set(request.others)) != len(request.others) or len(request.others) > 100:
        raise EditError("merge takes each thing once, and at most 100 of them")
    return replace(request, name=name)


def in_words(edit: Edit) -> str:
    """``edit 3: I7 is called centrifuge``: a line of the lineage and of ``irsctl edits``."""
    what = {
        "teach": f"{edit.target} is called {edit.name}",
        "rename": f"{edit.target} is called {edit.name}",
        "forget": f"{edit.target or edit.name} is no longer taught",
        "merge": f"{', '.join(edit.others)} merged into {edit.target}",
        "split": f"{edit.target} split into {edit.target}, {', '.join(edit.others)}",
        "delete": f"{edit.target} deleted",
    }
    return f"edit {edit.number}: {what[edit.kind]}"


def standing(edits: Iterable[Edit]) -> list[Edit]:
    """The edits that count, in order."""
    return sorted((e for e in edits if not e.undone), key=lambda e: e.number)


# ---------------------------------------------------------------------------------------------------------- names
def naming(edits: Iterable[Edit]) -> dict[str, Edit]:
    """By id of a node, the edit that names it: the last one's word."""
    out: dict[str, Edit] = {}
    for edit in standing(edits):
        if edit.kind in ("teach", "rename"):
            out[edit.target] = edit
        elif edit.kind == "forget":
            for node_id in [i for i, e in out.items() if i == edit.target or (not edit.target and e.name == edit.name)]:
                del out[node_id]
    return out


def known_prototypes(edits: Sequence[Edit], taught: Mapping[int, Prototype]) -> dict[int, Prototype]:
    """The prototypes that count. Both by number of their edit; those whose edit is in no journal any more are of earlier maps."""
    journalled = {edit.number for edit in edits}
    alive = {edit.number for edit in naming(edits).values()}
    forgotten = {e.name: e.number for e in standing(edits) if e.kind == "forget" and not e.target}
    return {
        n: taught[n]
        for n in sorted(taught)
        if (n in alive or n not in journalled) and forgotten.get(taught[n].name, 0) < n
    }


def prototype_of(name: str, state: InstanceState, floor_z_m: float, most: int = 512) -> Prototype:
    """What a thing looks like, as an example of its name: at most ``most`` of its points, evenly taken."""
    points = state.points_map[:: -(-len(state.points_map) // most)].astype(np.float64)
    origin = np.append(points[:, :2].mean(0), floor_z_m)
    return Prototype(name, (points - origin).astype(np.float32), state.embedding)


# ---------------------------------------------------------------------------------------------------------- shapes
def things_of(edit: Edit) -> tuple[str, ...]:
    """Ids of the things that an edit speaks of, the part that a split makes included."""
    return tuple(i for i in (edit.target, *edit.others) if i[:1] == "I")


def shaped(edits: Iterable[Edit], states: Mapping[int, InstanceState]) -> dict[int, InstanceState]:
    """What becomes of things by merges, splits and deletes, all by number; what is not changed stays the same object."""
    out = dict(states)
    for edit in standing(edits):
        target = int(edit.target[1:]) if edit.target[:1] == "I" else 0
        if edit.kind == "delete":
            out.pop(target, None)
        elif edit.kind == "merge":
            parts = [out.pop(number) for number in (target, *(int(i[1:]) for i in edit.others)) if number in out]
            if parts:
                out[target] = merged(target, parts)
        elif edit.kind == "split" and edit.plane is not None and target in out:
            rest, part = cut(out[target], edit.plane, int(edit.others[0][1:]))
            out.pop(target)
            out.update({state.id: state for state in (rest, part) if len(state.points_map)})
    return out


def merged(number: int, parts: Sequence[InstanceState]) -> InstanceState:
    """Several things as one: all points, means weighted by observations, the first one's room."""
    if len(parts) == 1:
        return parts[0] if parts[0].id == number else replace(parts[0], id=number)
    weight = np.array([max(p.observations, 1) for p in parts], np.float64)
    weight /= weight.sum()
    scores: dict[str, float] = {}
    for part, share in zip(parts, weight, strict=True):
        for name, score in part.labels:
            scores[name] = scores.get(name, 0.0) + share * score
    vectors = [p.embedding for p in parts]
    whole: NDArray[np.float32] | None = vectors[0]
    if all(v is not None and whole is not None and len(v) == len(whole) for v in vectors):
        mean = sum(w * v for w, v in zip(weight, vectors, strict=True) if v is not None)
        whole = np.asarray(mean / max(float(np.linalg.norm(mean)), 1e-9), np.float32)
    return InstanceState(
        id=number,
        points_map=np.concatenate([p.points_map for p in parts]),
        embedding=whole,
        labels=tuple(sorted(scores.items(), key=lambda pair: -pair[1])),
        room=parts[0].room,
        observations=sum(p.observations for p in parts),
        existence=max(p.existence for p in parts),
        first_seen_ns=min(p.first_seen_ns for p in parts),
        last_seen_ns=max(p.last_seen_ns for p in parts),
        state="present" if any(p.state == "present" for p in parts) else parts[0].state,
        score_kind=parts[0].score_kind,
    )


def cut(
    state: InstanceState, plane: tuple[float, float, float, float], new: int
) -> tuple[InstanceState, InstanceState]:
    """A thing as two: (what lies before the plane, what lies beyond it under the new number)."""
    beyond = state.points_map.astype(np.float64) @ np.array(plane[:3]) >= plane[3]
    points = state.points_map
    # Which room each half is in is found from its place.
    return replace(state, points_map=points[~beyond]), replace(state, id=new, points_map=points[beyond], room=0)


def splitting_plane(points_map: NDArray[np.float32]) -> tuple[float, float, float, float]:
    """The plane between two things that were taken for one: through the widest gap of points [N, 3], else the middle.

    Looks along the three axes and the main directions in plan; a gap counts by its width, the more the nearer it is to the
    middle. Beyond the plane lies the smaller part. EditError with fewer than two different points.
    """
    points = points_map.astype(np.float64)
    centred = points[:, :2] - points[:, :2].mean(0)
    _, axes = np.linalg.eigh(centred.T @ centred + 1e-9 * np.eye(2))
    flat = [np.append(axis, 0.0) for axis in axes.T]
    best = 0.0
    plane: tuple[float, float, float, float] | None = None
    for normal in (*flat[::-1], *np.eye(3)):
        along = np.sort(points @ normal)
        gaps, middle = np.diff(along), (along[1:] + along[:-1]) / 2
        if not len(gaps) or along[-1] - along[0] < 1e-6:
            continue
        share = np.arange(1, len(along)) / len(along)
        value = gaps * np.minimum(share, 1 - share) + 1e-6 * np.minimum(share, 1 - share)
        k = int(value.argmax())
        if value[k] > best:
            best, plane = float(value[k]), (float(normal[0]), float(normal[1]), float(normal[2]), float(middle[k]))
    if plane is None:
        raise EditError("it has too few points to be split")
    nx, ny, nz, d = plane
    beyond = int((points @ np.array([nx, ny, nz]) >= d).sum())
    return (nx, ny, nz, d) if 2 * beyond <= len(points) else (-nx, -ny, -nz, -d)  # the larger part keeps its id


# ---------------------------------------------------------------------------------------------------------- places
def place_of(node: InstanceNode | RoomNode, label: str) -> Place:
    """Where a node is; label: what perception calls it."""
    if isinstance(node, InstanceNode):
        return Place(node.aabb_min_m, node.aabb_max_m, label)
    x0, y0, x1, y1 = node.aabb_xy
    top = node.floor_z_m if node.ceiling_z_m is None else node.ceiling_z_m
    return Place((x0, y0, node.floor_z_m), (x1, y1, top), label, node.polygon_xy)


def same_thing(place: Place, node: InstanceNode, label: str) -> float:
    """Share of the union of two boxes that is common, 0 where that is too little to be the same thing.

    label: what perception calls the node.
    """
    low, high = np.maximum(place.low_m, node.aabb_min_m), np.minimum(place.high_m, node.aabb_max_m)
    sizes = [np.subtract(place.high_m, place.low_m), np.subtract(node.aabb_max_m, node.aabb_min_m), high - low]
    if (sizes[2] < 0).any():
        return 0.0
    one, two, both = (float(np.prod(np.maximum(size, 0.02))) for size in sizes)  # a picture on the wall is not nothing
    share = both / (one + two - both)
    return share if share >= (_NAMED_OVERLAP if label == place.label else _THING_OVERLAP) else 0.0


def same_room(place: Place, room: RoomNode) -> float:
    """Share of the union of two floors that is common, 0 where that is too little, or on another storey."""
    if abs(place.low_m[2] - room.floor_z_m) > 1.0 or min(len(place.polygon_xy), len(room.polygon_xy)) < 3:
        return 0.0
    corners = [np.array(p, np.float64) for p in (place.polygon_xy, room.polygon_xy)]
    low = np.concatenate(corners).min(0)
    width, height = np.ceil((np.concatenate(corners).max(0) - low) / _CELL_M).astype(int) + 2
    if width * height > 25_000_000:
        return 0.0
    masks = [np.zeros((int(height), int(width)), np.uint8) for _ in corners]
    for mask, polygon in zip(masks, corners, strict=True):
        cv2.fillPoly(mask, [np.rint((polygon - low) / _CELL_M).astype(np.int32)], 1)
    share = float((masks[0] & masks[1]).sum()) / max(float((masks[0] | masks[1]).sum()), 1.0)
    return share if share >= _ROOM_OVERLAP else 0.0


def renumbered(edit: Edit, old: str, new: str) -> Edit:
    """The edit with another id for a node."""
    others = tuple(new if i == old else i for i in edit.others)
    return replace(edit, target=new if edit.target == old else edit.target, others=others)
