"""The order of candidates and what is said of it, on made-up errors and likelihoods."""

from __future__ import annotations

import math

import numpy as np
import pytest

from joint_id_core.comparison.model_text import Candidate
from joint_id_core.comparison.ranking import rank
from joint_id_core.comparison.trial import BLOCKS, HeldOut, Trial, same_data
from joint_id_core.models import build
from joint_id_core.results.estimate import Estimate, ParameterEstimate, Status, Verdict

T = 800
NOISE = np.random.default_rng(0).standard_normal((3, T))
LABELS = ("link_position",)


def trial(
    label: str, size: float = 1.0, free: int = 4, deviance: float = -5000.0, status: Status = Status.CONVERGED,
    labels: tuple[str, ...] = LABELS, signals: tuple[str, ...] = (*LABELS, "torque"), observations: int = 1600,
    own: float = 0.0, N: float = 1.0, unseen: tuple[str, ...] = (),
) -> Trial:  # fmt: skip
    """A trial whose errors are those of all trials times `size`, plus a share `own` that it has alone."""
    alone = np.random.default_rng(sum(map(ord, label))).standard_normal((len(signals), T))
    errors = {n: 1e-3 * size * (NOISE[k] + own * alone[k]) for k, n in enumerate(signals)}
    parameters = [ParameterEstimate("N", "1", N, math.nan, Verdict.FIXED)]
    parameters += [ParameterEstimate(n, "Nm", 1.0, 1.0, Verdict.NOT_EXCITED) for n in unseen]
    notes = ("Converged.",) if status is Status.CONVERGED else ("Residuals are not white.", f"{status.advice}.")
    estimate = Estimate(
        "rigid_joint", "innovations", status, " ".join(notes), tuple(parameters), notes=notes,
        free=tuple(f"p{k}" for k in range(free)), nrmse=dict.fromkeys(labels, 0.1), deviance=deviance,
        observations=observations,
    )  # fmt: skip
    return Trial(Candidate(label, build("rigid_joint"), ()), estimate, errors, "torque" if "torque" in signals else "")


def failed(label: str) -> Trial:
    estimate = Estimate("dc_motor", "innovations", Status.MISSING_SIGNAL, "log has no voltage", ())
    return Trial(Candidate(label, build("dc_motor"), ()), estimate, failure="missing_signal: log has no voltage")


def order(*trials: Trial) -> list[str]:
    return [row.trial.label for row in rank(trials).rows]


def test_criteria_are_those_of_schwarz_and_akaike():
    t = trial("a", free=5, deviance=-100.0, observations=50)
    assert t.bic == pytest.approx(-100.0 + 5 * math.log(50))
    assert t.aic == pytest.approx(-90.0)
    assert math.isnan(failed("b").bic)


def test_what_predicts_better_stands_first_whatever_the_likelihood_says():
    a, b = trial("a", 1.0, free=6, deviance=-4000.0), trial("b", 3.0, deviance=-5000.0)
    ranking = rank([b, a])
    assert [(r.rank, r.trial.label) for r in ranking.rows] == [(1, "a"), (2, "b")]
    assert ranking.best is a
    assert ranking.rows[0].score == pytest.approx(1e-3, rel=0.1)
    assert "3 times that of the first, BIC lower by" in ranking.rows[1].reason
    assert ranking.conclusion.startswith("a describes this record best: smallest error on the unseen part")


def test_equal_prediction_leaves_the_choice_to_the_criterion():
    better, worse = trial("x", 1.005, deviance=-5050.0), trial("y", 1.0, deviance=-5000.0)
    ranking = rank([worse, better])
    assert [r.trial.label for r in ranking.rows] == ["x", "y"]
    assert [r.delta_bic for r in ranking.rows] == pytest.approx([0.0, 50.0])
    assert "lowest BIC of 2" in ranking.rows[0].reason
    assert "BIC higher by 50" in ranking.rows[1].reason
    assert order(better, worse) == ["x", "y"]


def test_a_simpler_model_that_is_as_good_is_named():
    large, small = trial("large", free=6, deviance=-5000.0), trial("small", free=4)
    cost = 2 * math.log(1600)
    close = trial("small", free=4, deviance=-5000.0 + cost + 1.0)  # its BIC is higher by 1
    assert "small is as good, with 2 parameters fewer" in rank([large, close]).conclusion
    assert "BIC the same within 2" in rank([large, close]).rows[1].reason
    far = trial("small", free=4, deviance=-5000.0 + cost + 30.0)
    assert "small predicts as well, with 2 parameters fewer" in rank([large, far]).conclusion
    assert rank([large, small]).best is small  # the same likelihood with fewer parameters
    assert "fewer" not in rank([large, small]).conclusion


def test_models_with_other_labels_are_compared_by_prediction_alone():
    rigid = trial("rigid", 2.0, deviance=-9000.0)
    flexible = trial("flexible", labels=("motor_position", "link_position"), observations=3200,
                     signals=("motor_position", "link_position", "torque"))  # fmt: skip
    ranking = rank([rigid, flexible])
    assert [r.trial.label for r in ranking.rows] == ["flexible", "rigid"]
    assert set(ranking.signals) == {"link_position", "torque"}
    assert all(math.isnan(r.delta_bic) for r in ranking.rows)
    assert "BIC" not in ranking.rows[1].reason
    assert "explain different labels" in ranking.notes[0]
    assert "3200 values" in ranking.notes[0]


def test_the_same_labels_on_other_samples_are_other_data():
    assert same_data(trial("a"), trial("b"))
    assert not same_data(trial("a"), trial("b", observations=1500))
    assert not same_data(trial("a"), trial("b", deviance=math.nan))


def test_equal_prediction_of_different_labels_keeps_the_order_of_errors_and_names_the_simpler():
    small = trial("small", 1.002)
    large = trial("large", free=9, labels=("motor_position", *LABELS))
    ranking = rank([small, large])
    assert [r.trial.label for r in ranking.rows] == ["large", "small"]
    assert "by no more than chance" in ranking.rows[0].reason
    assert "small predicts as well, with 5 parameters fewer" in ranking.conclusion


def test_a_poor_fit_stands_behind_and_its_criterion_is_not_believed():
    good, poor = trial("good", 2.0), trial("poor", 0.5, status=Status.POOR_FIT, deviance=-9000.0)
    ranking = rank([poor, good, failed("lost")])
    assert [(r.rank, r.trial.label) for r in ranking.rows] == [(1, "good"), (2, "poor"), (None, "lost")]
    assert "poor_fit: residuals are not white; " in ranking.rows[1].reason
    assert "BIC and AIC mean little" in ranking.rows[1].reason
    assert ranking.rows[0].delta_bic == 0.0  # a poor fit sets no standard
    assert ranking.rows[1].delta_bic == pytest.approx(-4000.0)
    assert "poor predicts with a smaller error still, but its fit is not good (poor_fit)" in ranking.conclusion
    assert ranking.rows[2].reason == "missing_signal: log has no voltage"
    assert "the only one that describes" in ranking.rows[0].reason


def test_poor_fits_alone_have_an_order_but_no_winner():
    ranking = rank([trial("a", 2.0, status=Status.POOR_FIT), trial("b", 1.0, status=Status.MAX_ITERATIONS)])
    assert [r.trial.label for r in ranking.rows] == ["b", "a"]
    assert ranking.best is None
    assert ranking.conclusion.startswith("no candidate describes this record; b predicts the unseen part with")


def test_nothing_fitted_is_no_crash():
    ranking = rank([failed("a"), failed("b")])
    assert ranking.best is None
    assert [r.rank for r in ranking.rows] == [None, None]
    assert "no candidate could be fitted" in ranking.conclusion


def test_models_without_a_signal_in_common_are_not_ranked():
    ranking = rank([trial("a", signals=LABELS), trial("b", labels=("motor_velocity",), signals=("motor_velocity",))])
    assert [r.rank for r in ranking.rows] == [None, None]
    assert ranking.best is None
    assert "nothing ranks them" in ranking.conclusion
    assert all("predicts no signal that the others predict" in r.reason for r in ranking.rows)


def test_a_poor_fit_of_other_signals_does_not_hide_what_the_good_ones_share():
    other = trial("c", status=Status.POOR_FIT, labels=("motor_velocity",), signals=("motor_velocity",))
    ranking = rank([other, trial("a", 2.0), trial("b", 1.0)])
    assert [r.trial.label for r in ranking.rows] == ["b", "a", "c"]
    assert math.isnan(ranking.rows[2].score)


def test_parameters_that_the_motion_does_not_show_and_two_gear_ratios_are_told():
    ranking = rank([trial("a", unseen=("w_e",)), trial("b", 2.0, N=101.0)])
    assert ranking.rows[0].reason.endswith("this motion does not show its w_e")
    assert "1 in a, 101 in b" in ranking.notes[-1]


def test_a_difference_counts_when_it_is_the_same_all_along():
    """10 % in every stretch is a difference; 10 % on the whole that comes and goes is not; 0.5 % matters to nobody."""
    base, steady, slight = trial("base"), trial("steady", 1.1), trial("slight", 1.005)
    swing = np.repeat(np.where(np.arange(BLOCKS) % 2, 1.9, 0.5), T // BLOCKS)
    erratic = trial("erratic")
    erratic = Trial(erratic.candidate, erratic.estimate, {n: e * swing for n, e in erratic.errors.items()}, "torque")
    held_out = HeldOut([base, steady, slight, erratic], ("link_position", "torque"))
    assert held_out.apart(base, steady) and held_out.apart(steady, base)
    assert held_out.ratio(steady, base) == pytest.approx(1.1)
    assert held_out.ratio(erratic, base) > 1.2
    assert not held_out.apart(base, erratic)
    assert not held_out.apart(base, slight)


def test_only_samples_that_all_predict_are_compared():
    a, b = trial("a"), trial("b")
    spoiled = {n: e.copy() for n, e in a.errors.items()}
    for e in spoiled.values():
        e[:100] = 50.0
    hidden = {n: np.where(np.arange(T) < 100, np.nan, e) for n, e in b.errors.items()}
    a, b = (Trial(t.candidate, t.estimate, e, "torque") for t, e in ((a, spoiled), (b, hidden)))
    assert HeldOut([a, b], LABELS).ratio(a, b) == pytest.approx(1.0)
    assert HeldOut([a], LABELS).score(a) > 1.0
    blind = Trial(b.candidate, b.estimate, {n: np.full(T, np.nan) for n in b.errors}, "torque")
    assert HeldOut([a, blind], LABELS).signals == ()
