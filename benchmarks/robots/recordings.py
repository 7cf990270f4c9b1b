"""Public recordings beside the project as `Recording` objects, in SI units and at the link unless it says otherwise."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import scipy

from joint_id_core.arm.description import Description
from joint_id_core.arm.loaded import loaded
from joint_id_core.data.recording import Array, Recording

DATA = Path(__file__).resolve().parents[3] / "shared/data"
UR10E_NM_PER_A = {1: 11.8, 2: 12.0, 3: 9.8, 4: 10.7, 5: 10.6, 6: 10.7}  # config/ur10e.yaml times the gear ratio of 101
UR10E_ALL = ("ur-20_02_12-40sec_12harm", "ur-20_02_12-50sec_12harm", "ur-20_02_19_14harm50sec")
RATIO = 101.0  # of both UR robots
UR3E_NM_PER_A = RATIO * 0.1005  # of a UR5e of the same series: the maker's calibration
UR3E_MOTOR_NM_PER_A = (0.1005, 0.1005, 0.0802, 0.08, 0.08, 0.08)  # by joint; rough for wrists
KUKA_PERIOD_S = 0.004


@cache
def _columns(path: Path) -> Array:
    table = np.genfromtxt(path, delimiter=",")
    return np.asarray(table[np.concatenate([[True], np.diff(table[:, 0]) > 0.0])])  # some stamps repeat


def ur10e(name: str, joint: int, load: bool = False) -> Recording:
    """A log of joint 1 to 6 of a UR10e; with `load`, the controller's `target_moment` is the load of the arm."""
    table = _columns(DATA / f"ur10e/{name}.csv")
    channels = {"link_position": table[:, joint], "torque": UR10E_NM_PER_A[joint] * table[:, 12 + joint]}
    if load:
        channels["external_torque"] = table[:, 24 + joint]
    return Recording(table[:, 0], channels, source=name)


def ur10e_both_sides(name: str, joint: int) -> Recording:
    """The same log with the velocity of the motor, and the torque at the motor."""
    table, link = _columns(DATA / f"ur10e/{name}.csv"), ur10e(name, joint)
    channels = {
        "link_position": link["link_position"], "motor_velocity": RATIO * table[:, 6 + joint],
        "torque": link["torque"] / RATIO,
    }  # fmt: skip
    return Recording(link.time, channels, source=name)


def ur10e_of_arm(joint: int) -> list[Recording]:
    """The logs in which all joints move, of one of them, with the load that the robot's description gives."""
    description = Description.read(DATA / "ur10e/ur10e.urdf")
    records = []
    for name in UR10E_ALL:
        arm = {one: replace(ur10e(name, k), joint=one) for k, one in enumerate(description.joints, 1)}
        records.append(arm)
    return list(loaded(description, description.joints[joint - 1], records).recordings)


def ur3e_shoulder() -> Recording:
    """The log of the shoulder of a UR3e; its gaps are real."""
    path = DATA / "ur3e/wave_currentData_100v_40a.csv"
    table = np.genfromtxt(path, names=True)
    channels = {"link_position": table["actual_q_1"], "torque": UR3E_NM_PER_A * table["actual_current_1"]}
    return Recording(table["timestamp"], channels, source=path.stem)


def ur3e_both_sides(joint: int) -> Recording:
    """Joint 0 to 5 of the same log with the velocity of the motor, and the torque at the motor."""
    path = DATA / "ur3e/wave_currentData_100v_40a.csv"
    table = np.genfromtxt(path, names=True)
    channels = {
        "link_position": table[f"actual_q_{joint}"], "motor_velocity": RATIO * table[f"actual_qd_{joint}"],
        "torque": UR3E_MOTOR_NM_PER_A[joint] * table[f"actual_current_{joint}"],
    }  # fmt: skip
    return Recording(table["timestamp"], channels, source=path.stem)


def emps(name: str = "DATA_EMPS") -> Recording:
    """A log of the linear axis EMPS: m, N."""
    record = scipy.io.loadmat(DATA / f"emps/{name}.mat")
    force = record["vir"].ravel() * record["gtau"].item()
    return Recording(record["t"].ravel(), {"link_position": record["qm"].ravel(), "torque": force}, source=name)


def kuka(run: str, axis: int) -> tuple[float, Recording]:
    """Gear ratio, and a run (A or B) of axis 1 to 6 of a KUKA KR300: both encoders, torque at the motor, command."""
    file = scipy.io.loadmat(
        DATA / f"kuka_kr300/trajectory_{run}.mat", squeeze_me=True, struct_as_record=False,
        variable_names=["rec", "para"],
    )  # fmt: skip
    recorded, ratio = file["rec"], float(file["para"].u[axis - 1])
    motor, link, torque, command = (
        np.asarray(getattr(recorded, name)[axis - 1], dtype=float)
        for name in ("act_pos_mot_deg", "act_pos_se_deg", "act_torque_abs_nm", "ref_pos_deg")
    )
    channels = {
        "motor_position": ratio * np.deg2rad(motor), "link_position": np.deg2rad(link), "torque": torque,
        "reference_position": np.deg2rad(command),
    }  # fmt: skip
    return ratio, Recording(KUKA_PERIOD_S * np.arange(len(motor)), channels, source=f"run {run}, axis {axis}")


def parts(recording: Recording, count: int) -> list[Recording]:
    """Stretches of equal length, one after the other."""
    size = len(recording) // count
    return [recording.slice(k * size, (k + 1) * size) for k in range(count)]
