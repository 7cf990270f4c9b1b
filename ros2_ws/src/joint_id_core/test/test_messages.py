"""Messages of a fit: at most three sentences that a person can read, whatever the numbers are."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from joint_id_core.data.recording import Recording
from joint_id_core.estimators import ParameterSettings, fit
from joint_id_core.estimators.innovations.verdicts import Shown, judge
from joint_id_core.estimators.shared.fit_data import prepare
from joint_id_core.estimators.shared.sentences import MOST_NAMES, apart, listed, missed, sentence, times
from joint_id_core.models import build
from joint_id_core.results.estimate import Status, Verdict
from joint_id_core.results.report import table
from joint_id_core.simulation.excitation import position_reference
from joint_id_core.simulation.position_control import PositionController, simulate_closed_loop
from joint_id_core.simulation.sensors import Sensors

from .readable import readable

MODEL = build("rigid_joint")
SIZES = st.floats(min_value=0.0, allow_infinity=True) | st.just(np.nan)


def recorded():
    time = np.arange(300) * 0.01
    channels = {"link_position": np.sin(time), "link_velocity": np.cos(time), "torque": np.sin(3.0 * time)}
    return Recording(time, channels)


DATA = prepare(MODEL, recorded())


@settings(deadline=None)
@given(
    residual=st.floats(min_value=0.0, max_value=1e150),
    coloured=st.booleans(),
    levels=st.lists(st.floats(min_value=1e-300, max_value=1e300), min_size=4, max_size=4),
    nrmse=st.lists(SIZES, min_size=2, max_size=2),
    verdicts=st.lists(st.sampled_from(Verdict), min_size=6, max_size=6),
    warnings=st.lists(st.sampled_from(["", "the first thing", "another thing"]), max_size=5),
    settled=st.booleans(),
    doubts=st.sampled_from([(), ("only one start led anywhere",)]),
    together=st.sampled_from(["", "this model shows only a + b = 3: hold one of these parameters"]),
)
def test_every_judgement_is_readable(residual, coloured, levels, nrmse, verdicts, warnings, settled, doubts, together):
    e = np.ones((300, 2)) if coloured else np.random.default_rng(0).standard_normal((300, 2))
    found = SimpleNamespace(
        last=SimpleNamespace(residuals=residual * e), levels=np.array(levels[: len(DATA.noise_names)]), settled=settled
    )
    names = MODEL.parameter_names
    rows = {names[k]: Shown(v, "why", together if k < 2 else "") for k, v in enumerate(verdicts)}
    judged = judge(DATA, found, dict(zip(DATA.labels, nrmse, strict=True)), rows, warnings, doubts)
    readable(judged.message)
    assert " ".join(judged.notes).startswith(judged.message)
    for note in judged.notes:
        readable(note)
    if judged.status is Status.POOR_FIT:
        assert sentence(Status.POOR_FIT.advice) in judged.message
    if any(v > 1.0 for v in nrmse):
        assert judged.status is not Status.CONVERGED


def test_the_most_useful_findings_come_first():
    residuals = np.random.default_rng(0).standard_normal((300, 2))
    found = SimpleNamespace(last=SimpleNamespace(residuals=residuals), levels=np.full(4, 1e-9), settled=True)
    rows = {"c": Shown(Verdict.PRIOR, ""), "J": Shown(Verdict.ESTIMATED, "")}
    texts = ("the residuals show friction (try --friction stribeck)", "", "another thing")
    judged = judge(DATA, found, {}, rows, texts)
    assert judged.notes == (
        "Converged.",
        "The residuals show friction (try --friction stribeck).",
        "This motion does not show c.",
        "Another thing.",
    )
    assert judged.message == " ".join(judged.notes[:3])
    poor = judge(DATA, found, {"link_position": 3.0}, rows, texts)
    assert poor.notes[:3] == (
        "The predictions of link_position miss by 300 % of its variation.",
        sentence(Status.POOR_FIT.advice),
        "The residuals show friction (try --friction stribeck).",
    )


@pytest.mark.parametrize(
    "nrmse, said",
    [(1.234567, "123 %"), (9.5, "950 %"), (1e53, "far more"), (np.inf, "far more"), (np.nan, "far more")],
)
def test_what_is_missed_is_a_number_or_words(nrmse, said):
    assert said in missed("the predictions of x", nrmse)


def test_ratios_and_lists_stay_short():
    assert (times(3.21), times(26.4), times(1e40)) == ("3.21 times", "26.4 times", "more than 1000 times")
    names = [f"p{k}" for k in range(20)]
    assert listed(names[:3]) == "p0, p1, p2"
    assert listed(names).endswith(f"{names[MOST_NAMES - 1]} and {20 - MOST_NAMES} more")


@pytest.mark.long
def test_a_fit_whose_predictions_run_away_says_so_in_words(monkeypatch):
    """A flexible joint that is told three times its gear ratio: predicted velocities are far too large.

    In which minimum such a fit ends may hang on the last bits, so one of two recordings is enough. It is made here,
    though the ratio is known to be wrong before.
    """
    monkeypatch.setattr("joint_id_core.estimators.seen_ratio.OFF", np.inf)
    model, time = build("harmonic_drive"), np.arange(1000) / 500
    noise = {"motor_position": 1e-3, "link_position": 1e-5, "motor_velocity": 0.1, "link_velocity": 1e-3}
    found = []
    for seed in (1, 3):
        moved = simulate_closed_loop(
            model, PositionController(), position_reference(), time, torque_noise=0.003, seed=seed
        )
        found.append(fit(model, Sensors(noise=noise).measure(moved, seed), ParameterSettings({"N": 300.0})))
    assert not any(estimate.converged for estimate in found)
    estimate = next(e for e in found if any("miss by far more than its variation" in note for note in e.notes))
    readable(estimate.message)
    shown = table(estimate)
    rest = [note for note in estimate.notes if note not in estimate.message]
    assert all(note in shown for note in rest)
    assert ("also:" in shown) == bool(rest)
    assert estimate.to_dict()["notes"] == list(estimate.notes)


def test_numbers_that_differ_are_told_with_digits_that_differ():
    assert apart(2.0, 3.0) == ("2", "3") and apart(0.0174530, 0.0174561) == ("0.01745", "0.01746")
    assert apart(1.0, 1.0)[0] == apart(1.0, 1.0)[1]
