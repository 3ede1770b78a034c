"""A vehicle that speaks MAVLink over UDP and moves: the least that MAVSDK wants to see of a PX4, by pymavlink (LGPL: tests only)."""

from __future__ import annotations

import json
import math
import sys
import threading
import time
from typing import Any

from pymavlink import mavutil
from pymavlink.dialects.v20 import common

OFFBOARD, HOLD, STABILIZED = 6 << 16, (4 << 16) | (3 << 24), 7 << 16
STEP_S = 0.02
LOSS_S = 0.5  # without setpoints for so long it leaves offboard for hold: PX4's COM_OF_LOSS_T
SPEED_M_S = 2.5


class Vehicle(threading.Thread):
    """Use as a context manager. Attributes may be read and set from the test."""

    def __init__(self, port: int, *, armed: bool) -> None:
        super().__init__(daemon=True)
        self._link: Any = mavutil.mavlink_connection(
            f"udpout:127.0.0.1:{port}", source_system=1, source_component=1, dialect="common"
        )
        self.armed = armed
        self.mode = STABILIZED
        self.ned = [0.0, 0.0, -1.5]
        self.heading_rad = 0.0
        self.trail: list[tuple[float, float]] = []
        self.setpoints: list[tuple[float, float, float, float]] = []
        self.masks: set[int] = set()
        self.arm_commands = 0
        self.linked = True
        self._target: tuple[float, float, float, float] | None = None
        self._target_s = 0.0
        self._over = threading.Event()

    def __enter__(self) -> Vehicle:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self.join()
        self._link.close()

    def run(self) -> None:
        ticks, began = 0, time.monotonic()
        while not self._over.wait(STEP_S):
            while (message := self._link.recv_match(blocking=False)) is not None:
                if self.linked:
                    self._hear(message)
            self._move()
            if self.linked and ticks % 25 == 0:
                armed = common.MAV_MODE_FLAG_SAFETY_ARMED if self.armed else 0
                flags = common.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | armed
                self._link.mav.heartbeat_send(2, common.MAV_AUTOPILOT_PX4, flags, self.mode, common.MAV_STATE_ACTIVE)
            if self.linked and ticks % 2 == 0:
                stamp_ms = int((time.monotonic() - began) * 1000)
                self._link.mav.local_position_ned_send(stamp_ms, *self.ned, 0.0, 0.0, 0.0)
            ticks += 1

    def _hear(self, message: Any) -> None:
        kind = message.get_type()
        if kind == "COMMAND_LONG":
            if message.command == common.MAV_CMD_COMPONENT_ARM_DISARM:
                self.arm_commands += 1
                self.armed = message.param1 == 1.0
            elif message.command == common.MAV_CMD_DO_SET_MODE:
                self.mode = int(message.param2) << 16 | int(message.param3) << 24
            self._link.mav.command_ack_send(message.command, common.MAV_RESULT_ACCEPTED)
        elif kind == "SET_POSITION_TARGET_LOCAL_NED":
            self.masks.add(message.type_mask)
            self._target = (message.x, message.y, message.z, message.yaw)
            self._target_s = time.monotonic()
            self.setpoints.append(self._target)

    def _move(self) -> None:
        if self.mode == OFFBOARD and self._target is not None and time.monotonic() - self._target_s > LOSS_S:
            self.mode, self._target = HOLD, None
        if not (self.armed and self.mode == OFFBOARD and self._target is not None):
            return
        left = SPEED_M_S * STEP_S
        away = [t - p for t, p in zip(self._target, self.ned, strict=False)]
        distance = math.hypot(*away)
        share = 1.0 if distance <= left else left / distance
        self.ned = [p + share * d for p, d in zip(self.ned, away, strict=True)]
        self.heading_rad = self._target[3]
        self.trail.append((self.ned[0], self.ned[1]))


def main() -> None:
    """An armed vehicle until killed; a line of JSON with mode and place every 50 ms."""
    with Vehicle(int(sys.argv[1]), armed=True) as vehicle:
        while True:
            state = {"offboard": vehicle.mode == OFFBOARD, "hold": vehicle.mode == HOLD, "ned": vehicle.ned}
            print(json.dumps(state), flush=True)
            time.sleep(0.05)


if __name__ == "__main__":
    main()
