"""Stand-ins for the recordings that commands of the pages name: simulated, with the same names, columns and units."""

from __future__ import annotations

import subprocess
from collections.abc import Callable, Mapping
from pathlib import Path

import joint_states_bag
import numpy as np
import scipy.io

from joint_id_core.data.recording import Array, Recording
from joint_id_core.formats import write_bag
from joint_id_core.models import Model, build
from joint_id_core.simulation.sensors import ur_robot_sensors
from joint_id_core.simulation.simulator import simulate

GEAR = 101.0
LOG_BEGINS = 4385.574  # s, as in the public log of a UR3e


def multisine(time: Array, *parts: tuple[float, float]) -> Array:
    """Sum of sines, each of an amplitude and a frequency in Hz."""
    return np.sum([a * np.sin(2 * np.pi * f * time + k) for k, (a, f) in enumerate(parts)], axis=0)


def noisy(values: Array, deviation: float, seed: int) -> Array:
    """With white noise, and at rest nothing that repeats exactly."""
    return values + deviation * np.random.default_rng(seed).standard_normal(len(values))


def moved(model: Model, time: Array, drive: Array, values: Mapping[str, float]) -> Recording:
    """A joint under a drive that is held between samples."""
    return simulate(model, time, {model.input_names[0]: drive}, values)


def elbow(time: Array) -> Recording:
    """A flexible joint."""
    current = multisine(time, (1.5, 0.8), (1.0, 3.7))
    values = {"k_t": 0.0802, "J_m": 2e-4, "k_1": 6000.0, "k_2": 3e8, "c_1": 30.0}
    return moved(build("harmonic_drive", actuation="current"), time, current, values)


def motion_csv(folder: Path) -> None:
    """motion.csv: a flexible joint, as `joint-id simulate` writes it."""
    _simulate(folder, "harmonic_drive", "--out", "motion.csv", "--duration", "3")


def elbow_bag(folder: Path) -> None:
    """recordings/run1: a bag of the raw topics with the joint `elbow`, as a UR robot shows it."""
    time = np.arange(1500) / 500.0
    shown = ur_robot_sensors(GEAR).measure(elbow(time), keep=("link_position", "motor_velocity", "current"))
    write_bag(folder / "recordings/run1", {"elbow": shown})


def joint_states_current(folder: Path) -> None:
    """run1: a bag of /joint_states whose effort is a current."""
    joint_states_bag.write(folder / "run1", "current")


def joint_states_torque(folder: Path) -> None:
    """run1: a bag of /joint_states whose effort is a torque."""
    joint_states_bag.write(folder / "run1", "torque")


def log_csv(folder: Path) -> None:
    """log.csv: other names and units than ours."""
    time = np.arange(1500) / 500.0
    tau = multisine(time, (40.0, 0.7), (15.0, 2.3))
    motion = moved(build("rigid_joint"), time, tau, {"J": 2.0})
    q_deg = np.rad2deg(noisy(motion["link_position"], 2e-5, 1))
    _table(folder / "log.csv", {"t": time, "q_deg": q_deg, "tau": tau, "gear": np.ones_like(time)}, ",")


def emps(folder: Path) -> None:
    """DATA_EMPS.mat and DATA_EMPS_PULSES.mat: a linear axis."""
    values = {"J": 95.0, "c": 204.0, "tau_f": 20.0, "tau_0": -3.0}
    for name, amplitude in (("DATA_EMPS", 1.0), ("DATA_EMPS_PULSES", 0.8)):
        time = np.arange(600) / 100.0
        voltage = amplitude * multisine(time, (2.0, 0.5), (1.0, 1.7))
        motion = moved(build("rigid_joint"), time, 35.0 * voltage, values)
        columns = {"t": time, "qm": noisy(motion["link_position"], 1e-6, 2), "vir": voltage}
        scipy.io.savemat(folder / f"{name}.mat", {n: v[:, None] for n, v in columns.items()} | {"gtau": 35.0})


def ur3e_log(folder: Path, seconds: float = 31.0) -> None:
    """wave_currentData_100v_40a.csv: a moving shoulder (joint 1) and an elbow (joint 2), separated by spaces."""
    time = np.arange(round(105 * seconds)) / 105.0
    shoulder, flexible = multisine(time, (2.0, 0.3), (0.8, 1.1)), elbow(time)
    rigid = moved(
        build("rigid_joint", actuation="current", gravity=True), time, shoulder,
        {"N": GEAR, "k_t": 0.1, "J": 2.0, "c": 15.0, "tau_f": 5.0, "a_g": 8.0, "b_g": 5.0},
    )  # fmt: skip
    columns = {
        "timestamp": LOG_BEGINS + time,
        "actual_q_1": noisy(rigid["link_position"], 2e-5, 3),
        "actual_q_2": noisy(flexible["link_position"], 2e-5, 4),
        "actual_qd_2": noisy(flexible["motor_velocity"] / GEAR, 1.5e-3, 5),
        "actual_current_1": noisy(shoulder, 0.02, 6),
        "actual_current_2": flexible["current"],
    }
    _table(folder / "wave_currentData_100v_40a.csv", columns, " ")


def short_ur3e_log(folder: Path) -> None:
    """The same log, where no command asks for a certain instant of it."""
    ur3e_log(folder, 8.0)


def fleet(folder: Path) -> None:
    """recordings/ur_1/week1.csv and recordings/ur_2/week1.csv: a joint of two robots."""
    for robot in ("ur_1", "ur_2"):
        (folder / "recordings" / robot).mkdir(parents=True)
        _simulate(folder, "rigid_joint", "--out", f"recordings/{robot}/week1.csv", "--duration", "3")


def _simulate(folder: Path, *arguments: str) -> None:
    subprocess.run(["joint-id", "simulate", *arguments], cwd=folder, check=True, stdout=subprocess.DEVNULL)


def _table(path: Path, columns: Mapping[str, Array], delimiter: str) -> None:
    rows = np.column_stack(list(columns.values()))
    np.savetxt(path, rows, "%.9f", delimiter, header=delimiter.join(columns), comments="")


# What each page finds in its folder.
RECORDINGS: dict[str, tuple[Callable[[Path], None], ...]] = {
    "README.md": (emps,),
    "docs/formats.md": (log_csv, emps, joint_states_torque),
    "docs/nodes/player.md": (elbow_bag,),
    "docs/python.md": (motion_csv,),
    "docs/tutorials/bag.md": (elbow_bag,),
    "docs/tutorials/batch.md": (fleet,),
    "docs/tutorials/compare.md": (emps, short_ur3e_log),
    "docs/tutorials/csv.md": (motion_csv, log_csv),
    "docs/tutorials/ur_robots.md": (joint_states_current, ur3e_log),
    "docs/tutorials/verdicts.md": (motion_csv,),
}
