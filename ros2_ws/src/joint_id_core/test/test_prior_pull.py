"""An estimate that fights its prior says so, and what to do."""

from __future__ import annotations

import numpy as np
import pytest

from joint_id_core.data.recording import Recording
from joint_id_core.estimators import ParameterSettings, fit
from joint_id_core.estimators.innovations.belief import Belief, Coordinates
from joint_id_core.estimators.innovations.prior_pull import prior_pull
from joint_id_core.models import build

from .online_motion import MODEL, TRUTH, motion


@pytest.mark.parametrize(("wanted", "sigma", "told"), [(35.0, 5.0, True), (35.0, 0.5, False), (12.0, 5.0, False)])
def test_what_the_data_want_is_told_where_the_prior_matters(wanted, sigma, told):
    """One parameter, tau_0 with a prior of 0 ± 10 Nm: the product of two Gaussians."""
    coordinates = Coordinates(MODEL, ("tau_0",))
    belief = Belief(("tau_0",), np.zeros(1), np.array([[0.01]]))
    variance = 1.0 / (1.0 / sigma**2 + 0.01)
    text = prior_pull(
        MODEL, ("tau_0",), coordinates, belief, np.array([wanted / sigma**2 * variance]), np.array([[variance]]),
        ("tau_0",),
    )  # fmt: skip
    assert bool(text) is told
    if told:
        assert "want tau_0 near 35 Nm, 3.5 standard deviations" in text and "--prior tau_0=35" in text


def test_of_many_the_two_are_told_that_are_pulled_most():
    names = ("J", "c", "tau_f", "tau_0")
    coordinates = Coordinates(MODEL, names)
    belief = Belief(names, coordinates.z(np.array([1.0, 1.0, 1.0, 0.0])), np.diag([1.0, 1.0, 1.0, 0.01]))
    away = np.array([2.0, 4.0, 3.0, 20.0])
    spreads = 0.36 * np.diag([1.0, 1.0, 1.0, 100.0])
    text = prior_pull(MODEL, names, coordinates, belief, belief.mean + away, spreads, names)
    assert text.index("want c near") < text.index("want tau_f near") and text.count("--prior") == 2
    assert text.endswith("; others fight their priors less")


@pytest.mark.parametrize(("sigma", "told"), [(0.3, True), (0.8, False)])
def test_data_that_tell_an_upper_limit_only_want_no_value_below_it(sigma, told):
    """Friction that a motion does not show was wanted "near 1e-16 Nm", with a prior of 36 as the advice."""
    names = ("J", "c", "tau_f", "tau_0")
    coordinates = Coordinates(MODEL, names)
    belief = Belief(names, coordinates.z(np.array([1.0, 1.0, 5.0, 0.0])), np.diag([1.0, 1.0, 1.0, 0.01]))
    below = belief.mean + np.array([0.0, 0.0, -2.2, 0.0])
    text = prior_pull(MODEL, names, coordinates, belief, below, np.diag([0.01, 0.01, sigma**2, 1.0]), names)
    assert ("want tau_f" in text) is told
    above = belief.mean - (below - belief.mean)
    assert "want tau_f" in prior_pull(
        MODEL, names, coordinates, belief, above, np.diag([0.01, 0.01, sigma**2, 1.0]), names
    )


def test_a_poor_fit_wants_nothing_of_priors_that_nobody_gave():
    """Its model may ask for any value: once for a friction of 18,500 Nm."""
    record = motion(6.0)
    backwards = record.with_channels({"torque": -record["torque"]})
    found = fit(MODEL, backwards)
    assert found.status == "poor_fit" and not any("The data want" in note for note in found.notes), found
    narrow = fit(MODEL, backwards, ParameterSettings(priors={"J": 0.3}))
    assert narrow.status == "poor_fit" and any("The data want J near" in note for note in narrow.notes), narrow


def test_a_fit_tells_it_and_the_advice_helps():
    record = motion(6.0)
    start = {"J": TRUTH["J"] * np.exp(-0.01)}
    sure = fit(MODEL, record, ParameterSettings(start))["J"]
    assert sure.std_dev < 0.001 * sure.value  # the data alone
    narrow = fit(MODEL, record, ParameterSettings(start, priors={"J": 2.0 * sure.std_dev / sure.value}))
    (note,) = [note for note in narrow.notes if "The data want J near 1.7" in note]
    advised = float(note.partition("--prior J=")[2].partition(",")[0])
    wider = fit(MODEL, record, ParameterSettings(start, priors={"J": advised}))
    assert not any("The data want" in note for note in wider.notes)
    assert abs(wider["J"].value - TRUTH["J"]) < 4.0 * wider["J"].std_dev


def test_a_parameter_that_the_data_do_not_show_wants_nothing():
    model = build("rigid_joint", gravity=True)
    record = motion(6.0)
    still = Recording(record.time, record.channels)
    found = fit(model, still, ParameterSettings(priors={"a_g": 1e-3}))
    assert not any("The data want a_g" in note for note in found.notes)
