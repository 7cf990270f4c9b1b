"""A UR10e that is followed while it works: its logs one after the other, one of them with a payload."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from joint_id_core.arm.arm_estimate import ArmEstimate
from joint_id_core.arm.beforehand import Beforehand
from joint_id_core.arm.changes import PAYLOAD
from joint_id_core.arm.description import Description
from joint_id_core.arm.fit import fit_arm
from joint_id_core.arm.follower import ArmFollower
from joint_id_core.arm.joint_estimates import joint_estimates, payload
from joint_id_core.arm.regressor import Regressor
from joint_id_core.arm.stream import ArmStream
from joint_id_core.data.recording import Recording
from robots.recordings import DATA, UR10E_ALL
from robots.whole_arm import LOADED, MASS, record

SHORT, MIDDLE, LONG = UR10E_ALL
NAMES = {SHORT: "40 s", MIDDLE: "50 s", LONG: "14 harmonics", LOADED: "payload"}
ORDERS = ((SHORT, MIDDLE, LONG, LOADED, LONG), (MIDDLE, LOADED, SHORT), (LONG, LOADED, MIDDLE), (SHORT, LONG, LOADED))
PAUSE_S = 2.0  # between two logs
BATCH_S = 0.1  # of samples that come together
Arm = Mapping[str, Recording]


@dataclass(frozen=True)
class Run:
    """One sequence of logs.

    Attributes:
        logs: their names.
        found_s, gone_s: motion in s from the begin of a log until its payload, or the end of it, was told; NaN if not.
        mass: of the payload at the end of its log, and its standard deviation, in kg.
        off: largest distance of damping and friction from those of a fit of all logs, in combined standard deviations.
        frictions: number of changes of a friction that were told.
        payloads: number of changes of the payload that were told.
        share: processor time over the time of the logs.
    """

    logs: tuple[str, ...]
    found_s: float
    gone_s: float
    mass: tuple[float, float]
    off: float
    frictions: int
    payloads: int
    share: float


def runs() -> list[Run]:
    """Follow the arm through every sequence."""
    description = Description.read(DATA / "ur10e/ur10e.urdf")
    gains = {name: {"torque": 1.0} for name in description.joints}
    records = {name: record(name, description.joints) for name in NAMES}
    whole = fit_arm(description, [records[name] for name in UR10E_ALL], gains, payload=[records[LOADED]])
    return [_follow(description, [(name, records[name]) for name in order], whole) for order in ORDERS]


def _follow(description: Description, logs: Sequence[tuple[str, Arm]], whole: ArmEstimate) -> Run:
    regressor = Regressor(description)
    stream = ArmStream(regressor, {name: {"torque": 1.0} for name in description.joints}, "ur10e")
    beforehand = Beforehand.of(regressor)
    follower = ArmFollower(description.joints, description.mass, beforehand=beforehand, description=description)
    begin, cpu_s, mass, told = 0.0, 0.0, (float("nan"), float("nan")), {"found": [], "gone": []}
    frictions = payloads = 0
    for name, arm in logs:
        shifted, length = _after(arm, begin)
        motion, step = 0.0, max(1, round(BATCH_S / next(iter(arm.values())).period))
        for k in range(0, length, step):
            at = time.process_time()
            for part in stream.push({n: r.slice(k, k + step) for n, r in shifted.items()}):
                motion += part.duration
                before = dict(follower.changes)
                if follower.add(part) and follower.belief is not None:
                    stream.know(follower.belief.values, follower.belief.carries)
                new = [what for what, change in follower.changes.items() if before.get(what) is not change]
                payloads, frictions = payloads + (PAYLOAD in new), frictions + len(set(new) - {PAYLOAD})
                if PAYLOAD in new:
                    told["found" if name == LOADED else "gone"].append(motion)
            cpu_s += time.process_time() - at
        if name == LOADED and (found := payload(follower, regressor)) is not None:
            mass = found.mass, found.mass_std_dev
        begin = max(float(r.time[-1]) for r in shifted.values()) + PAUSE_S
    found_s, gone_s = (told[kind][0] if told[kind] else float("nan") for kind in ("found", "gone"))
    off = _off(follower, regressor, whole)
    return Run(tuple(name for name, _ in logs), found_s, gone_s, mass, off, frictions, payloads, cpu_s / begin)


def _after(arm: Arm, begin: float) -> tuple[dict[str, Recording], int]:
    """Return a log that begins at an instant, and its number of samples."""
    first = min(float(r.time[0]) for r in arm.values())
    return {n: replace(r, time=r.time - first + begin) for n, r in arm.items()}, max(len(r) for r in arm.values())


def _off(follower: ArmFollower, regressor: Regressor, whole: ArmEstimate) -> float:
    found = joint_estimates(follower, regressor, "ur10e")
    distances = []
    for joint in whole.joints:
        for name, value in (("c", joint.damping), ("tau_f", joint.friction)):
            row = found[joint.name][name]
            distances.append(abs(row.value - value.value) / float(np.hypot(row.std_dev, value.std_dev)))
    return max(distances)


def table(found: Sequence[Run]) -> str:
    """A row a sequence."""
    head = ["logs", f"payload of {MASS} kg told after", "mass", "its end told after", "changes of friction told",
            "friction off", "of a core"]  # fmt: skip
    lines = ["| " + " | ".join(head) + " |", "| " + " | ".join("---" for _ in head) + " |"]
    for run in found:
        gone = f"{run.gone_s:.1f} s" if run.gone_s == run.gone_s else "-"
        cells = [", ".join(NAMES[name] for name in run.logs), f"{run.found_s:.1f} s",
                 f"{run.mass[0]:.3g} ± {run.mass[1]:.2g} kg", gone, str(run.frictions), f"{run.off:.2g}",
                 f"{100.0 * run.share:.2g} %"]  # fmt: skip
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)
