"""A regression in place of innovations that do not describe the motion."""

import numpy as np
import pytest

from joint_id_core.data.recording import Recording
from joint_id_core.estimators import Innovations, ParameterSettings, Regression, fit
from joint_id_core.estimators.instead import regressed_instead
from joint_id_core.models import build
from joint_id_core.results.status import Status
from joint_id_core.simulation import simulate

from .online_motion import MODEL, TRUTH, motion


@pytest.fixture(scope="module")
def loaded():
    """A joint with a load that goes with the angle, which the model lacks."""
    record = motion()
    values = {**TRUTH, "a_g": 1.0, "b_g": 1.0}
    moved = simulate(build("rigid_joint", gravity=True), record.time, {"torque": record["torque"]}, values)
    return Recording(record.time, {"link_position": moved["link_position"], "torque": record["torque"]})


def test_it_holds_the_truth_and_says_why_it_is_there(loaded):
    alone = Innovations().fit(MODEL, loaded)
    assert alone.status is Status.POOR_FIT
    found = fit(MODEL, loaded)
    assert found.converged and found.estimator == Regression.name
    for name in ("J", "c", "tau_f"):
        assert abs(found[name].value - TRUTH[name]) < 3.0 * found[name].std_dev
    assert found.notes[1] == "This is a regression, since innovations do not describe every sample of the motion."
    assert found.notes[-1].startswith("Of innovations: the ")  # why they failed
    assert any("try --gravity" in note for note in found.notes[:3])  # a better model is better than another estimator


def test_a_drive_that_is_early_is_told_before_what_the_residuals_show():
    """The hint of a friction law stood in the message, and the lag, which is the cause, far below."""
    record = motion()
    ahead = round(0.02 / record.period)
    early = np.append(record["torque"][ahead:], np.full(ahead, np.nan))
    found = fit(MODEL, Recording(record.time, {"link_position": record["link_position"], "torque": early}))
    assert found.estimator == Regression.name
    assert found.notes[1].startswith("The drive seems to be 20 ms early against the motion")
    assert found.notes[1].rstrip(".") in found.message


def test_what_the_user_believes_is_not_dropped_for_it(loaded):
    """A regression takes no priors, so it does not take the place of a fit that has them."""
    found = fit(MODEL, loaded, ParameterSettings(priors={"J": 0.2}))
    assert found.estimator == Innovations.name and found.status is Status.POOR_FIT
    assert "take --estimator regression" in found.message


def test_a_torque_that_does_not_cause_the_motion_is_a_poor_fit_of_both():
    record, rng = motion(), np.random.default_rng(0)
    found = fit(MODEL, record.with_channels({"torque": rng.normal(0.0, 3.0, len(record))}))
    assert found.estimator == Innovations.name and found.status is Status.POOR_FIT


def test_a_good_fit_stays():
    assert fit(MODEL, motion()).estimator == Innovations.name


def test_where_a_regression_lacks_a_signal_the_fit_of_innovations_goes_on(loaded):
    """It needs a position: its refusal says nothing of the motion, and another drive between samples is tried."""
    velocity = np.gradient(loaded["link_position"], loaded.time)
    record = Recording(loaded.time, {"link_velocity": velocity, "torque": loaded["torque"]})
    alone = Innovations().fit(MODEL, record)
    assert alone.status is Status.POOR_FIT
    assert regressed_instead(alone, MODEL, record, None) is None
