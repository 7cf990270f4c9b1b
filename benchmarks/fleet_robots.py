"""Many robots on the network in one process, light enough to leave the processor to the nodes under test.

They answer RTDE as the emulated robot does, at 125 Hz, and all send the same motion, which is simulated before: six
joints under position control, each with its own noise. Their controllers decide 125 times a second, too: of a robot
that is controlled at 500 Hz and read at 125 Hz the fits find that the current changes between the samples.
"""

from __future__ import annotations

import argparse
import time
from selectors import EVENT_READ, DefaultSelector

import numpy as np

from joint_id_core.emulator.controller import NORMAL_MODE, POWER_ON, PROGRAM_RUNNING
from joint_id_core.emulator.server import Server
from joint_id_core.rtde.fields import FIELDS, JOINTS, TYPES, register_type
from joint_id_core.rtde.modes import JointMode, RobotMode, SafetyMode
from joint_id_core.rtde.packets import Value
from joint_id_core.simulation.plants import MotionOptions, PositionControl
from joint_id_core.simulation.sensors import ur_robot_sensors

RATE = 125  # Hz
TICKS = 4  # of the emulated controllers, from one sample to the next


class Recorded:
    """A controller of a CB3 robot that reports what was simulated; as `emulator.controller.Controller`."""

    version = (3, 15, 0, 0)

    def __init__(self, duration: float) -> None:
        """Simulate so many s."""
        plant = PositionControl({}, MotionOptions(), seed=0)
        self._ratio = plant.values["N"]
        sensors, rng = ur_robot_sensors(self._ratio), np.random.default_rng(0)
        rows = [plant.tick(1.0 / RATE) for _ in range(round(duration * RATE))]
        self._shown = {
            name: np.stack([sensors.reading(name, np.array([r[name] for r in rows]), rng) for _ in range(JOINTS)], -1)
            for name in ("link_position", "motor_velocity", "current")
        }
        self.values: dict[str, Value | list[float]] = {}
        for field in FIELDS.values():
            count = TYPES[field.type][1]
            self.values[field.name] = 0.0 if count == 1 else [0.0] * count
        self.values |= {
            "robot_mode": RobotMode.RUNNING, "joint_mode": [JointMode.RUNNING] * JOINTS,
            "safety_mode": SafetyMode.NORMAL, "joint_temperatures": [30.0] * JOINTS,
            "robot_status_bits": POWER_ON | PROGRAM_RUNNING, "safety_status_bits": NORMAL_MODE,
        }  # fmt: skip

    def type_of(self, name: str) -> str | None:
        """Return the type of an output field."""
        return FIELDS[name].type if name in FIELDS and FIELDS[name].sent_by(self.version) else register_type(name)

    @staticmethod
    def input_type_of(name: str) -> str | None:
        """Return None: it takes no inputs."""
        return None

    def report(self, k: int) -> bool:
        """Show sample k; return False after the last one."""
        if k >= len(self._shown["current"]):
            return False
        self.values["timestamp"] = 1.0 + k / RATE
        self.values["actual_q"] = self._shown["link_position"][k].tolist()
        self.values["actual_qd"] = (self._shown["motor_velocity"][k] / self._ratio).tolist()
        self.values["actual_current"] = self._shown["current"][k].tolist()
        return True


def main() -> None:
    """Listen at one port a robot, and send until the motion ends."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--robots", type=int, default=20, help="(default: %(default)s)")
    parser.add_argument("--duration", type=float, default=180.0, help="s (default: %(default)s)")
    args = parser.parse_args()
    controller, selector = Recorded(args.duration), DefaultSelector()
    servers = [Server("127.0.0.1", 0, controller, selector, 0) for _ in range(args.robots)]  # type: ignore[arg-type]  # it has the methods
    for server in servers:
        server.listen()
    print(" ".join(str(server.address[1]) for server in servers), flush=True)
    begun, k = time.monotonic(), 0
    while controller.report(k):
        for server in servers:
            server.publish(TICKS * k)
            server.flush(time.monotonic())
        k += 1
        while (left := begun + k / RATE - time.monotonic()) > 0.0:
            for key, events in selector.select(left):
                if events & EVENT_READ:
                    key.data(time.monotonic())
            for server in servers if left > 0.5 / RATE else ():
                server.flush(time.monotonic())  # answers to requests


if __name__ == "__main__":
    main()
