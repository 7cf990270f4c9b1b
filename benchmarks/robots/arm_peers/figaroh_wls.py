"""FIGAROH, as its guide for robots of one's own says: base parameters with friction, rotors and offsets by weighted
least squares of a decimated regressor; then its fit with physically consistent links.

Settings are those of its UR10 example, whose logs have the same rate, but for the low-pass of positions: 20 Hz predict
a little better than its 10 Hz. It derives velocities and accelerations itself. Weights and its tenfold decimation are
options that predict better than without. It stops at meshes that are not there, so it gets a description without.
"""

from __future__ import annotations

import contextlib
import io
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from figaroh.identification.base_identification import BaseIdentification
from figaroh.tools.regressor import build_regressor_basic
from figaroh.tools.robot import load_robot

from joint_id_core.data.recording import Array
from robots.arm_peers.found import Found, scores
from robots.arm_peers.logs import PERIOD_S, Log
from robots.fitted import Value

PACKAGE = "figaroh"
CUTOFF_HZ = 20.0
PHYSICAL = {"select_stage": "physical_fit", "physical_fit": {"enabled": True}}


class Identification(BaseIdentification):
    """What FIGAROH asks for: a class that gives it a log."""

    def __init__(self, robot: Any, config: str, log: Log) -> None:
        super().__init__(robot, config)
        self._log = log
        every = list(range(len(log.joints)))
        self.identif_config.update(act_idxq=every, act_idxv=every)

    def load_trajectory_data(self, data_source: str | None = None) -> dict[str, Array | None]:
        """Give the log."""
        log = self._log
        return {
            "timestamps": log.time, "positions": log.q, "velocities": None, "accelerations": None,
            "torques": log.torque,
        }  # fmt: skip


def fit(urdf: str, log: Log, others: Sequence[Log]) -> Found:
    """Fit a log, and predict the others."""
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
        path = Path(folder) / "robot.urdf"
        path.write_text(urdf)
        robot = load_robot(str(path), load_by_urdf=True)
        begun = time.process_time()
        fitted = _solved(robot, Path(folder), log, {})
        cpu_s = time.process_time() - begun
        physical = _solved(robot, Path(folder), log, PHYSICAL).selected
        names = list(fitted.standard_parameter)
        found, sigma = np.zeros(len(names)), np.full(len(names), np.nan)
        for name, value, share in zip(
            fitted.params_base, fitted.phi_base, fitted.result["wls_std_deviations"], strict=True
        ):
            k = names.index(name.split()[0])  # a combination is named after its first parameter
            found[k], sigma[k] = value, 0.01 * share * abs(value)
        friction = {
            quantity: [Value(float(found[k]), float(sigma[k])) for k in _places(names, prefix, log)]
            for quantity, prefix in (("damping", "fv"), ("friction", "fs"))
        }
        judged = scores(lambda other: _torque(robot, fitted, found, other), others)
    if not physical.accepted:
        return Found(friction, *judged, (), (), cpu_s, note=f"no consistent links: {physical.reason}")
    consistent = dict(zip(physical.names, map(float, physical.values), strict=True))
    rotors, masses = ([consistent[f"{prefix}_{joint}"] for joint in log.joints] for prefix in ("Ia", "m"))
    return Found(friction, *judged, rotors, masses, cpu_s)


def _solved(robot: Any, folder: Path, log: Log, more: Mapping[str, Any]) -> Identification:
    """An identification that has run."""
    nothing = [0.0] * len(log.joints)
    config = {
        "robot": {"name": "arm", "properties": {
            "joints": {"active_joints": list(log.joints)},
            "mechanics": {
                "reduction_ratios": [1.0] * len(log.joints), "actuator_inertias": nothing, "joint_offsets": nothing,
                "friction_coefficients": {"viscous": nothing, "static": nothing},
            },
            "coupling": {"has_coupled_wrist": False},
        }},
        "tasks": {"identification": {
            "enabled": True, "type": "dynamic_identification",
            "problem": {
                "include_external_forces": False, "use_joint_torques": True,
                "model_components": {"friction": True, "actuator_inertia": True, "joint_offset": True},
            },
            "signal_processing": {
                "sampling_frequency": 1.0 / PERIOD_S, "cutoff_frequency": CUTOFF_HZ, "filter_type": "butterworth",
                "filter_order": 4,
            },
            **more,
        }},
    }  # fmt: skip
    path = folder / "config.yaml"
    path.write_text(yaml.safe_dump(config))
    found = Identification(robot, str(path), log)
    found.initialize()
    found.solve(plotting=False, wls=True)
    return found


def _places(names: Sequence[str], prefix: str, log: Log) -> list[int]:
    return [names.index(f"{prefix}_{joint}") for joint in log.joints]


def _torque(robot: Any, fitted: Identification, values: Array, log: Log) -> Array:
    """Torques of the motion of a log, shape (T, n)."""
    table = build_regressor_basic(robot, *log.motion(), fitted.identif_config)
    return np.asarray(table @ values).reshape(len(log.joints), -1).T
