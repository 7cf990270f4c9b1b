"""The data of the study: step responses of Models 1 and 3 without noise, and a UR3e, simulated and measured.

What the paper leaves unsaid is our choice: samples of 1 ms, a 12 V step from rest for both models, no load.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from simulated import SENSORS

from joint_id_core.data.recording import Array, Recording
from joint_id_core.models import Model, build
from joint_id_core.simulation.excitation import position_reference
from joint_id_core.simulation.position_control import PositionController, simulate_closed_loop
from joint_id_core.simulation.sensors import ur_robot_sensors
from joint_id_core.simulation.simulator import simulate

PERIOD_S, STEP_V = 1e-3, 12.0
SMOOTHING = 1e-4  # rad/s: friction of data without noise turns in the simulator at once, and every trace of it counts
FACTOR = 1.3  # by which start values are off at most
NEAR = 1.07  # the same for a second run of H-PINN, which hardly leaves the valley that it starts in
TORQUE_NOISE = 0.003  # Nm, of the simulated UR3e
UR_RATE, UR_SECONDS = 500, 4.0


@dataclass(frozen=True)
class Case:
    """An identification problem.

    Attributes:
        name: what it is.
        model: what is fitted.
        freed: parameters that the paper estimates although our table holds them.
        recording: all states and the inputs; `labels` are those of the states that a method may use.
        truth: parameters that moved it.
        torsion: whether the twist of the gear is a label too.
        bounds: of parameters, by name, that the paper sets.
        smoothing: values of the smoothing velocities, for methods that smooth friction.
        true: the states themselves, where `recording` has noise.
    """

    name: str
    model: Model
    recording: Recording
    labels: tuple[str, ...]
    truth: Mapping[str, float]
    freed: tuple[str, ...] = ()
    torsion: bool = False
    bounds: Mapping[str, tuple[float, float]] | None = None
    smoothing: Mapping[str, float] | None = None
    true: Recording | None = None

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the parameters to estimate."""
        return tuple(p.name for p in self.model.parameters if not p.fixed or p.name in self.freed)

    @property
    def measured(self) -> Recording:
        """What a method sees."""
        names = (*self.labels, *(n for n in self.model.input_names if n in self.recording))
        return Recording(self.recording.time, {n: self.recording[n] for n in names})

    @property
    def states(self) -> Array:
        """All states, shape (T, n), without noise."""
        source = self.true or self.recording
        return np.column_stack([source[n] for n in self.model.state_names])

    def start(self, seed: int, factor: float = FACTOR) -> dict[str, float]:
        """Start values of the free parameters, each off by up to `factor`, within the case's bounds."""
        rng, log = np.random.default_rng(seed), np.log(factor)
        values = {n: self.truth[n] * float(np.exp(log * rng.uniform(-1.0, 1.0))) for n in self.free}
        for name, (lower, upper) in (self.bounds or {}).items():
            values[name] = float(np.clip(values[name], lower, upper))
        return values

    def only(self, labels: tuple[str, ...], torsion: bool = False, samples: int | None = None) -> Case:
        """The same with other labels, or with the first samples alone."""
        count = samples or len(self.recording)
        true = self.true.slice(0, count) if self.true is not None else None
        return replace(self, labels=labels, torsion=torsion, recording=self.recording.slice(0, count), true=true)


def _step(name: str, samples: int) -> Case:
    model = build(name)
    time = np.arange(samples) * PERIOD_S
    recording = simulate(model, time, {"voltage": np.full(samples, STEP_V)})
    smoothing = dict.fromkeys(model.smoothing.values(), SMOOTHING)
    return Case(name, model, recording, model.state_names, model.values(), smoothing=smoothing)


def model_1(samples: int = 700) -> Case:
    """The motor (Tables I and II, Fig. 6)."""
    return _step("dc_motor", samples)


def model_3(samples: int = 500) -> Case:
    """The joint with its electrical circuit (Tables III and IV, Figs 4 and 7)."""
    return replace(_step("electromechanical", samples), freed=("c_b",), torsion=True, bounds={"tau_fm": (0.040, 0.055)})


def noisy(case: Case, seed: int = 0) -> Case:
    """The same motion as sensors of a good laboratory see it."""
    shown = SENSORS.measure(case.recording, seed, keep=(*case.labels, "voltage"))
    return replace(case, recording=shown, true=case.recording, smoothing=None)


def stiff() -> Case:
    """Model 3 with a tenth of the inductance, so that its electrical time constant is a tenth of a sample."""
    model = build("electromechanical")
    truth = model.values({"L": 0.1 * model.values()["L"]})
    time = np.arange(1000) * PERIOD_S
    voltage = np.repeat([STEP_V, -STEP_V], 500)
    true = simulate(model, time, {"voltage": voltage}, truth)
    return noisy(Case("electromechanical, L/10", model, true, model.state_names, truth))


def model_2(seed: int = 0) -> Case:
    """A UR3e joint with the values of Table V (H-PINN column): RTDE rate, its encoders and noise of the current.

    All four states are given to the methods, since the paper had both encoders.
    """
    model = build("harmonic_drive")
    time = np.arange(round(UR_SECONDS * UR_RATE)) / UR_RATE
    true = simulate_closed_loop(
        model, PositionController(), position_reference(), time, torque_noise=TORQUE_NOISE, seed=seed
    )
    robot = ur_robot_sensors()
    sensors = replace(robot, noise={**robot.noise, "link_velocity": SENSORS.noise["link_velocity"]})  # not of the robot
    recording = sensors.measure(true, seed, keep=(*model.state_names, "torque"))
    return Case("harmonic_drive", model, recording, model.state_names, model.values(), true=true)


def ur3e_log(folder: Path) -> Recording | None:
    """The base-to-shoulder log of a public UR3e data set, where it is present (see docs/tutorials/ur_robots.md)."""
    path = folder / "ur3e" / "wave_currentData_100v_40a.csv"
    return _log(path) if path.exists() else None


def _log(path: Path) -> Recording:
    rows = np.genfromtxt(path, names=True)
    channels = {"link_position": rows["actual_q_1"], "motor_velocity": 101.0 * rows["actual_qd_1"]}
    return Recording(rows["timestamp"], {**channels, "current": rows["actual_current_1"]})
