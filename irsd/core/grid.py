"""Where the cells of a 2D grid lie in the map frame. Row grows with y, column with x; row 0, column 0 is the lowest corner."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class GridFrame:
    """Placement of a [height, width] grid.

    origin_xy_m: map coordinates of the outer corner of cell (0, 0); resolution_m: edge length of a cell.
    """

    origin_xy_m: tuple[float, float]
    resolution_m: float
    height: int
    width: int

    def cells_of(self, points_xy: NDArray[np.floating]) -> NDArray[np.int64]:
        """[N, 2] (row, col) of points [N, 2+] in metres. May lie outside; see ``inside``."""
        xy = np.asarray(points_xy, np.float64)[..., :2]
        col_row = np.floor((xy - self.origin_xy_m) / self.resolution_m).astype(np.int64)
        return col_row[..., ::-1]

    def centres_of(self, cells: NDArray[np.integer]) -> NDArray[np.float64]:
        """[N, 2] map coordinates (x, y) in metres of the centres of cells [N, 2] (row, col)."""
        rc = np.asarray(cells, np.float64)
        return np.asarray((rc[..., ::-1] + 0.5) * self.resolution_m + self.origin_xy_m)

    def inside(self, cells: NDArray[np.integer]) -> NDArray[np.bool_]:
        """[N] True where cells [N, 2] (row, col) lie in the grid."""
        rc = np.asarray(cells)
        return np.asarray((rc >= 0).all(-1) & (rc[..., 0] < self.height) & (rc[..., 1] < self.width))
