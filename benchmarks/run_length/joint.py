"""The drift monitor behind the online identifier: Model 2 under position control with the signals of a UR robot."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from joint_id_core.data.recording import Array, Recording
from joint_id_core.models import build
from joint_id_core.online.drift import DriftMonitor, DriftOptions
from joint_id_core.online.identifier import OnlineIdentifier, OnlineOptions
from joint_id_core.results.estimate import Estimate, Verdict
from joint_id_core.simulation.excitation import position_reference
from joint_id_core.simulation.minimum_jerk import minimum_jerk
from joint_id_core.simulation.position_control import PositionController
from joint_id_core.simulation.simulator import JointSimulator

MODEL = build("harmonic_drive")
TRUTH = MODEL.values()
RATE = 500
BATCH = 50  # samples of one update
POSITION, VELOCITY, TORQUE = 1e-5, 0.1, 0.003  # noise: link in rad, motor in rad/s, torque that acts in Nm
BASELINE_S = 60.0  # motion before the baseline
FRICTION, STIFFNESS = ("c_m", "tau_fm", "c_q", "tau_fq"), ("k_1",)
KINDS = {"friction": FRICTION, "k_1": STIFFNESS}
MOTIONS = ("multisine", "point to point")
MOVE_S, REST_S = 1.0, 0.5  # of the motion from point to point

Chart = tuple[float, float, float]  # tolerance, threshold, and time in s of the confirmation


@dataclass(frozen=True)
class Watched:
    """A joint that does not change.

    Attributes:
        hours: of motion after the baseline, one parameter counted once.
        z: errors over standard deviations of all estimates, shape (estimates, parameters), NaN where not estimated.
        alarms: by chart, of all parameters together.
        names: of the parameters.
    """

    hours: float
    z: Array
    alarms: dict[Chart, int]
    names: tuple[str, ...]


def reference(kind: str, seconds: float, seed: int) -> tuple[Array, Array]:
    """Position in rad and velocity in rad/s that the controller is asked for, shape (T,) each."""
    time = np.arange(round(seconds * RATE)) / RATE
    if kind == "multisine":
        return position_reference().value(time), position_reference().rate(time)
    rng = np.random.default_rng([seed, 9])
    length = MOVE_S + REST_S
    points = rng.uniform(-1.0, 1.0, math.ceil(seconds / length) + 1)
    which, at = (time // length).astype(int), np.clip((time % length) / MOVE_S, 0.0, 1.0)
    away = points[which + 1] - points[which]
    share, rate = minimum_jerk(at)
    return points[which] + away * share, away * rate / MOVE_S


@dataclass(frozen=True)
class Course:
    """Parameters `names` grow by the share `change` of their values from `at_s` on, within `rise_s`."""

    names: tuple[str, ...] = ()
    change: float = 0.0
    at_s: float = math.inf
    rise_s: float = 0.0

    def values(self, time_s: float) -> dict[str, float]:
        """Values of the parameters that differ from the truth at the begin."""
        passed = time_s - self.at_s
        if passed < 0.0:
            return {}
        share = min(1.0, passed / self.rise_s) if self.rise_s else 1.0
        return {name: (1.0 + share * self.change) * TRUTH[name] for name in self.names}


def samples(kind: str, seconds: float, seed: int, course: Course) -> Iterator[Recording]:
    """Signals of a joint in batches. The controller reads the sensors."""
    q_ref, dq_ref = reference(kind, seconds, seed)
    controller, gear = PositionController(), TRUTH["N"]
    joint = JointSimulator(MODEL, None, {"link_position": q_ref[0], "motor_position": q_ref[0] * gear})
    noise = np.random.default_rng(seed).standard_normal((len(q_ref), 3)) * (POSITION, VELOCITY, TORQUE)
    rows, values = np.empty((BATCH, 3)), dict[str, float]()
    for k in range(len(q_ref)):
        if k % BATCH == 0 and (now := course.values(k / RATE)) != values:
            joint, values = JointSimulator(MODEL, now, joint.state), now
        state = joint.state
        q, w = state["link_position"] + noise[k, 0], state["motor_velocity"] + noise[k, 1]
        torque = controller.torque(float(q_ref[k]), float(dq_ref[k]), q, w / gear)
        rows[k % BATCH] = q, w, torque
        joint.advance(1.0 / RATE, {"torque": torque + noise[k, 2]})
        if k % BATCH == BATCH - 1:
            names = ("link_position", "motor_velocity", "torque")
            time = np.arange(k - BATCH + 1, k + 1) / RATE
            yield Recording(time, {name: rows[:, j].copy() for j, name in enumerate(names)})


def estimates(kind: str, seconds: float, seed: int, course: Course) -> Iterator[Estimate]:
    """Estimates of the online identifier with its defaults."""
    identifier = OnlineIdentifier(MODEL, options=OnlineOptions())
    for batch in samples(kind, seconds, seed, course):
        estimate = identifier.update(batch)
        if estimate is not None:
            yield estimate


def monitor(baseline: Estimate, chart: Chart) -> DriftMonitor:
    """A drift monitor with these options."""
    return DriftMonitor(baseline, DriftOptions(*chart))


def unchanged(kind: str, seconds: float, charts: Sequence[Chart], seed: int) -> Watched:
    """Watch a joint that does not change; the baseline is the estimate after `BASELINE_S`."""
    monitors: dict[Chart, DriftMonitor] = {}
    told: dict[Chart, set[str]] = {chart: set() for chart in charts}
    alarms = dict.fromkeys(charts, 0)
    z, first = [], math.nan
    end = math.nan
    names = tuple(row.name for row in MODEL.parameters if not row.fixed)
    for estimate in estimates(kind, seconds, seed, Course()):
        if not estimate.converged:
            continue
        if not monitors:
            if estimate.end < BASELINE_S:
                continue
            monitors, first = {chart: monitor(estimate, chart) for chart in charts}, estimate.end
        end = estimate.end
        rows = {row.name: row for row in estimate.parameters if row.verdict is Verdict.ESTIMATED}
        z.append([(rows[n].value - TRUTH[n]) / rows[n].std_dev if n in rows else math.nan for n in names])
        for chart, one in monitors.items():
            now = {drift.name for drift in one.update(estimate)}
            alarms[chart] += len(now - told[chart])
            told[chart] = now
    moving = 1.0 if kind == "multisine" else MOVE_S / (MOVE_S + REST_S)
    return Watched(moving * (end - first) / 3600.0, np.array(z), alarms, names)


def delays(course: Course, charts: Sequence[Chart], longest_s: float, seed: int) -> dict[Chart, float]:
    """Time in s until a changed parameter is reported, from the instant at which the truth leaves the tolerance.

    inf where that takes longer than `longest_s`, or where nothing leaves the tolerance and nothing is reported.
    """
    left_s = {chart: course.at_s + course.rise_s * min(1.0, chart[0] / course.change) for chart in charts}
    monitors: dict[Chart, DriftMonitor] = {}
    found = dict.fromkeys(charts, math.inf)
    for estimate in estimates("multisine", course.at_s + course.rise_s + longest_s, seed, course):
        if not monitors:
            if estimate.converged and estimate.end >= BASELINE_S:
                monitors = {chart: monitor(estimate, chart) for chart in charts}
            continue
        for chart, one in monitors.items():
            drifted = {drift.name for drift in one.update(estimate)}
            if estimate.end > course.at_s and drifted & set(course.names) and math.isinf(found[chart]):
                found[chart] = estimate.end - left_s[chart]
        if all(map(math.isfinite, found.values())):
            break
    return found


def delay_job(charts: Sequence[Chart], longest_s: float, job: tuple[str, float, float, int]) -> dict[Chart, float]:
    """`delays` of a kind of change, its size, its duration and a seed."""
    kind, change, rise_s, seed = job
    # it begins anywhere in a hop and in a period of the motion
    at_s = BASELINE_S + float(np.random.default_rng([seed, 7]).uniform(1.0, 5.0))
    return delays(Course(KINDS[kind], change, at_s, rise_s), charts, longest_s, seed)


def unchanged_job(seconds: float, charts: Sequence[Chart], job: tuple[str, int]) -> Watched:
    """`unchanged` of a kind of motion and a seed."""
    kind, seed = job
    return unchanged(kind, seconds, charts, seed)
