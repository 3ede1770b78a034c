"""Casting rays into a triangle mesh with Embree: the only place that imports the ray caster."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from embreex.mesh_construction import TriangleMesh  # type: ignore[import-untyped, unused-ignore]
from embreex.rtcore_scene import EmbreeScene  # type: ignore[import-untyped, unused-ignore]
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
        self._scene = EmbreeScene(robust=True)
        self._mesh = TriangleMesh(self._scene, np.ascontiguousarray(triangles, np.float32))

    def cast(self, origins_m: NDArray[np.float32], directions: NDArray[np.float32]) -> Hits:
        """First hits of rays: origins [N, 3] metres, unit directions [N, 3], same frame as the mesh."""
        if not len(origins_m):
            return Hits(np.empty(0, np.float32), np.empty(0, np.int32))
        out = self._scene.run(
            np.ascontiguousarray(origins_m, np.float32), np.ascontiguousarray(directions, np.float32), output=1
        )
        triangle = np.asarray(out["primID"], np.int32)
        missed = (triangle < 0) | (out["tfar"] > _MISS_M)
        range_m = np.where(missed, np.float32(np.inf), out["tfar"]).astype(np.float32)
        return Hits(range_m, np.where(missed, np.int32(-1), triangle))
