"""Public logs of robots with which joint_id was not made: what its default finds, beside what was published.

    setup/run python benchmarks/other_robots.py --data CLONES --docs

The logs are no part of the project. CLONES holds clones of the repositories that `FROM` names, and the descriptions
`panda.urdf` and `ur10_robot.urdf` of the package example-robot-data; what is not there is skipped.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from peers.process import SINGLE_CORE

os.environ.update(SINGLE_CORE)  # times are processor times: libraries read this when they are imported

import numpy as np
from measured_blocks import write
from robots.pages import table

from joint_id_core import formats
from joint_id_core.arm.arm_estimate import ArmEstimate
from joint_id_core.arm.description import Description
from joint_id_core.arm.fit import fit_arm
from joint_id_core.data.recording import Array, Recording
from joint_id_core.estimators import fit
from joint_id_core.models import build

FROM = {
    "Stäubli TX40": "figaroh-examples", "Franka Panda": "FrankaEmikaPandaDynModel", "AIRBOT Play": "figaroh_kinova",
    "UR10": "inverse-dynamics-solver",
}  # fmt: skip
# Of TX40_config.yaml there: Nm s/rad and Nm at the link, and ratios of the gears; joints 5 and 6 are coupled.
TX40 = {1: (8.05, 7.14, 32), 2: (5.53, 8.26, 32), 3: (1.97, 6.34, 45), 4: (1.11, 2.48, 48)}
TX40_STEP_S = 0.0002
# Of get_FrictionTorque.m (Gaz et al., IEEE RA-L 4, 2019): A / (1 + exp(-a (dq + b))) less its value at rest.
PANDA_A = (0.54615, 0.87224, 0.64068, 1.2794, 0.83904, 0.30301, 0.56489)
PANDA_SLOPE = (5.1181, 9.0657, 10.136, 5.5903, 8.3469, 17.133, 10.336)
PANDA_OFFSET = (0.039533, 0.025882, -0.04607, 0.036194, 0.026226, -0.021047, 0.0035526)
AT = 0.5  # rad/s, at which friction of different laws is compared
AIRBOT_STEP_S = 0.01
AIRBOT = "examples/airbot_play/data"
JOINT_STATES = {"link_position": "joint_states.position", "torque": "joint_states.effort"}


@dataclass(frozen=True)
class Arm:
    """An arm, with a log that is fitted and perhaps another one that is predicted; joints by name."""

    robot: str
    description: Description
    fitted: Mapping[str, Recording]
    held_out: Mapping[str, Recording] | None = None


def tx40(clones: Path) -> dict[int, Recording]:
    """Joints 1 to 4, at the link."""
    folder = clones / FROM["Stäubli TX40"] / "examples/staubli_TX40/data"
    angle, torque = (_columns(folder / name) for name in ("pos_read_data.csv", "curr_data.csv"))
    instants = TX40_STEP_S * np.arange(len(angle))
    channels = {
        k: {"link_position": angle[:, k - 1] / ratio, "torque": torque[:, k - 1] * ratio}
        for k, (_, _, ratio) in TX40.items()
    }
    return {k: Recording(instants, own, source=f"TX40, joint {k}") for k, own in channels.items()}


def panda(clones: Path) -> Arm:
    """All seven joints; torques of the link sensors."""
    folder = clones / FROM["Franka Panda"] / "matlab/data/Exciting_Traj/Trajectory_1/rbt_log"
    instants = np.loadtxt(folder / "exciting_traj_time.txt")
    q, torque = (np.loadtxt(folder / f"exciting_traj_{name}.txt").reshape(-1, 7) for name in ("positions", "torques"))
    description = Description.read(clones / "panda.urdf", still=["panda_finger_joint1"])
    return Arm("Franka Panda", description, _by_name(description, instants, q, torque, "Panda"))


def airbot(clones: Path) -> Arm:
    """All six joints, a chirp, and trapezoidal moves that are held out."""
    folder = clones / FROM["AIRBOT Play"] / AIRBOT
    description = Description.read(folder / "urdf/airbot_play_v3_0_gripper.urdf")
    logs = []
    for motion in ("chirp", "trapezoidal"):
        place = folder / f"identification/{motion}_motion"
        q, torque = (_columns(place / f"identification_{name}_real.csv") for name in ("q", "tau"))
        instants = AIRBOT_STEP_S * np.arange(len(q))
        logs.append(_by_name(description, instants, q, torque, f"AIRBOT Play, {motion}"))
    return Arm("AIRBOT Play", description, *logs)


def ur10(clones: Path) -> Arm:
    """All six joints, a bag of `/joint_states`."""
    bag = clones / FROM["UR10"] / "ur10_inverse_dynamics_solver/bagfiles/ur10_exciting_trajectory.db3"
    description = Description.read(clones / "ur10_robot.urdf")
    records = formats.read_joints(bag, JOINT_STATES).recordings
    return Arm("UR10", description, {n: r for n, r in records.items() if isinstance(r, Recording)})


def _columns(path: Path) -> Array:
    return np.loadtxt(path, delimiter=",", skiprows=1)


def _by_name(description: Description, instants: Array, q: Array, torque: Array, source: str) -> dict[str, Recording]:
    return {
        name: Recording(instants, {"link_position": q[:, k], "torque": torque[:, k]}, source=source, joint=name)
        for k, name in enumerate(description.joints)
    }


def friction_rows(clones: Path) -> Iterator[list[str]]:
    """Friction of each joint of the TX40 by itself, beside what was published, in combined standard deviations."""
    for k, recording in tx40(clones).items():
        found = fit(build("rigid_joint", gravity=k > 1), recording)
        off = [(found[n].value - TX40[k][i]) / found[n].std_dev for i, n in enumerate(("c", "tau_f"))]
        values = [f"{found[n].value:.3g} ± {found[n].std_dev:.2g}" for n in ("c", "tau_f")]
        c, tau_f, _ = TX40[k]
        yield [
            f"{k}", values[0], f"{c:g}", values[1], f"{tau_f:g}", f"{off[0]:+.1f}, {off[1]:+.1f}",
            f"`{found.status.value}`, {found.estimator}",
        ]  # fmt: skip


def arm_row(arm: Arm) -> tuple[list[str], ArmEstimate]:
    """An arm as a row, and its estimate."""
    gains = {name: {"torque": 1.0} for name in arm.description.joints}
    begun = time.process_time()
    found = fit_arm(arm.description, [arm.fitted], gains, arm.held_out)
    took = time.process_time() - begun
    explained = " ".join(f"{j.r_squared:.4f}" for j in found.joints)
    held_out = " ".join(f"{j.held_out:.4f}" for j in found.joints) if arm.held_out else "-"
    return [arm.robot, explained, held_out, f"`{found.status.value}`", f"{took:.1f} s"], found


def panda_rows(found: ArmEstimate) -> Iterator[list[str]]:
    """Friction of the Panda at `AT`, beside what was published."""
    for k, joint in enumerate(found.joints):
        size, slope, offset = PANDA_A[k], PANDA_SLOPE[k], PANDA_OFFSET[k]
        published = (
            0.5 * size * (1.0 / (1.0 + np.exp(-slope * (AT + offset))) - 1.0 / (1.0 + np.exp(-slope * (offset - AT))))
        )
        value = joint.friction.value + AT * joint.damping.value
        sigma = float(np.hypot(joint.friction.std_dev, AT * joint.damping.std_dev))
        yield [f"{k + 1}", f"{value:.3g} ± {sigma:.2g}", f"{published:.3g}", f"{(value - published) / sigma:+.1f}"]


def main() -> None:
    """Fit what is there, print the tables, and write them into docs/real_robots.md."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--data", type=Path, required=True, help="folder with the clones and descriptions")
    parser.add_argument("--docs", action="store_true", help="write the tables into docs/real_robots.md")
    args = parser.parse_args()
    tables, arms = {}, []
    if (args.data / FROM["Stäubli TX40"]).is_dir():
        head = ["joint", "`c`, Nm s/rad", "published", "`tau_f`, Nm", "published", "sigma off", "status, by"]
        tables["other-tx40"] = table(head, list(friction_rows(args.data)))
    for robot, read in (("Franka Panda", panda), ("UR10", ur10), ("AIRBOT Play", airbot)):
        if not (args.data / FROM[robot]).is_dir():
            print(f"{robot}: skipped, there is no {args.data / FROM[robot]}")
            continue
        row, found = arm_row(read(args.data))
        arms.append(row)
        if robot == "Franka Panda":
            head = ["joint", f"friction at {AT:g} rad/s, Nm", "published", "sigma off"]
            tables["other-panda"] = table(head, list(panda_rows(found)))
    head = ["robot", "R² of the torque, joint by joint", "another motion, held out", "status", "processor time"]
    tables["other-arms"] = table(head, arms)
    print("\n\n".join(tables.values()))
    if args.docs:
        write("real_robots.md", tables)


if __name__ == "__main__":
    main()
