"""Drive the product's instance memory on a scene of lifted masks and print cost and quality.

    python benchmarks/fusion.py SCENE.npz [--out PRED.npz] [--method ours|irs] [--rooms off|prior|serial|parallel]
        [--instances N [--memory]] [--collect-every K] [--set KEY=VALUE ...] [--tools DIR] [--json]

SCENE.npz is a file of ``make_masks.py``: masks that are points already, so lifting plays no part. Frame by frame the masks go
through ``InstanceMemory.observe``; every K frames changes are collected, as the pipeline does between graph deltas.

CPU is process time. Streaming = observe and collect of all frames, final = the last collect and the reading of all states.
``--rooms`` off: one memory; prior: the product, one memory in which masks meet instances of their own room alone; serial, parallel:
the paper's arrangement, see ``rooms_apart.py``, timed by the wall clock too.
``--instances N`` gives the growth curve instead: the scene is laid out again and again, shifted, until the memory holds N
instances; the time is that of the masks of the last copy (of the first rooms, where N is less than one scene holds).
"""

from __future__ import annotations

import argparse
import dataclasses
import importlib.util
import json
import resource
import sys
import time
import tracemalloc
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rooms_apart import RoomsApart

from irsd.core.grid import GridFrame
from irsd.core.types import CameraModel, CameraView, InstanceState, Rooms
from irsd.instances import memory as fusion
from irsd.instances.lift import LiftedMask, LiftedView
from irsd.instances.warm import warm_up

HERE = Path(__file__).resolve().parent
RESOLUTION_M = 0.1
PERIOD_NS = 200_000_000
VOXEL_M = 0.03  # the scenes' points are 2 cm apart, those of the product's map 5 cm
WORKERS = 2  # memories among which rooms are dealt out
NOTHING = np.zeros((0, 3), np.float32)
Scene = dict[str, NDArray[Any]]
Frame = tuple[CameraView, LiftedView]


def embed(names: Sequence[str]) -> NDArray[np.float32]:
    """Names say nothing in these scenes: what a mask means is in its embedding."""
    return np.tile(np.eye(1, 512, dtype=np.float32), (len(names), 1))


def frames_of(scene: Scene, shift_m: float = 0.0, rooms: int | None = None) -> Iterator[Frame]:
    """One (view, masks) per frame, shifted along x; rooms: only frames taken in the first so many rooms."""
    offset, features = scene["mask_offset"], scene["mask_feat"]
    points = scene["points"] + np.array([shift_m, 0, 0], np.float32)
    fx, fy, cx, cy = scene["intrinsics"].tolist()
    matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
    camera = CameraModel("camera", round(2 * cx) + 1, round(2 * cy) + 1, matrix, "plumb_bob", np.zeros(0))
    starts = np.searchsorted(scene["mask_frame"], np.arange(len(scene["frame_room"]) + 1))
    for k, room in enumerate(scene["frame_room"].tolist()):
        if rooms is not None and room >= rooms:
            continue
        masks = tuple(
            LiftedMask(n + 1, points[offset[i] : offset[i + 1]], (("thing", 1.0),), 1.0, features[i], False)
            for n, i in enumerate(range(starts[k], starts[k + 1]))
        )
        pose = scene["frame_pose"][k].astype(np.float64)
        pose[0, 3] += shift_m
        stamp_ns = (k + 1) * PERIOD_NS
        yield CameraView(stamp_ns, pose, camera, None, None), LiftedView(stamp_ns, masks, NOTHING, trimmed=False)


def rooms_of(scene: Scene, shift_m: float = 0.0) -> Rooms:
    """The true rooms as the room stage would give them, shifted along x."""
    rects = scene["rooms"].astype(np.float64) + np.array([shift_m, 0, shift_m, 0])
    low, high = rects[:, :2].min(0) - 1, rects[:, 2:].max(0) + 1
    width, height = np.ceil((high - low) / RESOLUTION_M).astype(int).tolist()
    frame = GridFrame((float(low[0]), float(low[1])), RESOLUTION_M, height, width)
    labels = np.zeros((height, width), np.int32)
    for number, (x0, y0, x1, y1) in enumerate(rects, start=1):
        (r0, c0), (r1, c1) = frame.cells_of(np.array([[x0, y0], [x1, y1]])).tolist()
        labels[r0:r1, c0:c1] = number
    return Rooms(frame, labels, tuple(range(1, len(rects) + 1)), (), (), ())


def settings_of(arguments: argparse.Namespace) -> fusion.FusionSettings:
    """The product's defaults with what the command line changes."""
    settings = fusion.FusionSettings()
    values: dict[str, Any] = {"method": arguments.method, "room_prior": arguments.rooms == "prior", "voxel_m": VOXEL_M}
    for pair in arguments.set:
        key, _, text = pair.partition("=")
        values[key] = type(getattr(settings, key))(json.loads(text))
    return dataclasses.replace(settings, **values)


def rss_mb() -> float:
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() / 2**20


def drive(
    memory: fusion.InstanceMemory, frames: Sequence[Frame], rooms: Rooms | None, collect_every: int
) -> tuple[float, float]:
    """(CPU s of observing, of collecting on the way)."""
    start, collecting = time.process_time(), 0.0
    for k, (view, lifted) in enumerate(frames, start=1):
        memory.observe(view, lifted, rooms)
        if collect_every and k % collect_every == 0:
            before = time.process_time()
            memory.collect(view.stamp_ns)
            collecting += time.process_time() - before
    return time.process_time() - start - collecting, collecting


def finish(memory: fusion.InstanceMemory, stamp_ns: int) -> tuple[float, tuple[InstanceState, ...]]:
    """(CPU s of the final pass, the states at the end)."""
    start = time.process_time()
    memory.collect(stamp_ns)
    states = memory.states()
    return time.process_time() - start, states


def score(scene: Scene, states: Sequence[InstanceState], tools: Path) -> dict[str, Any]:
    """By ``score_instances.py``, which lives beside the scene maker."""
    spec = importlib.util.spec_from_file_location("score_instances", tools / "score_instances.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    result: dict[str, Any] = module.score(scene, [s.points_map for s in states])
    return result


def write(path: Path, states: Sequence[InstanceState]) -> None:
    offset = np.cumsum([0, *(len(s.points_map) for s in states)])
    points = np.concatenate([NOTHING, *(s.points_map for s in states)])
    np.savez(path, points=points, offset=offset.astype(np.int64))


def growth(scene: Scene, arguments: argparse.Namespace) -> dict[str, Any]:
    """us per mask of the last copy of the scene, in a memory of about N instances; with --memory, what a finished one adds instead."""
    memory = fusion.InstanceMemory(settings_of(arguments), embed)
    span = float(scene["rooms"][:, 2].max()) + 2.0
    per_scene = int((scene["gt_frames"] >= 3).sum())
    rooms = max(1, round(arguments.instances / per_scene * len(scene["rooms"])))
    copies = max(1, round(arguments.instances / per_scene))
    held, count = [], []
    if arguments.memory:
        tracemalloc.start()
    for k in range(copies):
        frames = list(frames_of(scene, k * span, rooms if copies == 1 else None))
        masks = sum(len(lifted) for _, lifted in frames)
        observe_s, collect_s = drive(memory, frames, None, arguments.collect_every)
        del frames
        held.append(tracemalloc.get_traced_memory()[0] / 1024)
        count.append(len(memory))
    if arguments.memory:  # the first half fills the arrays; from then on memory grows by what is finished
        half = copies // 2 - 1
        kb = (held[-1] - held[half]) / (count[-1] - count[half])
        return {"instances": len(memory), "kb_per_finished_instance": round(kb, 2)}
    return {
        "instances": len(memory),
        "us_per_mask": round(observe_s / masks * 1e6, 1),
        "us_per_mask_with_collecting": round((observe_s + collect_s) / masks * 1e6, 1),
    }


def apart(scene: Scene, arguments: argparse.Namespace) -> dict[str, Any]:
    """Seconds of the last copy of the scene where rooms are fused apart, in a memory of about N instances."""
    parallel = arguments.rooms == "parallel"
    memory = RoomsApart(settings_of(arguments), embed, WORKERS, parallel=parallel)
    copies = max(1, round(arguments.instances / int((scene["gt_frames"] >= 3).sum())))
    span = float(scene["rooms"][:, 2].max()) + 2.0
    for k in range(copies):
        frames = list(frames_of(scene, k * span))
        streams = memory.streams(frames, rooms_of(scene, k * span))
        wall, cpu = time.perf_counter(), time.process_time()
        memory.drive(streams, arguments.collect_every)
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    figures: dict[str, Any] = {"instances": len(memory), "wall_s": round(wall, 4), "cpu_s": round(cpu, 4)}
    both = {id(view) for view, _ in streams[0]} & {id(view) for view, _ in streams[1]}
    figures["pictures_of_both"] = round(len(both) / len(frames), 3)
    if copies == 1 and (arguments.tools / "score_instances.py").is_file():
        figures |= score(scene, memory.finish(frames[-1][0].stamp_ns), arguments.tools)
    return figures


def run(scene: Scene, arguments: argparse.Namespace) -> dict[str, Any]:
    frames = list(frames_of(scene))
    rooms = rooms_of(scene) if arguments.rooms == "prior" else None
    memory = fusion.InstanceMemory(settings_of(arguments), embed)
    before = rss_mb()
    observe_s, collect_s = drive(memory, frames, rooms, arguments.collect_every)
    final_s, states = finish(memory, frames[-1][0].stamp_ns)
    masks = sum(len(lifted) for _, lifted in frames)
    figures: dict[str, Any] = {
        "frames": len(frames),
        "masks": masks,
        "cpu_s": round(observe_s + collect_s + final_s, 4),
        "stream_s": round(observe_s + collect_s, 4),
        "of_which_collecting_s": round(collect_s, 4),
        "final_s": round(final_s, 4),
        "us_per_mask": round(observe_s / masks * 1e6, 1),
        "ms_per_frame": round((observe_s + collect_s) / len(frames) * 1e3, 3),
        "rss_added_mb": round(rss_mb() - before, 1),
    }
    if arguments.out:
        write(arguments.out, states)
    if (arguments.tools / "score_instances.py").is_file():
        figures |= score(scene, states, arguments.tools)
    return figures


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", type=Path)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--method", choices=("ours", "irs"), default="ours")
    parser.add_argument("--rooms", choices=("off", "prior", "serial", "parallel"), default="off")
    parser.add_argument("--instances", type=int, default=0)
    parser.add_argument(
        "--memory", action="store_true", help="with --instances N >= 1000: kB that a finished instance adds"
    )
    parser.add_argument("--collect-every", type=int, default=10, metavar="K")
    parser.add_argument("--set", nargs="*", default=[], metavar="KEY=VALUE", help="settings of fusion")
    parser.add_argument("--tools", type=Path, default=HERE.parents[1] / "shared" / "tools" / "fusion")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    with np.load(arguments.scene) as file:
        scene = {name: file[name] for name in file.files}
    warm_up()
    how = apart if arguments.rooms in ("serial", "parallel") else growth if arguments.instances else run
    figures = how(scene, arguments)
    if arguments.json:
        print(json.dumps(figures))
    else:
        for name, value in figures.items():
            print(f"{name:18s} {round(value, 4) if isinstance(value, float) else value}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
