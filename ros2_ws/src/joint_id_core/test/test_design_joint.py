"""Designed motions of one joint: what is promised is what real fits give, limits are kept, and bad input is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import BPoly

from joint_id_core.cell.kernel import compile_model
from joint_id_core.cell.rollout import rollout
from joint_id_core.design.foresight import Foresight
from joint_id_core.design.fourier_shapes import FourierShapes, Shape
from joint_id_core.design.joint import design_joint, foretell
from joint_id_core.design.limit_files import published
from joint_id_core.design.limits import JointLimits
from joint_id_core.design.plant import as_recorded
from joint_id_core.design.search import Search
from joint_id_core.design.trajectory import Trajectory
from joint_id_core.design.trial import trial_fit
from joint_id_core.design.waypoint_shapes import WaypointShapes
from joint_id_core.design.waypoints import Waypoints
from joint_id_core.errors import JointIdError
from joint_id_core.estimators import ParameterSettings, fit
from joint_id_core.estimators.correction import CORRECTED
from joint_id_core.estimators.shared.fit_data import prepare
from joint_id_core.models import build
from joint_id_core.results.verdict import Verdict
from joint_id_core.simulation.excitation import build_multisine, harmonics
from joint_id_core.simulation.position_control import simulate_closed_loop
from joint_id_core.simulation.sensors import Sensors

RATE, SECONDS = 125.0, 8.0
MODEL = build("rigid_joint")
LIMITS = JointLimits(("elbow_joint",), -2.0, 2.0, 3.0, 20.0, 400.0, 60.0, "test")  # type: ignore[arg-type]


class Sampled:
    """A planned motion as the reference of the exact simulator."""

    def __init__(self, motion: Trajectory) -> None:
        self.motion = motion

    def value(self, time: float) -> float:
        return float(self.motion.at(time).position[0, 0])

    def rate(self, time: float) -> float:
        return float(self.motion.at(time).velocity[0, 0])


def planned(position, velocity, acceleration, rate=RATE) -> Trajectory:
    time = np.arange(len(position)) / rate
    return Trajectory(("elbow_joint",), time, position[:, None], velocity[:, None], acceleration[:, None])


def one_way(room: float, seconds: float, rate: float = RATE) -> Trajectory:
    x = np.arange(round(seconds * rate) + 1) / (seconds * rate)
    return planned(
        room * x**3 * (10 - 15 * x + 6 * x**2),
        room / seconds * 30 * x**2 * (1 - x) ** 2,
        room / seconds**2 * 60 * x * (1 - x) * (1 - 2 * x),
        rate,
    )


@pytest.fixture(scope="module")
def design():
    return design_joint(MODEL, LIMITS, time=SECONDS, rate=RATE)


def test_the_compiled_joint_moves_as_the_exact_simulation_does():
    """Other friction (smoothed), another integrator, another language: the same motion, with gear and gravity."""
    model = build("harmonic_drive", gravity=True)
    foresight = Foresight(model, ParameterSettings({"a_g": 5.0}), 500.0)
    motion = one_way(0.5, 2.0, 500.0)
    back = np.concatenate([motion.position, motion.position[-2::-1]])[:, 0]
    velocity = np.concatenate([motion.velocity, -motion.velocity[-2::-1]])[:, 0]
    moved = foresight.move(foresight.joints(0)[0], back, velocity)
    hold = 250  # samples that `move` lets the controller settle first
    path = np.pad(back, (hold, 0)), np.pad(velocity, (hold, 0))

    class Reference:
        def value(self, time):
            return path[0][round(500.0 * time)]

        def rate(self, time):
            return path[1][round(500.0 * time)]

    exact = simulate_closed_loop(
        foresight.plant.model, foresight.plant.controller, Reference(), np.arange(len(path[0])) / 500.0, foresight.link
    )
    for name, tolerance in (("link_position", 2e-4), ("motor_velocity", 0.5), ("torque", 5e-3)):
        assert np.abs(exact[name][hold:] - moved.recording[name]).max() < tolerance, name
    assert moved.torque == pytest.approx(101.0 * np.abs(exact["torque"][hold:]).max(), rel=0.01)


def test_the_information_is_that_of_finite_differences():
    """With an exact drive the filter is a simulation from an unknown start: its information has a closed form."""
    noise = Sensors(noise={"link_position": 1e-4, "torque": 1e-9})
    foresight = Foresight(MODEL, ParameterSettings(priors={"tau_0": 1e3}), RATE, noise)
    motion, joint = one_way(1.0, 4.0), Foresight(MODEL, ParameterSettings(), RATE).joints(0)[0]
    moved = foresight.move(joint, motion.position[:, 0].copy(), motion.velocity[:, 0].copy())
    recording = as_recorded(moved.recording, noise)
    covariance, _, _ = foresight.informed(joint, recording)
    data = prepare(MODEL, recording, ParameterSettings(joint), leave_out_rests=True)
    seen = np.flatnonzero(~data.rest)
    assert len(seen) > 0.8 * len(data.time)
    kernel, part = compile_model(MODEL), slice(seen[0], seen[-1] + 1)
    x0 = np.array([moved.recording[n][seen[0]] for n in MODEL.state_names])

    def predicted(change):
        p = np.array([joint[n] for n in MODEL.parameter_names])
        for name, by in zip(foresight.free, change[2:], strict=True):
            k = MODEL.parameter_names.index(name)
            p[k] = p[k] * np.exp(by) if MODEL.parameters[k].positive else p[k] + by
        return rollout(kernel, x0 + change[:2], data.time[part], data.u[part], p, 8)[:, 0]

    h = 1e-4
    J = np.array([(predicted(h * row) - predicted(-h * row)) / (2 * h) for row in np.eye(2 + len(foresight.free))]).T
    J, settle = J / 1e-4, round(0.05 * RATE)  # after a rest, labels tell the state alone
    tells = J.copy()
    tells[:settle, 2:] = 0.0
    full = J.T @ J - J[:settle].T @ J[:settle] + tells[:settle].T @ tells[:settle]
    prior = np.diag(np.concatenate([[0.0, 0.0], np.power(foresight.coordinates.spread, -2.0)]))
    expected = np.linalg.inv(full + prior)[2:, 2:]
    assert np.sqrt(np.diag(covariance)) == pytest.approx(np.sqrt(np.diag(expected)), rel=0.1)


@pytest.mark.long
def test_real_fits_err_by_what_was_promised(design):
    """Joints that are off by 10 % make the motion with exact stick and slip, and are fitted from the start values."""
    foresight = Foresight(MODEL, ParameterSettings(), RATE)
    motion, errors = design.trajectory, []
    rows = {row.name: row for row in design.expected}
    for seed in range(24):
        joint, rng = dict(foresight.joints(0)[0]), np.random.default_rng([3, seed])
        for name in ("J", "c", "tau_f"):
            joint[name] *= np.exp(0.1 * rng.standard_normal())
        exact = simulate_closed_loop(MODEL, foresight.plant.controller, Sampled(motion), motion.time, joint)
        estimate = fit(MODEL, as_recorded(exact, foresight.sensors, seed))
        assert estimate.status.value in ("converged", "poor_fit")
        errors.append([np.log(estimate.values[name] / joint[name]) for name in ("J", "c", "tau_f")])
    rms = np.sqrt(np.mean(np.square(errors), axis=0))
    promised = [rows[name].std_dev / rows[name].value for name in ("J", "c", "tau_f")]
    assert np.all(rms / promised > 0.6) and np.all(rms / promised < 1.5), rms / promised


@pytest.mark.long
def test_a_trial_fit_ends_where_the_fit_of_the_robot_will():
    """Elsewhere by two standard deviations if its integrator steps are not those of the other."""
    model, rate = build("harmonic_drive"), 500.0
    foresight, tones = Foresight(model, ParameterSettings(), rate), build_multisine(0.3, harmonics(2.0, 6.0, 5.0))
    joint, time = foresight.joints(1, seed=4)[1], np.arange(round(6.0 * rate) + 1) / rate
    x = np.clip(time, 0.0, 1.0)
    ramp, slope = x**3 * (10 - 15 * x + 6 * x**2), 30 * x**2 * (1 - x) ** 2
    position, velocity = ramp * tones.value(time), ramp * tones.rate(time) + slope * tones.value(time)
    recording = as_recorded(foresight.move(joint, position, velocity).recording, foresight.sensors, 1)
    trial, real = trial_fit(foresight, joint, recording), fit(model, recording)
    assert trial is not None
    for name in real.free:
        assert abs(trial.values[name] - real.values[name]) < 0.1 * real[name].std_dev, name


def test_a_trial_fit_is_corrected_as_the_fit_of_the_robot_will_be():
    """Smoothed friction looks like friction that turns over some distance; without this, off by up to 6 promises."""
    model, foresight = build("motor_side"), Foresight(build("motor_side"), ParameterSettings(), 500.0)
    own = replace(LIMITS, acceleration=np.array([5.0]), jerk=np.array([50.0]))
    shapes = WaypointShapes(Waypoints(own.names, np.array([[-0.9], [0.2], [0.8]])), own, 10.0, 500.0)
    position, velocity = (part[:, 0].copy() for part in shapes.state(shapes.plain(shapes.most))[:2])
    joint = foresight.joints(1, seed=4)[1]
    recording = as_recorded(foresight.move(joint, position, velocity).recording, foresight.sensors, 1)
    trial, real = trial_fit(foresight, joint, recording), fit(model, recording)
    assert trial is not None and CORRECTED in " ".join(real.notes)
    for name in real.free:
        assert abs(trial.values[name] - real.values[name]) < 0.1 * real[name].std_dev, name


@pytest.mark.long
def test_the_motion_keeps_its_limits_between_the_samples(design):
    """Checked by SciPy's polynomials through position, velocity and acceleration of the samples."""
    motion = design.trajectory
    samples = np.stack([motion.position[:, 0], motion.velocity[:, 0], motion.acceleration[:, 0]], axis=1)
    path, fine = BPoly.from_derivatives(motion.time, samples), np.linspace(0.0, motion.duration, 30 * len(motion.time))
    for order, limit in enumerate((1.0, LIMITS.velocity[0], LIMITS.acceleration[0], LIMITS.jerk[0])):
        largest = np.abs(path.derivative(order)(fine) if order else path(fine)).max()
        assert largest <= limit * (1 + 1e-9), order
    assert motion.position[0] == motion.position[-1] == 0.0


@pytest.mark.long
def test_the_design_beats_a_multisine_of_the_same_limits_and_is_the_same_again(design):
    foresight = Foresight(MODEL, ParameterSettings(), RATE)
    near = replace(LIMITS, lower=np.array([-1.0]), upper=np.array([1.0]))
    search = Search(foresight, FourierShapes(near, 0.0, SECONDS, RATE), near, SECONDS, ("J", "c", "tau_f"))
    tones = build_multisine(1.0, harmonics(1.0, 3.0, 4.0))
    sizes, phases = np.array(tones.amplitudes), np.array(tones.phases)
    shape = Shape(np.array(tones.frequencies), sizes * np.array([np.cos(phases), -np.sin(phases)]))
    plain = foretell(foresight, search.trajectory(search.candidate(shape), "elbow_joint"))

    def mean(of):
        return np.exp(np.mean([np.log(r.std_dev / r.value) for r in of.expected if r.name in ("J", "c", "tau_f")]))

    assert mean(design) < 0.8 * mean(plain)
    again = design_joint(MODEL, LIMITS, time=SECONDS, rate=RATE)
    assert np.array_equal(again.trajectory.position, design.trajectory.position) and str(again) == str(design)


@pytest.mark.long
def test_a_search_takes_no_tone_that_the_limit_of_jerk_makes_small_and_asks_no_joint_in_vain(monkeypatch):
    calm = replace(
        LIMITS, lower=np.array([-1.0]), upper=np.array([1.0]), acceleration=np.array([5.0]), jerk=np.array([50.0])
    )
    foresight = Foresight(MODEL, ParameterSettings(), RATE)
    search = Search(foresight, FourierShapes(calm, 0.0, SECONDS, RATE), calm, SECONDS, ("J", "c", "tau_f"))
    asked, see = [], foresight.see
    monkeypatch.setattr(foresight, "see", lambda joint, *motion: asked.append(joint) or see(joint, *motion))
    best = search.run()
    assert best.shape.frequencies.max() <= 2.0 * 50.0 / 5.0 / (2.0 * np.pi)
    of_each = [sum(joint is one for joint in asked) for one in search.joints]
    assert of_each[0] > 2 * of_each[1] >= 2 * of_each[2] > 0
    assert len(best.worths) == len(search.joints) and best.worth == pytest.approx(np.mean(best.worths))


@pytest.mark.long
def test_a_limit_that_was_assumed_is_not_told_as_given():
    limits = replace(LIMITS, velocity=np.array([50.0]), acceleration=np.array([np.inf]), jerk=np.array([np.inf]))
    said = " ".join(design_joint(MODEL, limits, time=4.0, rate=RATE).notes)
    held = said.partition("The limit of ")[2].split()[0]
    assert held in ("acceleration", "jerk"), said
    assert f"The limit of {held} holds this motion (assumed, as none is given)" in said


def test_it_says_which_simple_motions_cannot_show_what_and_which_limit_holds(design):
    said = " ".join(design.notes)
    assert "A motion in one direction, without a reversal, does not show" in said
    assert "The limit of" in said and "holds this motion (test)" in said
    one = foretell(Foresight(MODEL, ParameterSettings(), RATE), one_way(1.0, 4.0))
    rows = {row.name: row for row in one.expected}
    assert rows["tau_f"].verdict is not Verdict.ESTIMATED and rows["tau_f"].reason
    assert {row.name for row in design.shown} >= {"J", "c", "tau_f"}


def test_where_a_limit_prevents_a_parameter_it_says_so():
    tight = replace(LIMITS, velocity=np.array([0.03]), acceleration=np.array([0.5]), jerk=np.array([20.0]))
    found = design_joint(MODEL, tight, ParameterSettings(priors={"J": 0.001}), time=4.0, rate=RATE)
    row = next(row for row in found.expected if row.name == "J")
    assert row.verdict is Verdict.NOT_EXCITED and "a motion of twice the size would not show it either" in row.reason


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"time": 0.5}, "a motion of 0.5 s: give 2 to 120 s"),
        ({"show": ("J_m",)}, "no parameter 'J_m'"),
        ({"show": ("N",)}, "parameter N is held: free it"),
        ({"criterion": "E"}, "criterion E: choose one of sigma, D, A"),
        ({"home": 2.5}, "home = 2.5 rad is not between the limits -2 and 2 rad"),
        ({"reach": 0.0}, "reach = 0 rad: give a number above 0"),
        ({"rate": 10.0}, "rate = 10 Hz: give 50 Hz or more"),
        ({"rate": 1e6}, "rate = 1e\\+06 Hz: give 50 Hz or more, .*, and no more than 10000"),
        (
            {"limits": JointLimits.none(("elbow_joint",), "my file")},
            "my file: joint elbow_joint has no limit of position",
        ),
        ({"limits": published("ur3e")}, "give those of one joint"),
        ({"limits": replace(LIMITS, jerk=np.array([1e-3]))}, "no motion of 8 s within the limits moves the joint"),
        (
            {"limits": replace(LIMITS, torque=np.array([2.0]))},
            r"larger ones take [\d.]+ Nm or more at the link, and the limit of torque is 2 Nm",
        ),
        (
            {"limits": replace(LIMITS, torque=np.array([0.5])), "model": build("harmonic_drive")},
            r"larger ones take [\d.]+ Nm or more at the link, and the limit of torque is 0\.5 Nm",
        ),
        ({"model": build("electromechanical")}, "driven by a voltage"),
        ({"settings": ParameterSettings({"J": -1.0})}, "outside its bounds"),
        ({"settings": ParameterSettings({"K": 1.0})}, "no parameter 'K'"),
    ],
)
def test_bad_input_is_refused_before_anything_is_searched(changes, said):
    arguments = {"model": MODEL, "limits": LIMITS, "time": SECONDS, "rate": RATE, **changes}
    with pytest.raises(JointIdError, match=said):
        design_joint(arguments.pop("model"), arguments.pop("limits"), arguments.pop("settings", None), **arguments)
