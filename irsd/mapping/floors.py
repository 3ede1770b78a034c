"""The floors of the building, from the height of floor planes along the trajectory."""

from __future__ import annotations

from dataclasses import dataclass

from irsd.core.settings import setting


@dataclass(frozen=True)
class FloorSettings:
    """When a level is a floor of its own."""

    storey_m: float = setting(1.8, "floors are at least this far apart in height", lo=0.5, hi=10.0)
    tolerance_m: float = setting(
        0.3, "the robot is on a floor when its base is this near to the floor's height", lo=0.05
    )
    scans: int = setting(5, "a new floor is believed after this many scans on one level", lo=1, hi=1000)
    level_m: float = setting(
        0.05, "base heights that differ by at most this from scan to scan are level ground", lo=0.0
    )


class Floors:
    """Heights of the floors found so far, in the order in which they were found; the single writer of that list."""

    def __init__(self, settings: FloorSettings) -> None:
        self._settings = settings
        self._heights_m: list[float] = []
        self._last_base_m = 0.0
        self._level_scans = 0
        self.now = 0

    @property
    def heights_m(self) -> tuple[float, ...]:
        """z of every floor, by index."""
        return tuple(self._heights_m)

    def update(self, base_z_m: float, floor_z_m: float) -> int | None:
        """The floor that the robot stands on, or None on the way between two.

        base_z_m: of the robot; floor_z_m: of the floor plane measured around it, ignored when it is not the one under the robot.
        """
        s = self._settings
        under = floor_z_m if abs(floor_z_m - base_z_m) <= s.tolerance_m else base_z_m
        if not self._heights_m:
            self._heights_m.append(under)
        level = abs(base_z_m - self._last_base_m) <= s.level_m
        self._level_scans = self._level_scans + 1 if level else 0
        self._last_base_m = base_z_m
        nearest = min(range(len(self._heights_m)), key=lambda k: abs(self._heights_m[k] - base_z_m))
        away = abs(self._heights_m[nearest] - base_z_m)
        if away <= s.tolerance_m:
            # Odometry drifts in height too, slowly: the floor follows what is measured under the robot.
            self._heights_m[nearest] += 0.05 * (under - self._heights_m[nearest])
            self.now = nearest
            return nearest
        if away >= s.storey_m and self._level_scans >= s.scans:
            self._heights_m.append(under)
            self.now = len(self._heights_m) - 1
            return self.now
        return None
