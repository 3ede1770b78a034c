"""The map stage: one scan in, voxels, structure labels, floor and ceiling, occupancy and plan evidence out."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from irsd.core.geometry import Pose, invert
from irsd.core.grid import GridFrame
from irsd.core.settings import setting
from irsd.core.types import CameraModel, LooseChange, MapBlock, MapUpdate, PlanEvidence, Structure, SyncedFrame
from irsd.mapping import frustum, kernels
from irsd.mapping.floors import Floors, FloorSettings
from irsd.mapping.loose import LooseSettings, LooseVoxels
from irsd.mapping.network import NetworkSettings, StructureModel, StructureVotes
from irsd.mapping.occupancy import OccupancySettings, SliceGrid
from irsd.mapping.structure import LevelMap, Levels, StructureSettings, WallLines
from irsd.mapping.structure_kernels import in_wall_band, label_points, surroundings
from irsd.mapping.voxels import VoxelMap, VoxelSettings


@dataclass(frozen=True)
class MappingSettings:
    """Settings of the map stage."""

    max_range_m: float = setting(25.0, "returns farther than this are ignored", lo=1.0, hi=300.0)
    voxels: VoxelSettings = field(default_factory=VoxelSettings)
    occupancy: OccupancySettings = field(default_factory=OccupancySettings)
    structure: StructureSettings = field(default_factory=StructureSettings)
    floors: FloorSettings = field(default_factory=FloorSettings)
    network: NetworkSettings = field(default_factory=NetworkSettings)
    loose: LooseSettings = field(default_factory=LooseSettings)


@dataclass(frozen=True, slots=True)
class _Storey:
    """What is kept by plan cell, and so for every floor of the building apart."""

    grid: SliceGrid
    level_map: LevelMap
    walls: WallLines


class Mapper:
    """Owner of the map. Only the map thread calls it; what it returns is not written again."""

    def __init__(self, settings: MappingSettings, model: StructureModel | None = None, *, parts: bool = False) -> None:
        """model: a network that votes on what voxels are part of, beside geometry. parts: ``changed_parts`` will be asked for."""
        self.settings = settings
        self._votes = None if model is None else StructureVotes(settings.network, model)
        self.voxels = VoxelMap(settings.voxels)
        self._loose = LooseVoxels(settings.loose, settings.structure, self.voxels) if parts else None
        self.levels = Levels(settings.structure)
        self.floors = Floors(settings.floors)
        self._storeys = {0: self._new_storey()}
        self._sweep = 0
        self._scans = 0
        self._ignored = 0

    @property
    def grid(self) -> SliceGrid:
        """The plan of the floor where the robot is."""
        return self._storeys[self.floors.now].grid

    @property
    def level_map(self) -> LevelMap:
        """Heights of floor and ceiling where the robot is."""
        return self._storeys[self.floors.now].level_map

    @property
    def walls(self) -> WallLines:
        """Wall lines of the floor where the robot is."""
        return self._storeys[self.floors.now].walls

    def integrate(self, frame: SyncedFrame) -> MapUpdate:
        """Add one deskewed scan. Cost follows the scan, not the map."""
        origin, base = frame.scan.origin_map, frame.map_T_base[:3, 3]
        points = self._usable(frame.scan.points_map, origin)
        touched = self.voxels.insert(points, origin, frame.scan.stamp_ns)
        rows = touched.rows
        coarse = self.voxels.coarse[rows]
        surface, normals = self.voxels.surface.take(coarse, 0), self.voxels.normal.take(coarse, 0)
        self.levels.update(surface, normals, base, float(origin[2]))
        measured = self._on_a_floor(float(base[2]))
        self.level_map.update(surface, normals, self.levels)
        self._learn_walls(surface, normals)
        self._label(np.concatenate([rows, self._next_sweep(), self._voted(base)]), base)
        if self._loose is not None:
            self._loose.follow(rows, self.level_map, self.levels, self.walls)
        changed = None
        if len(points) and measured:  # what is seen from the stairs has no height above a floor
            level = np.abs(self.voxels.normal[self.voxels.coarse[touched.row_of_point], 2])
            changed = self.grid.integrate(
                points, origin, level > self.settings.structure.horizontal,
                self.levels.floor_z_m, self.levels.ceiling_z_m, self._scans,
            )  # fmt: skip
        self._scans += 1
        return MapUpdate(frame.seq, frame.stamp_ns, rows, self.levels.floor_z_m, self.levels.ceiling_z_m, changed)

    def _on_a_floor(self, base_z_m: float) -> bool:
        """Whether the robot stands on a floor whose height is known; changes to another floor's plan when it has got there."""
        before = self.floors.now
        on_floor = self.floors.update(base_z_m, self.levels.floor_z_m)
        if self.floors.now != before:
            self.levels.forget()
            if self.floors.now not in self._storeys:
                self._storeys[self.floors.now] = self._new_storey()
        near = abs(self.levels.floor_z_m - base_z_m) <= self.settings.floors.tolerance_m
        return on_floor is not None and (near or len(self._storeys) == 1)

    def _new_storey(self) -> _Storey:
        s = self.settings
        area_m2 = s.occupancy.max_area_m2
        return _Storey(SliceGrid(s.occupancy), LevelMap(s.structure, area_m2), WallLines(s.structure, area_m2))

    def _usable(self, points: NDArray[np.float32], origin: NDArray[np.float64]) -> NDArray[np.float32]:
        """The finite points within max_range_m of the sensor."""
        delta = np.asarray(points - origin.astype(np.float32), np.float32)
        near = np.einsum("ij,ij->i", delta, delta) < self.settings.max_range_m**2  # False for NaN
        self._ignored += int(len(points) - near.sum())
        return np.asarray(points[near], np.float32)

    def _learn_walls(self, surface: NDArray[np.float32], normals: NDArray[np.float32]) -> None:
        """Feed the upright surface near the ceiling to the wall lines and refit the tiles that were seen."""
        limits = self.settings.structure.limits
        upright = in_wall_band(surface, normals, self.level_map.tiles(self.levels), limits)
        self.walls.add(surface[upright], normals[upright])
        self.walls.refit(surface)

    def _next_sweep(self) -> NDArray[np.int32]:
        """The next few voxels in turn: labels of places that are not seen again still learn from walls found later."""
        end = self.voxels.row_count
        count = min(self.settings.structure.sweep_rows, end)
        rows = (self._sweep + np.arange(count, dtype=np.int64)) % max(end, 1)
        self._sweep = int((self._sweep + count) % max(end, 1))
        return np.asarray(rows[self.voxels.hits[rows] > 0], np.int32)

    def _label(self, rows: NDArray[np.int32], base: NDArray[np.float64]) -> None:
        coarse = self.voxels.coarse[rows]
        points = self.voxels.mean.take(rows, 0)
        labels = label_points(
            points,
            self.voxels.surface.take(coarse, 0),
            self.voxels.normal.take(coarse, 0),
            self.level_map.tiles(self.levels),
            self.walls.tiles,
            base,
            self.settings.structure.limits,
        )
        self.voxels.structure[rows] = labels if self._votes is None else self._votes.labels(rows, points, labels)

    def _voted(self, base: NDArray[np.float64]) -> NDArray[np.int32]:
        """The voxels that the network has just voted on, when there is one and it was due."""
        if self._votes is None or not self._votes.due():
            return np.zeros(0, np.int32)
        rows = self._votes.chosen(self.voxels.rows_within(*self._votes.box(base)))
        self._votes.vote(rows, self.block(rows), base, self.voxels.row_count)
        return rows

    # ------------------------------------------------------------------------------------------------ reading
    def block(self, rows: NDArray[np.int32]) -> MapBlock:
        """What geometry knows of the voxels in rows [N], map frame."""
        coarse = self.voxels.coarse[rows]
        points, surface = self.voxels.mean.take(rows, 0), self.voxels.surface.take(coarse, 0)
        normals = self.voxels.normal.take(coarse, 0)
        levels, walls, limits = self.level_map.tiles(self.levels), self.walls.tiles, self.settings.structure.limits
        base = np.zeros(3)
        return MapBlock(
            points,
            normals,
            surface,
            surroundings(points, surface, normals, levels, walls),
            label_points(points, surface, normals, levels, walls, base, limits),
        )

    def plan_evidence(self) -> PlanEvidence:
        """The map from above, for room segmentation. Costs a pass over the grid."""
        frame, layers = self.grid.layers()
        return PlanEvidence(
            frame,
            layers["wall"],
            layers["free"],
            layers["low"],
            layers["known"],
            self.levels.floor_z_m,
            self.levels.ceiling_z_m,
            layers["lintel"],
            self.floors.now,
        )

    def wall_points(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Points [W, 3] and unit normals [W, 3] (towards where they were seen from) of the voxels labelled WALL."""
        voxels = self.voxels
        return kernels.select(
            voxels.structure[: voxels.row_count], Structure.WALL, voxels.mean, voxels.coarse, voxels.normal
        )

    def visible(
        self, map_T_camera: Pose, camera: CameraModel, max_range_m: float
    ) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
        """Voxel points [K, 3] in the camera's view up to max_range_m, and their structure [K]. Not tested for occlusion."""
        view = frustum.view_of(camera, max_range_m)
        blocks, index = self.voxels.blocks[: self.voxels.slot_count], self.voxels.index
        rows = frustum.rows_in_view(
            view, invert(map_T_camera), blocks, index, self.voxels.mean, self.settings.voxels.voxel_m
        )
        return self.voxels.mean.take(rows, 0), self.voxels.structure.take(rows)

    def loose_points(self, low: NDArray[np.float32], high: NDArray[np.float32]) -> NDArray[np.float32]:
        """Voxel points [K, 3] in a box that are not structure: what can be carried away."""
        rows = self.voxels.rows_within(low, high)
        return np.asarray(self.voxels.mean[rows[self.voxels.structure[rows] == Structure.OTHER]], np.float32)

    def made_ns(self, points: NDArray[np.float32]) -> NDArray[np.int64]:
        """When the voxels of points [N, 3] were first hit: int64 [N], 0 where there is none."""
        rows = self.voxels.rows_at(points)
        return np.where(rows >= 0, self.voxels.made_ns[rows], 0)

    def forget(self, points: NDArray[np.float32]) -> None:
        """Nothing is at points [N, 3] any more: what was carried away does not hide what is behind."""
        if len(points):
            if self._loose is not None:
                rows = self.voxels.rows_at(points)
                self._loose.forget(np.unique(rows[rows >= 0]))
            self.voxels.remove(points)

    def changed_parts(self) -> LooseChange:
        """The parts of the map that are no structure and hang together, where they changed since the last call."""
        assert self._loose is not None, "Mapper(parts=True)"
        return self._loose.changed()

    def rows_at(self, points: NDArray[np.float32]) -> NDArray[np.int32]:
        """Row [K] of the voxel that holds each point [K, 3], -1 where there is none."""
        return self.voxels.rows_at(points)

    def navigation_grid(self) -> tuple[GridFrame, NDArray[np.int8]]:
        """(frame, int8 [H, W]) at the robot's height: 100 occupied, 0 free, -1 unknown. Costs a pass over the grid."""
        return self.grid.navigation()

    def counters(self) -> dict[str, int]:
        """What was kept, forgotten and refused since the start."""
        return {
            "scans": self._scans,
            "voxels": len(self.voxels),
            "voxels_evicted": self.voxels.evicted,
            "voxels_refused": self.voxels.refused,
            "points_ignored": self._ignored,
            "grid_growth_refused": self.grid.area.refused,
        }
