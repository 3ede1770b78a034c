"""Casting rays into a triangle mesh with Embree: the only place that imports a ray caster.

Embree comes by embreex (45 MB) where that has a wheel, else inside Open3D (900 MB, and it needs libusb from the system).
"""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

# Embree marks a miss by leaving the far distance at its largest value.
_MISS_M = np.float32(1e6)


@dataclass(frozen=True, slots=True)
class Hits:
    """range_m: float32 [N] along the unit direction, inf where nothing was hit; triangle: int32 [N], -1 where nothing."""

    range_m: NDArray[np.float32]
    triangle: NDArray[np.int32]


class RayScene:
    """A static mesh. Single-threaded on purpose: the world shares its cores with the software under test."""

    def __init__(self, triangles: NDArray[np.float32]) -> None:
        """triangles: float32 [T, 3, 3] metres. Raises ValueError for another shape or an empty mesh."""
        if triangles.ndim != 3 or triangles.shape[1:] != (3, 3) or not len(triangles):
            raise ValueError(f"triangles must be [T, 3, 3] with T > 0, got {triangles.shape}")
        self._cast = embreex_caster(triangles) if importlib.util.find_spec("embreex") else open3d_caster(triangles)

    def cast(self, origins_m: NDArray[np.float32], directions: NDArray[np.float32]) -> Hits:
        """First hits of rays: origins [N, 3] metres, unit directions [N, 3], same frame as the mesh."""
        if not len(origins_m):
            return Hits(np.empty(0, np.float32), np.empty(0, np.int32))
        range_m, triangle = self._cast(
            np.ascontiguousarray(origins_m, np.float32), np.ascontiguousarray(directions, np.float32)
        )
        missed = (triangle < 0) | ~(range_m < _MISS_M)
        return Hits(
            np.where(missed, np.float32(np.inf), range_m).astype(np.float32),
            np.where(missed, np.int32(-1), triangle).astype(np.int32),
        )


Caster = Callable[[NDArray[np.float32], NDArray[np.float32]], tuple[NDArray[np.float32], NDArray[np.int32]]]


def embreex_caster(triangles: NDArray[np.float32]) -> Caster:
    """(origins [N, 3], directions [N, 3]) -> (range [N], triangle [N]) by embreex; a miss is triangle -1."""
    from embreex.mesh_construction import TriangleMesh  # noqa: PLC0415  one of two, see the module's text
    from embreex.rtcore_scene import EmbreeScene  # noqa: PLC0415

    scene = EmbreeScene(robust=True)
    mesh = TriangleMesh(scene, np.ascontiguousarray(triangles, np.float32))

    def cast(
        origins: NDArray[np.float32], directions: NDArray[np.float32], _alive: object = mesh
    ) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
        out = scene.run(origins, directions, output=1)
        return np.asarray(out["tfar"], np.float32), np.asarray(out["primID"], np.int32)

    return cast


def open3d_caster(triangles: NDArray[np.float32]) -> Caster:
    """The same by Open3D's RaycastingScene."""
    open3d: Any = importlib.import_module("open3d")  # not installed where embreex is

    scene = open3d.t.geometry.RaycastingScene(nthreads=1)
    vertices = np.ascontiguousarray(triangles, np.float32).reshape(-1, 3)
    scene.add_triangles(vertices, np.arange(len(vertices), dtype=np.uint32).reshape(-1, 3))

    def cast(
        origins: NDArray[np.float32], directions: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
        out = scene.cast_rays(open3d.core.Tensor(np.hstack([origins, directions])))
        triangle = out["primitive_ids"].numpy().astype(np.int64)
        hit = triangle != scene.INVALID_ID
        return out["t_hit"].numpy(), np.where(hit, triangle, -1).astype(np.int32)

    return cast
