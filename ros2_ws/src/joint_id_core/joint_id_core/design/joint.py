"""Design of a motion of one joint, and what a fit of any motion of it will tell."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.design.design import Design, Expected
from joint_id_core.design.elementary import cannot_show
from joint_id_core.design.foresight import GUESS, Foresight
from joint_id_core.design.fourier_shapes import FourierShapes
from joint_id_core.design.limits import JointLimits, violations
from joint_id_core.design.search import Candidate, Search, Shapes
from joint_id_core.design.strokes import PART, SMALL, small_strokes
from joint_id_core.design.trajectory import Trajectory
from joint_id_core.design.trial import Promise, promise
from joint_id_core.design.waypoint_shapes import WaypointShapes
from joint_id_core.design.waypoints import Waypoints
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.innovations.verdicts import Shown
from joint_id_core.estimators.shared.sentences import listed, sentence
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.models import Model
from joint_id_core.options import Progress
from joint_id_core.results.verdict import Verdict
from joint_id_core.simulation.sensors import Sensors

REACH = 1.0  # rad from home, as far as a joint goes where nothing else is said
RATE = 500.0  # Hz, of control and recording: that of e-Series robots
LEAST_S, MOST_S = 2.0, 120.0  # lengths of a motion
LEAST_HZ, MOST_HZ = 50.0, 1e4  # of control and recording
PAIRS, OTHERS = 3, 1  # pairs of joints for a promise, and their seed: none of those that the motion was chosen for
OPEN = (Verdict.NOT_EXCITED, Verdict.PRIOR)  # verdicts on parameters that a motion does not show


def design_joint(
    model: Model,
    limits: JointLimits,
    settings: ParameterSettings | None = None,
    time: float = 20.0,
    show: Sequence[str] = (),
    criterion: str = "sigma",
    home: float | None = None,
    reach: float = REACH,
    rate: float = RATE,
    sensors: Sensors | None = None,
    progress: Progress = lambda _: None,
    waypoints: Waypoints | None = None,
) -> Design:
    """Find a motion of one joint that shows its parameters, and tell what a fit of it will know.

    Args:
        model: that will be fitted, from `models.build`.
        limits: of this joint alone.
        settings: of the fit; the values are what is believed of the joint. For `motor_side` they may hold those of the
            link, which that model does not have (J_q, c_q, tau_fq, a_g, b_g).
        time: length of the motion in s.
        show: parameters that the motion is for; () for all that are estimated, but for offsets of a recording.
        criterion: what is least: "sigma", the geometric mean of the standard deviations; "D", the volume of their
            ellipsoid; "A", the sum of the variances.
        home: position at the start and end in rad; None takes the middle of the limits.
        reach: the farthest from home, in rad.
        rate: of control and recording in Hz.
        sensors: of the robot; None takes those of a UR robot.
        progress: called with a line of text from time to time.
        waypoints: in which all other joints stand. The motion goes through them, from the first one and back to it, in
            place of a Fourier series; `home` and `reach` say nothing then.

    Raises:
        JointIdError: limits that are missing or leave no room, a motion that is too short, unknown names, a model that
            no controller can move (one with a voltage as input), waypoints that the limits do not allow.
    """
    settings = settings or ParameterSettings()
    if not LEAST_S <= time <= MOST_S:
        raise JointIdError(f"a motion of {time:g} s: give {LEAST_S:g} to {MOST_S:g} s")
    if not LEAST_HZ <= rate <= MOST_HZ:
        raise JointIdError(
            f"rate = {rate:g} Hz: give {LEAST_HZ:g} Hz or more, what the robot is controlled and recorded with, and no "
            f"more than {MOST_HZ:g}"
        )
    foresight = Foresight(model, settings, rate, sensors)
    names = tuple(show) or tuple(n for n in foresight.free if not model.parameter(n).of_recording)
    if waypoints is None:
        own, added = _within(limits, home, reach)
        at = (float(own.lower[0]) + float(own.upper[0])) / 2.0 if home is None else home
        shapes: Shapes = FourierShapes(own, at, time, rate)
    else:
        own, added = _one(limits).completed()
        shapes = through = WaypointShapes(waypoints.of_one(own.names[0]), own, time, rate)
        own = replace(own, lower=through.lower, upper=through.upper)  # what simple motions show is said of such in them
        at = float(own.lower[0])
    search = Search(foresight, shapes, own, time, names, criterion)
    progress("compiling, where that was not done before")
    best = search.run(progress)
    progress("telling what it will show")
    trajectory = search.trajectory(best, own.names[0])
    if broken := violations(trajectory, own):
        raise JointIdError(f"the motion that was found breaks a limit, which is a fault of this program: {broken[0]}")
    found = foretell(foresight, trajectory, _larger(search, best), best.held)
    how = (_held(limits, own, best), *shapes.told(best.shape, best.scale))
    return replace(found, notes=(*how, *found.notes, *cannot_show(search, at), *added))


def foretell(foresight: Foresight, trajectory: Trajectory, larger: Array | None = None, held: str = "") -> Design:
    """Tell what a fit of a motion of one joint will know of it.

    Args:
        foresight: of the joint; the motion is sampled at its rate.
        trajectory: of one joint.
        larger: covariance (k, k) of a fit of a larger motion, which would break the limit `held`; None if not known.

    Raises:
        JointIdError: the motion is too small or too short for a fit, or moves several joints.
    """
    joint = trajectory.names[0]
    if len(trajectory.names) > 1:
        raise JointIdError(f"this motion moves {', '.join(trajectory.names)}: give one joint alone")
    instants = np.arange(math.floor(trajectory.duration * foresight.rate + 1e-9) + 1) / foresight.rate
    state = trajectory.at(instants)
    position, velocity = (np.ascontiguousarray(part[:, 0]) for part in (state.position, state.velocity))
    told = promise(foresight, foresight.joints(PAIRS, OTHERS)[1:], position, velocity)
    covariance = told.covariance
    rows = foresight.verdicts(covariance, position, velocity)
    more = {} if larger is None else foresight.verdicts(larger, position, velocity)
    slope = foresight.coordinates.slope(
        foresight.coordinates.z(np.array([foresight.values[n] for n in foresight.free]))
    )
    deviation = dict(zip(foresight.free, (np.sqrt(np.diag(covariance)) * slope).tolist(), strict=True))
    expected = tuple(
        Expected(
            joint, p.name, p.unit, foresight.values[p.name], deviation.get(p.name, math.nan), rows[p.name].verdict,
            _reason(rows[p.name], more.get(p.name), held),
        )
        for p in foresight.model.parameters
    )  # fmt: skip
    return Design(trajectory, expected, (*_unforeseen(position, velocity), *_assumed(foresight, told)))


def _within(limits: JointLimits, home: float | None, reach: float) -> tuple[JointLimits, tuple[str, ...]]:
    """Return the limits of the one joint, no farther from home than `reach`, and what was added to them."""
    if not 0.0 < reach < math.inf:
        raise JointIdError(f"reach = {reach:g} rad: give a number above 0")
    own, added = _one(limits).completed()
    at = (float(own.lower[0]) + float(own.upper[0])) / 2.0 if home is None else home
    if not own.lower[0] < at < own.upper[0]:
        raise JointIdError(
            f"home = {at:g} rad is not between the limits {own.lower[0]:g} and {own.upper[0]:g} rad of {own.source}"
        )
    return replace(own, lower=np.maximum(own.lower, at - reach), upper=np.minimum(own.upper, at + reach)), added


def _one(limits: JointLimits) -> JointLimits:
    """Return the limits if they are those of one joint."""
    if len(limits.names) != 1:
        raise JointIdError(f"limits of {', '.join(limits.names)}: give those of one joint")
    return limits


def _larger(search: Search, best: Candidate) -> Array | None:
    """Return the covariance that a fit of a larger motion would have, were there no limits."""
    moved = search.shapes.beyond(best.shape, best.scale)
    try:
        return None if moved is None else search.foresight.see(search.joints[0], *moved).covariance
    except JointIdError:
        return None


def _reason(shown: Shown, more: Shown | None, held: str) -> str:
    """Return why a motion does not show a parameter, and what would; empty if it shows it."""
    if shown.verdict not in OPEN:
        return ""
    if shown.together or more is None:
        return shown.reason
    if more.verdict is Verdict.ESTIMATED:
        return f"{shown.reason}; a motion of twice the size would show it, which the limit of {held} does not allow"
    return f"{shown.reason}; a motion of twice the size would not show it either: hold it, or measure more"


def _held(limits: JointLimits, own: JointLimits, best: Candidate) -> str:
    """Say which limit holds the motion, and where it is from: of those that were given, or of `own`, made of them."""
    source = limits.source
    if best.held == "position" and (own.lower[0] > limits.lower[0] or own.upper[0] < limits.upper[0]):
        source = "how far it may go from home"
    elif best.held in ("acceleration", "jerk") and not np.isfinite(getattr(limits, best.held)[0]):
        source = "assumed, as none is given"
    return sentence(f"the limit of {best.held} holds this motion ({source})")


def _unforeseen(position: Array, velocity: Array) -> tuple[str, ...]:
    """Say where a motion (T,) is one of which no promise can be kept."""
    part = small_strokes(position, velocity)
    if part < PART:
        return ()
    told = (
        f"{part:.0%} of the motion goes there and back within {SMALL:g} rad: what a fit makes of friction there is not "
        "foreseen, and errors were up to 7 times as large as promised; take larger or slower strokes"
    )
    return (sentence(told),)


def _assumed(foresight: Foresight, told: Promise) -> tuple[str, ...]:
    """Say what a promise rests on."""
    measured = [name for name in foresight.measured if name in foresight.sensors.noise]
    noise = listed([f"{name} {foresight.sensors.noise[name]:.2g}" for name in measured])
    notes = [
        f"the torque at the joint reaches {told.torque:.3g} Nm, if nothing else moves and the tool does not change",
        f"noise of the sensors, in SI units: {noise}; {foresight.rate:g} samples a second",
        "torque that no law of friction explains is not foreseen: it leaves friction of real robots known to 1 to 5 %, "
        "however fine the sensors are",
        f"the standard deviations are those of joints whose values are off by about {GUESS:.0%}, or as --prior says",
    ]
    if told.failed:
        notes.append(
            f"{told.failed} of {told.tried} trial fits of such joints found nothing: the values may be far off"
        )
    link = {n: v for n, v in foresight.link.items() if n not in foresight.values and v and not n.startswith("w_s")}
    if link:
        values = listed([f"{name} {value:.4g}" for name, value in link.items()])
        notes.append(f"the link is taken with {values}: give what it has with --set")
    notes.append("nothing is known of what the arm could hit: look at the motion before the robot makes it")
    return tuple(sentence(note) for note in notes)
