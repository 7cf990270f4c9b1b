"""An identifier that runs on and on takes no more memory, threads or open files than after its first minutes."""

from __future__ import annotations

import os
import threading
from pathlib import Path

import numpy as np

from joint_id_core.data.recording import Recording
from joint_id_core.estimators import ParameterSettings
from joint_id_core.models import build
from joint_id_core.online import OnlineIdentifier
from joint_id_core.online.check_thread import CheckThread
from joint_id_core.simulation.excitation import position_reference
from joint_id_core.simulation.position_control import ControlledJoint, PositionController
from joint_id_core.simulation.sensors import Sensors

RATE = 125
FULL_S, MORE_S = 80.0, 40.0  # the memory keeps 64 s of samples
VALUES = {"N": 101.0, "J": 1.4, "c": 2.8, "tau_f": 4.6}


def resident() -> int:
    """Resident memory of this process in bytes."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def watched(identifier: OnlineIdentifier, joint: ControlledJoint, seconds: float) -> int:
    """Let a joint move on; the number of estimates that converged."""
    converged = 0
    for _ in range(round(seconds * RATE / 25)):
        begin, rows = joint.joint.time, []
        for _ in range(25):
            shown = joint.shown
            rows.append({"link_position": shown["link_position"], **joint.tick(1.0 / RATE)})
        channels = {name: np.array([row[name] for row in rows]) for name in rows[0]}
        estimate = identifier.update(Recording(begin + np.arange(25) / RATE, channels))
        converged += estimate is not None and estimate.converged
    return converged


def handles() -> tuple[int, int]:
    """Threads and open files."""
    return threading.active_count(), len(os.listdir("/proc/self/fd"))


def test_memory_threads_and_open_files_stay_as_they_are():
    model = build("rigid_joint")
    sensors = Sensors(noise={"link_position": 1e-5, "link_velocity": 1e-3})
    joint = ControlledJoint(
        model, PositionController(), position_reference(), VALUES, torque_noise=0.003, sensors=sensors
    )
    checks = CheckThread()
    identifier = OnlineIdentifier(model, ParameterSettings({"N": 101.0}), background=checks)
    assert watched(identifier, joint, FULL_S) > 100
    before, held = resident(), handles()
    assert watched(identifier, joint, MORE_S) > 60
    assert resident() < 1.03 * before
    assert handles() == held
    checks.stop()
