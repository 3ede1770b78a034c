"""Score rooms against truth: 2D maps (empty, furnished) and LiDAR drives, by both methods, and print the tables of bars.

    python benchmarks/rooms.py [--data ../shared/data] [--sets maps drives] [--methods ours irs] [--json OUT]
    python benchmarks/rooms.py --drive FILE.npz --out rooms.json [--upto K] [--method ours]

A drive goes through the product's own path, one synchronised frame per scan: ``Localiser``, ``Mapper`` and then ``RoomStage``, nothing
is known of what comes later. Its rooms after 25 / 50 / 75 / 100 % of the scans are what stood in the stage at that scan.

Id changes are counted against the truth: the id that holds most of a true room's floor (of the rooms entered so far,
and at least a quarter of its floor) is its id, and every time that id becomes another one counts. The figure is
changes / true rooms per 100 scans, in per cent.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from irsd.core.types import DeskewedScan, Rooms, SyncedFrame
from irsd.mapping.localise import Localiser, LocaliseSettings
from irsd.mapping.mapper import Mapper, MappingSettings
from irsd.perception.structure_net import structure_model
from irsd.rooms.algorithm1 import box_map
from irsd.rooms.segment import FREE_FROM, segment_map
from irsd.rooms.stage import RoomSettings, RoomStage

HERE = Path(__file__).resolve().parent
RESOLUTION_M = 0.05
STRUCTURE = MappingSettings().network.model
PARTS = (0.25, 0.5, 0.75, 1.0)
Score = dict[str, Any]


def load_scorer(data: Path) -> ModuleType:
    """``evaluate_rooms.py``, which lives beside the data."""
    path = data.parent / "tools" / "evaluate_rooms.py"
    spec = importlib.util.spec_from_file_location("evaluate_rooms", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


# ------------------------------------------------------------------------------------------------ drives
def frames_of(drive: Path, upto: int | None = None) -> Iterator[SyncedFrame]:
    """The scans of a drive as the pipeline gets them: points in the map frame at the pose that the robot believes."""
    with np.load(drive) as data:
        ranges, azimuth, directions = data["ranges"], data["azimuth0"], data["directions"]
        poses, stamps, unit = data["poses"], data["stamps"], float(data["range_unit"])
        height_m = float(poses[0][2, 3])
    for k in range(len(ranges) if upto is None else min(upto, len(ranges))):
        cosine, sine = np.cos(azimuth[k]), np.sin(azimuth[k])
        turn = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])
        hit = ranges[k] > 0
        points = (directions[hit] @ turn.T) * (ranges[k][hit, None] * unit)
        world = points @ poses[k][:3, :3].T + poses[k][:3, 3]
        base = poses[k].copy()
        base[2, 3] -= height_m
        stamp_ns = round(float(stamps[k]) * 1e9)
        scan = DeskewedScan(stamp_ns, world.astype(np.float32), poses[k][:3, 3].copy())
        yield SyncedFrame(k, stamp_ns, base, scan, ())


class Identity:
    """Counts how often the id of a true room changes."""

    def __init__(self, scorer: ModuleType, drive: Path) -> None:
        gt, _, grid = scorer.read_drive(str(drive))
        with np.load(drive) as data:
            self._first = data["room_first_scan"]
        rows, columns = np.nonzero(gt)
        x, y = scorer.world_of_cells(grid)
        self._xy = np.stack([x[rows, columns], y[rows, columns]], axis=1)[::4]
        self._room = gt[rows, columns][::4]
        self._cells = np.bincount(self._room, minlength=len(self._first) + 1)[1:]
        self._ids: dict[int, int] = {}
        self.rooms, self.changes = len(self._first), 0

    def see(self, scan: int, rooms: Rooms) -> None:
        cells = rooms.frame.cells_of(self._xy)
        inside = rooms.frame.inside(cells)
        ids = np.zeros(len(cells), np.int64)
        ids[inside] = rooms.labels[cells[inside, 0], cells[inside, 1]]
        table = np.zeros((self.rooms + 1, int(ids.max(initial=0)) + 1), np.int64)
        np.add.at(table, (self._room, ids), 1)
        table[:, 0] = 0
        for room in np.flatnonzero(self._first <= scan).tolist():
            # A glimpse of a room through its door is often counted to the room where the robot stands.
            if 4 * table[room + 1].max() < self._cells[room]:
                continue
            now = int(table[room + 1].argmax())
            if self._ids.setdefault(room, now) != now:
                self.changes += 1
                self._ids[room] = now


def run_drive(
    drive: Path, settings: RoomSettings, scorer: ModuleType, upto: int | None = None, structure: str = STRUCTURE
) -> tuple[Rooms, Score]:
    """The rooms at the end, and scores: ``parts`` after each of ``PARTS``, id changes, ms per scan."""
    with np.load(drive) as data:
        total = len(data["ranges"])
    marks = {max(round(total * part), 1): part for part in PARTS}
    mapper = Mapper(MappingSettings(), structure_model(structure))
    stage, identity = RoomStage(settings), Identity(scorer, drive)
    localiser = Localiser(LocaliseSettings())
    parts, mapping_ms, rooms_ms, rooms, lineage = {}, [], [], None, []
    for sensed in frames_of(drive, upto):
        start = time.process_time()
        frame, _ = localiser.place(sensed, mapper.voxels)
        update = mapper.integrate(frame)
        middle = time.process_time()
        if rooms is None or update.changed_xy_m is not None:
            x, y = frame.map_T_base[:2, 3].tolist()
            rooms = stage.follow(mapper, (x, y))
            lineage += rooms.lineage
        end = time.process_time()
        mapping_ms.append(1e3 * (middle - start))
        rooms_ms.append(1e3 * (end - middle))
        identity.see(frame.seq, rooms)
        if (part := marks.get(frame.seq + 1)) is not None:
            parts[part] = score_drive(drive, rooms, scorer, frame.seq + 1)
    if rooms is None:
        raise SystemExit(f"{drive} holds no scans")
    each_ms = np.array(mapping_ms) + np.array(rooms_ms)
    return (
        rooms,
        {
            "parts": parts,
            "id_changes": identity.changes,
            "id_changes_percent": 100.0 * identity.changes / identity.rooms / (len(each_ms) / 100),
            "lineage": lineage,
            "mapping_ms": float(np.mean(mapping_ms)),
            "rooms_ms": float(np.mean(rooms_ms)),
            "mean_ms": float(each_ms[1:].mean()) if len(each_ms) > 1 else float(each_ms.mean()),
            "first_ms": float(each_ms[0]),  # loads compiled kernels
            "worst_ms": float(each_ms[1:].max(initial=0.0)),
        },
    )


def footprints_of(rooms: Rooms, method: str = "ours") -> list[dict[str, Any]]:
    """The rooms as ``evaluate_rooms.py`` reads them: the published method keeps a box per room, ours a polygon."""
    if method == "irs":
        return [{"id": i, "aabb": list(f.aabb_xy)} for i, f in zip(rooms.ids, rooms.footprints, strict=True)]
    return [
        {"id": i, "polygon": f.polygon_xy.tolist(), "aabb": list(f.aabb_xy)}
        for i, f in zip(rooms.ids, rooms.footprints, strict=True)
    ]


def score_drive(drive: Path, rooms: Rooms, scorer: ModuleType, upto: int | None) -> Score:
    gt, valid, grid = scorer.read_drive(str(drive), upto)
    return dict(scorer.evaluate(scorer.rasterise(footprints_of(rooms), grid), gt, valid=valid))


# ------------------------------------------------------------------------------------------------ maps
def run_maps(folder: Path, settings: RoomSettings, scorer: ModuleType) -> dict[str, Score]:
    """Scores by map name, with CPU seconds per map."""
    scores = {}
    for path in sorted(folder.glob("*.png")):
        if path.stem.endswith("_gt_segmentation"):
            continue
        image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        assert image is not None
        start = time.process_time()
        labels = labels_of_map(np.asarray(image, np.uint8), settings)
        seconds = time.process_time() - start
        truth = scorer.read_gt(scorer.gt_of(path.stem, str(folder)))
        scores[path.stem] = {**scorer.evaluate(labels, truth), "seconds": seconds}
    return scores


def labels_of_map(image: NDArray[np.uint8], settings: RoomSettings) -> NDArray[np.int32]:
    if settings.method == "irs":
        return box_map(image >= FREE_FROM, RESOLUTION_M, settings).labels
    return segment_map(image, RESOLUTION_M, settings.segment).labels


# ------------------------------------------------------------------------------------------------ tables
HEAD = (
    "| set | method | precision | recall | mIoU | sym | PQ | count (mean / abs) | over | under | other |\n"
    "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |"
)


def row(name: str, method: str, scores: list[Score], scorer: ModuleType, other: str) -> str:
    mean = scorer.mean_rows(scores)
    return (
        f"| {name} | {method} | {100 * mean['precision']:.1f} | {100 * mean['recall']:.1f} | {mean['miou']:.3f} "
        f"| {mean['miou_sym']:.3f} | {mean['pq']:.3f} | {mean['count_error']:+.1f} / {mean['count_abs_error']:.1f} "
        f"| {mean['over']:.1f} | {mean['under']:.1f} | {other} |"
    )


def maps_rows(method: str, scores: dict[str, Score], scorer: ModuleType) -> list[str]:
    rows = []
    for name, furnished in (("2D empty", False), ("2D furnished", True)):
        chosen = [s for n, s in scores.items() if n.endswith("_furnitures") == furnished]
        if chosen:
            seconds = [s["seconds"] for s in chosen]
            rows.append(
                row(name, method, chosen, scorer, f"{np.median(seconds):.2f} s, worst {max(seconds):.2f} s per map")
            )
    return rows


def drive_rows(method: str, results: dict[str, Score], scorer: ModuleType) -> list[str]:
    rows = []
    for part in PARTS:
        scores = [r["parts"][part] for r in results.values() if part in r["parts"]]
        if scores:
            each = " ".join(f"{s['miou_sym']:.2f}" for s in scores)
            rows.append(row(f"drives {part:.0%}", method, scores, scorer, f"sym {each}"))
    return rows


def cost_rows(method: str, results: dict[str, Score]) -> list[str]:
    return [
        f"| {name} | {method} | {r['id_changes']} | {r['id_changes_percent']:.2f} % | {r['mapping_ms']:.1f} "
        f"| {r['rooms_ms']:.1f} | {r['mean_ms']:.1f} | {r['worst_ms']:.1f} | {r['first_ms']:.0f} |"
        for name, r in results.items()
    ]


COST_HEAD = (
    "| drive | method | id changes | per room and 100 scans | mapping ms | rooms ms | mean ms | worst ms | first ms |\n"
    "| --- | --- | --- | --- | --- | --- | --- | --- | --- |"
)


def tables(data: Path, sets: list[str], methods: list[str], verbose: bool) -> dict[str, Any]:
    scorer, lines, costs, document = load_scorer(data), [], [], {}
    for method in methods:
        settings = settings_of(method)
        if "maps" in sets:
            scores = run_maps(data / "room_maps", settings, scorer)
            document[f"maps {method}"] = scores
            lines += maps_rows(method, scores, scorer)
            if verbose:
                print(*(scorer.line(n, s) for n, s in scores.items()), sep="\n", flush=True)
        if "drives" in sets:
            results = {
                path.stem: run_drive(path, settings, scorer)[1] for path in sorted((data / "room_scans").glob("*.npz"))
            }
            document[f"drives {method}"] = results
            lines += drive_rows(method, results, scorer)
            costs += cost_rows(method, results)
            if verbose:
                for name, result in results.items():
                    for part, score in result["parts"].items():
                        print(scorer.line(f"{name} {part:.0%}", score))
                    print(name, "lineage:", *result["lineage"], sep="\n  ", flush=True)
    print(HEAD, *lines, sep="\n")
    if costs:
        print("", COST_HEAD, *costs, sep="\n")
    return document


def settings_of(method: str) -> RoomSettings:
    return RoomSettings(method=method)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=HERE.parents[1] / "shared" / "data")
    parser.add_argument("--sets", nargs="+", default=["maps", "drives"], choices=["maps", "drives"])
    parser.add_argument("--methods", nargs="+", default=["ours", "irs"], choices=["ours", "irs"])
    parser.add_argument("--json", type=Path, help="write every figure here")
    parser.add_argument("--verbose", action="store_true", help="a line per map and drive, and the lineage")
    parser.add_argument("--drive", type=Path, help="one drive only: write its rooms to --out")
    parser.add_argument("--out", type=Path, help="rooms.json of --drive")
    parser.add_argument("--upto", type=int, help="stop --drive after this many scans")
    parser.add_argument("--structure", default=STRUCTURE, help="of --drive: nano, a path, or empty: geometry alone")
    parser.add_argument("--method", default="ours", choices=["ours", "irs"], help="of --drive")
    arguments = parser.parse_args()
    cv2.setNumThreads(1)  # the bars are for one core
    if not arguments.data.is_dir():
        print(f"the data is absent: {arguments.data}", file=sys.stderr)
        return 2
    if arguments.drive is not None:
        if arguments.out is None:
            parser.error("--drive needs --out")
        settings, scorer = settings_of(arguments.method), load_scorer(arguments.data)
        rooms, result = run_drive(arguments.drive, settings, scorer, arguments.upto, arguments.structure)
        arguments.out.write_text(json.dumps(footprints_of(rooms, arguments.method), indent=1) + "\n")
        score = score_drive(arguments.drive, rooms, scorer, arguments.upto)
        print(scorer.line(arguments.drive.stem, score))
        print(COST_HEAD, *cost_rows(arguments.method, {arguments.drive.stem: result}), sep="\n")
        return 0
    document = tables(arguments.data, arguments.sets, arguments.methods, arguments.verbose)
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(document, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
