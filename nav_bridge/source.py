"""What the bridge asks irsd for: the map of free space and the surfaces of things. May be used from several threads."""

from __future__ import annotations

import json

import numpy as np
from numpy.typing import NDArray

from irsd.core.errors import DecodeError
from irsd.core.grid import GridFrame
from irsd.core.runtime import Cell
from irsd.graph.codec import array_from_bytes, png_to_occupancy
from irsd.io.keys import RobotKeys
from irsd.io.session import Reply, Session
from nav_bridge.route import CostMap, RouteSettings, make_cost_map


class Source:
    """irsd's queryables, decoded. Raises DecodeError for documents that are not what they should be."""

    def __init__(self, session: Session, keys: RobotKeys, timeout_s: float, settings: RouteSettings) -> None:
        self._session = session
        self._keys = keys
        self._timeout_s = timeout_s
        self._settings = settings
        self._last: Cell[tuple[bytes, NDArray[np.int8], CostMap] | None] = Cell(None)

    def cost_map(self) -> CostMap | None:
        """The occupancy as it is now, as the route search needs it; None when irsd has none, or does not answer."""
        reply = self._first(self._keys.occupancy)
        if reply is None:
            return None
        last = self._last.get()
        known = last is not None and last[0] == reply.payload
        cells = last[1] if last is not None and known else png_to_occupancy(reply.payload)
        try:
            header = json.loads(reply.attachment or b"")
            origin = (float(header["origin_xy_m"][0]), float(header["origin_xy_m"][1]))
            frame = GridFrame(origin, float(header["resolution_m"]), *cells.shape)
        except (ValueError, KeyError, TypeError, IndexError) as error:
            raise DecodeError(
                f"{self._keys.occupancy}: attachment without resolution and origin ({error!r})"
            ) from error
        if last is not None and known and last[2].frame == frame:
            return last[2]  # nothing new was seen: the distances on a large floor cost a tenth of a second
        costs = make_cost_map(frame, cells, self._settings)
        self._last.set((bytes(reply.payload), cells, costs))
        return costs

    def points(self, instance: str) -> NDArray[np.floating]:
        """Surface points [N, 3] of an instance, map frame; empty when irsd has none, or does not answer."""
        reply = self._first(self._keys.points(instance))
        if reply is None:
            return np.zeros((0, 3), np.float32)
        points = array_from_bytes(reply.payload, reply.attachment or b"")
        if points.ndim != 2 or points.shape[1] != 3:
            raise DecodeError(f"points of {instance}: expected [N, 3], got {points.shape}")
        return points

    def _first(self, key: str) -> Reply | None:
        replies = self._session.get(key, timeout_s=self._timeout_s)
        return next((reply for reply in replies if reply.ok), None)
