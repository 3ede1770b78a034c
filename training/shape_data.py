"""Clouds of furniture with names, for the shape encoder: python -m training.shape_data --count N --seed S --out FILE.npz"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from irsd.perception.shape import POINTS
from training import sweethome
from training.clouds import measured, placed, seen
from training.furniture.collection import draw


def cloud_of(triangles, mount, bottom_m, rng):
    """POINTS points [POINTS, 3] (drawn with repetition when fewer) and their true number; None when hardly anything was seen."""
    solid = placed(triangles, mount, bottom_m, rng)
    points = measured(seen(solid, mount, rng), rng)
    if len(points) < 4:
        return None
    chosen = rng.choice(len(points), POINTS, replace=len(points) < POINTS)
    return points[chosen].astype(np.float16), len(points)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--count", type=int, default=20000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--share", type=float, default=0.2, help="share of sweethome3d models")
    parser.add_argument("--out", type=Path, required=True)
    arguments = parser.parse_args()
    rng = np.random.default_rng(arguments.seed)
    catalogue = [entry for entry in sweethome.entries() if entry.category not in sweethome.OUTDOORS]
    cache: dict[int, np.ndarray] = {}
    clouds, sizes, names = [], [], []
    while len(clouds) < arguments.count:
        if rng.random() < arguments.share:
            k = int(rng.integers(len(catalogue)))
            entry = catalogue[k]
            if k not in cache:
                cache[k] = sweethome.triangles(entry)
            if not len(cache[k]) or len(cache[k]) > 150_000:
                continue
            found = cloud_of(cache[k], sweethome.mount_of(entry), entry.elevation_m, rng)
            name = "sh3d:" + entry.name
        else:
            model = draw(rng)
            found = cloud_of(model.triangles(), model.mount, model.bottom_m, rng)
            name = model.name
        if found is not None:
            clouds.append(found[0])
            sizes.append(found[1])
            names.append(name)
    np.savez(arguments.out, points=np.array(clouds), size=np.array(sizes, np.int32), name=np.array(names))


if __name__ == "__main__":
    main()
