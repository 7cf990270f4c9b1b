"""Regressions of joints that do what the model has not: their intervals contain what that changes."""

import functools

import numpy as np
import pytest

from joint_id_core import fit
from joint_id_core.data.recording import Recording
from joint_id_core.design.plant import controller_of
from joint_id_core.estimators import Regression
from joint_id_core.estimators.regression.equations import Equation
from joint_id_core.estimators.regression.lacking import with_lacking
from joint_id_core.estimators.regression.least_squares import solve
from joint_id_core.estimators.regression.missing import COMPLIANCE, EYRING, GRAVITY
from joint_id_core.estimators.regression.share import Share
from joint_id_core.models import build
from joint_id_core.simulation.excitation import position_reference
from joint_id_core.simulation.position_control import simulate_closed_loop
from joint_id_core.simulation.sensors import Sensors

from .quick import first_quick

RATE = 500
SECONDS = 16.0
J = 0.2


@functools.cache
def moved(seed, **values):
    """A joint led along a multisine by its controller: a model with these values, its values, and the motion."""
    reference, time = position_reference(0.4, 0.3, 1.5, 12.0, seed=seed), np.arange(round(SECONDS * RATE)) / RATE
    speed = np.array([reference.rate(t) for t in time])
    inertia, viscous = J * np.std(np.gradient(speed, time)), np.std(speed)
    model = build("rigid_joint", gravity="b_g" in values, friction="eyring" if "w_e" in values else "coulomb_viscous")
    truth = model.values({"J": J, "c": 0.3 * inertia / viscous, "tau_f": inertia, "tau_0": 0.0} | values)
    controller = controller_of(model, truth)
    return truth, simulate_closed_loop(model, controller, reference, time, truth, torque_noise=2e-3)


def fitted(motion, seed, late=0):
    """The regression of what the sensors show; the torque acts `late` samples after it is recorded."""
    time = motion.time[late:]
    channels = {"link_position": motion["link_position"][late:], "torque": motion["torque"][: len(time)]}
    sensors = Sensors(quantum={"link_position": 2.0 * np.pi / 2**17})
    shown = sensors.measure(Recording(time, channels, source="lacking"), seed=seed)
    return fit(build("rigid_joint"), shown, estimator=Regression())


def far(estimate, truth, name):
    return abs(estimate[name].value - truth[name]) / estimate[name].std_dev


@pytest.mark.parametrize("seed", first_quick(range(4)))
def test_a_joint_that_is_as_the_model_keeps_its_narrow_intervals(seed):
    truth, motion = moved(seed)
    estimate = fitted(motion, seed)
    assert "the residuals show" not in estimate.message.lower()
    for name, most in {"J": 0.005, "c": 0.02, "tau_f": 0.02}.items():
        assert estimate[name].std_dev < most * truth[name]
        assert far(estimate, truth, name) < 4.0


@pytest.mark.parametrize("seed", first_quick([0, 2, 3]))
def test_inertia_contains_what_a_small_load_with_the_angle_does(seed):
    """It is too little for a fault: 99.5 % of the torque are explained. The inertia was 4.6 to 5.4 deviations off."""
    truth, motion = moved(seed, a_g=0.0, b_g=0.15)
    estimate = fitted(motion, seed)
    assert estimate.converged
    assert abs(estimate["J"].value / J - 1.0) > 0.03, "else this test tells nothing"
    assert far(estimate, truth, "J") < 2.0
    assert "a load that goes with the angle (--gravity)" in estimate.message


@pytest.mark.parametrize("seed", first_quick(range(4)))
def test_a_drive_that_is_late_is_in_the_intervals_as_well_as_in_the_message(seed):
    """By 10 ms: viscous friction is 15 to 26 % too large, which was 3.1 to 7.1 deviations."""
    truth, motion = moved(seed)
    estimate = fitted(motion, seed, late=5)
    assert estimate.converged and "ms late against the motion" in estimate.message
    assert abs(estimate["c"].value / truth["c"] - 1.0) > 0.1, "else this test tells nothing"
    for name in ("J", "c", "tau_f"):
        assert far(estimate, truth, name) < 2.5, name


@pytest.mark.parametrize("seed", first_quick(range(4)))
def test_another_law_of_friction_leaves_the_nearest_straight_line(seed):
    truth, motion = moved(seed, w_e=1.0)
    estimate = fitted(motion, seed)
    assert far(estimate, truth, "J") < 2.5
    assert estimate["tau_f"].std_dev < 0.02 * estimate["tau_f"].value, "the data know that line well"


def equation(static):
    return Equation("link_velocity", "J", ("J", "c", "a"), np.zeros(0), np.zeros((0, 3)), 1.0, np.array(static))


@pytest.mark.parametrize(
    ("option", "static", "counts"),
    [
        (COMPLIANCE, [False, False, True], [True, True, True]),
        (GRAVITY, [False, False, True], [True, True, False]),
        (EYRING, [False, False, True], [True, False, True]),
    ],
)
def test_the_bias_is_that_of_an_omitted_variable(option, static, counts):
    """Closed form: least squares without a column x of size s is off by s times the regression of x on the columns."""
    rng = np.random.default_rng(1)
    columns, x = rng.standard_normal((400, 3)), rng.standard_normal(400)
    x = x + columns @ [0.5, -0.4, 0.3]
    y = columns @ [1.0, 2.0, 3.0] + 0.2 * x + 0.01 * rng.standard_normal(400)
    pieces = np.zeros(400, dtype=np.int64)

    def ask(y, table):
        return solve(y, table, [False] * table.shape[1], pieces)

    found = ask(y, columns)
    wider = with_lacking(found, equation(static), y, columns, {option: x[:, None]}, ask)
    bias = 0.2 * np.linalg.lstsq(columns, x, rcond=None)[0]
    assert np.allclose(np.where(counts, np.abs(bias), 0.0), wider.doubt, atol=0.005)
    assert np.allclose(np.diag(wider.covariance - found.covariance), wider.doubt**2)
    assert np.array_equal(wider.values, found.values)

    same = with_lacking(ask(y - 0.2 * x, columns), equation(static), y - 0.2 * x, columns, {option: x[:, None]}, ask)
    assert not np.any(same.doubt) and same.reasons == ()


def test_what_is_left_of_a_share_and_a_drive_that_comes_early_are_in_doubt():
    effect = np.array([1.0, -0.5])
    assert Share(-0.2, 0.03, effect).doubt(taken=True) == pytest.approx(0.2 * effect)
    assert Share(0.01, 0.03, effect).doubt(taken=True) == pytest.approx(0.03 * effect)
    assert Share(-3.0, 0.2, effect).doubt(taken=False) == pytest.approx(3.0 * effect)
    assert np.all(np.abs(Share(-0.1, 0.2, effect).doubt(taken=False)) < 0.1), "chance, of a drive that is held"
