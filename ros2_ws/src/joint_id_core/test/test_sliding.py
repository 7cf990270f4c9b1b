"""Regression of a joint that sticks at every reversal."""

import numpy as np
import pytest

from joint_id_core import fit
from joint_id_core.data.recording import Recording
from joint_id_core.design.plant import controller_of
from joint_id_core.estimators import Regression
from joint_id_core.estimators.regression.least_squares import solve
from joint_id_core.estimators.regression.missing import EYRING
from joint_id_core.estimators.regression.sliding import Sliding, sliding
from joint_id_core.models import build
from joint_id_core.simulation.excitation import position_reference
from joint_id_core.simulation.position_control import simulate_closed_loop
from joint_id_core.simulation.sensors import Sensors

from .quick import first_quick

RATE = 500


def slow_motion(seed, **options):
    """True values, and a recording of a joint whose friction is four times the torque of its inertia."""
    reference, time = position_reference(0.8, 0.1, 1.0, 10.0, seed=seed), np.arange(20 * RATE) / RATE
    speed = np.array([reference.rate(t) for t in time])
    inertia, viscous = np.std(np.gradient(speed, time)), np.std(speed)
    model = build("rigid_joint", **options)
    values = {"J": 1.0, "tau_f": 4.0 * inertia, "c": 0.8 * inertia / viscous, "tau_0": inertia}
    values |= {"dtau_s": 2.0 * inertia} if options else {}
    truth = model.values(values)
    moved = simulate_closed_loop(model, controller_of(model, truth), reference, time, truth)
    sensors = Sensors(noise={"torque": 0.05 * inertia}, quantum={"link_position": 2.0 * np.pi / 2**17})
    return truth, sensors.measure(Recording(time, {n: moved[n] for n in ("link_position", "torque")}), seed=seed)


@pytest.mark.parametrize("seed", first_quick([1, 2, 3]))
def test_friction_of_a_joint_that_sticks_is_that_of_its_sliding(seed):
    truth, recording = slow_motion(seed)
    estimate = fit(build("rigid_joint"), recording, estimator=Regression())
    assert estimate.converged, estimate.message
    for name in ("J", "c", "tau_f", "tau_0"):
        found = estimate[name]
        assert abs(found.value - truth[name]) < 4.0 * found.std_dev, f"{name} {found.value:g} +- {found.std_dev:g}"
    assert estimate["c"].value == pytest.approx(truth["c"], rel=0.04)  # with the rest, 8 to 12 % too small
    assert estimate["tau_f"].value == pytest.approx(truth["tau_f"], rel=0.01)  # and 2 to 3 % too large
    assert fit(build("rigid_joint"), recording).converged  # the two estimators agree


def test_weights_are_one_where_the_joint_slides_and_zero_where_it_may_stick():
    time = np.arange(4 * RATE) / RATE
    velocity = np.sin(2.0 * np.pi * 0.5 * time)
    velocity[700:800] = 0.0
    weights = sliding(velocity, 1.0 / RATE, 100.0, 20.0)
    assert (weights[np.abs(velocity) < 0.03] == 0.0).all() and (weights[690:810] < 1.0).all()
    assert (weights[(np.abs(velocity) > 0.5) & (np.abs(time - 1.5) > 0.3)] == 1.0).all()
    assert np.max(np.abs(np.diff(weights))) < 0.1  # no edge that brings noise into the band


@pytest.mark.parametrize(("bend", "straight"), [(0.0, True), (0.1, False)])
def test_friction_counts_as_straight_only_if_the_data_bound_what_else_it_is(bend, straight):
    rng, count = np.random.default_rng(0), 2000
    velocity = rng.uniform(-1.0, 1.0, count)
    columns, bent = np.column_stack([np.sign(velocity), velocity]), (velocity * np.abs(velocity))[:, None]
    pieces = np.zeros(count, dtype=np.int64)

    def ask(y, table):
        return solve(y, table, [False] * table.shape[1], pieces)

    def is_straight(noise, rows):
        y = columns @ [1.0, 0.3] + bend * bent[:, 0] + noise * rng.standard_normal(count)
        sliding = Sliding(y[:rows, None], columns[:rows], columns[:rows, :1], {EYRING: bent[:rows]})
        return sliding.straight(lambda y, t: solve(y, t, [False] * t.shape[1], pieces[:rows]))

    assert is_straight(0.02, count) is straight
    assert not is_straight(1.0, 100)  # noise hides it: nothing is known
    assert not Sliding(columns[:, :1], columns, columns[:, :1], {}).straight(ask)
