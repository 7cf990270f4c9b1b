"""The drift monitor: run lengths as published for such charts, and what counts as evidence."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from joint_id_core.errors import JointIdError
from joint_id_core.online import baseline_file
from joint_id_core.online.drift import DriftMonitor, DriftOptions
from joint_id_core.results.estimate import Estimate, ParameterEstimate, Status, Verdict

from .quick import first_quick

NAMES = ("J", "c", "tau_f")
AT_ONCE = DriftOptions(drift_confirm_s=0.0)


def estimate(end: float = 0.0, std_dev: float = 0.01, status=Status.CONVERGED, temperature=30.0, **values) -> Estimate:
    """An estimate of a rigid joint whose parameters are 1 if not given."""
    rows = [ParameterEstimate(n, "1", values.get(n, 1.0), std_dev, Verdict.ESTIMATED) for n in NAMES]
    rows.append(ParameterEstimate("N", "1", 101.0, math.nan, Verdict.FIXED))
    return Estimate(
        "rigid_joint", "innovations", status, "as it is", tuple(rows), NAMES, std_dev**2 * np.eye(len(NAMES)),
        start=end - 2.0, end=end, temperature=temperature, model_options={"gravity": False},
    )  # fmt: skip


def verdict(found: Estimate, name: str, word: Verdict) -> Estimate:
    """The estimate with another verdict on one parameter."""
    return replace(found, parameters=tuple(replace(p, verdict=word) if p.name == name else p for p in found.parameters))


def names(drifts) -> list[str]:
    return [drift.name for drift in drifts]


@pytest.mark.long
@pytest.mark.parametrize(("weight", "limit"), first_quick([(0.10, 2.814), (0.05, 2.615)]))
def test_its_run_length_without_tolerance_is_the_published_one(weight, limit):
    """Limits of two-sided EWMA charts with a mean run length of 500 (Lucas & Saccucci 1990).

    The estimate of a memory is such a mean of what independent stretches of motion say.
    """
    rng = np.random.default_rng(1)
    mean, length = 1e6, []  # a baseline far from zero: the monitor compares differences
    sigma = math.sqrt(weight / (2.0 - weight))
    options = DriftOptions(drift_tolerance=0.0, drift_threshold=limit, drift_confirm_s=0.0)
    perfect = replace(estimate(J=mean), parameters=(ParameterEstimate("J", "1", mean, 1e-9, Verdict.ESTIMATED),))
    for _ in range(150):
        monitor, z = DriftMonitor(perfect, options), 0.0
        for count in range(1, 10_000):
            z = (1.0 - weight) * z + weight * rng.standard_normal()
            row = ParameterEstimate("J", "1", mean + z, sigma, Verdict.ESTIMATED)
            if monitor.update(replace(perfect, parameters=(row,), end=float(count))):
                length.append(count)
                break
    assert np.mean(length) == pytest.approx(500.0, rel=0.25)  # 3 standard errors


def test_the_error_of_the_baseline_counts_and_is_not_averaged_away():
    """Baselines that are off by their standard deviation: as many reports at once as the normal distribution says."""
    rng, found = np.random.default_rng(2), 0
    for _ in range(4000):
        monitor = DriftMonitor(estimate(J=1.0 + 0.1 * rng.standard_normal(), std_dev=0.1), DriftOptions(0.0, 2.0, 0.0))
        found += "J" in names(monitor.update(estimate(J=1.0 + 0.1 * rng.standard_normal(), std_dev=0.1)))
    assert found / 4000 == pytest.approx(0.0455, abs=0.010)
    # However precise the estimate, it tells nothing of what the baseline does not know.
    monitor = DriftMonitor(estimate(J=1.0, std_dev=0.1), AT_ONCE)
    assert not any(monitor.update(estimate(k, J=1.4, std_dev=1e-6)) for k in range(1000))
    assert names(monitor.update(estimate(1000.0, J=1.6, std_dev=1e-6))) == ["J"]


def test_a_change_within_the_tolerance_is_never_reported_however_certain():
    monitor = DriftMonitor(estimate(std_dev=1e-6), AT_ONCE)
    assert monitor.update(estimate(std_dev=1e-6, J=1.0499, c=0.9501)) == ()
    assert names(monitor.update(estimate(std_dev=1e-6, J=1.0501, c=0.9499))) == ["J", "c"]


def test_a_drift_tells_size_confidence_and_since_when_and_ends_within_the_tolerance():
    monitor = DriftMonitor(estimate(), AT_ONCE)
    steps = [1.00, 1.04, 1.06, 1.08, 1.10, 1.12, 1.14, 1.13, 1.09, 1.051, 1.04, 1.06]
    found = [monitor.update(estimate(10.0 * k, tau_f=value)) for k, value in enumerate(steps)]
    assert [bool(drifts) for drifts in found] == [False] * 6 + [True] * 4 + [False] * 2
    (drift,) = found[6]
    assert (drift.name, drift.baseline, drift.value, drift.since, drift.until) == ("tau_f", 1.0, 1.14, 20.0, 60.0)
    assert drift.change == pytest.approx(0.14)
    assert drift.std_dev == pytest.approx(math.hypot(0.01, 0.01))
    assert 0.99999 < drift.confidence <= 1.0
    assert drift.text == "tau_f is 14 ± 1.4 % above its baseline, confidence above 0.9999, for 40 s"
    assert "confidence 0.528" in found[9][0].text  # as it returns, the confidence falls
    assert found[9][0].since == 20.0


def test_a_drift_is_reported_after_every_estimate_of_a_time_of_motion_was_far_off():
    monitor = DriftMonitor(estimate())  # 30 s by default
    rest = Status.NO_MOTION
    steps = [(10.0, 1.3), (20.0, 1.3), (25.0, 1.08), (30.0, 1.3), (50.0, 1.3), (55.0, rest), (1000.0, rest),
             (1010.0, 1.3), (1019.9, 1.3), (1020.0, 1.3)]  # fmt: skip
    found = []
    for end, now in steps:
        one = estimate(end, status=now) if isinstance(now, Status) else estimate(end, J=now)
        found.append(monitor.update(one))
    # 1.08 is outside of the tolerance, but not far: the time begins anew; and time at rest is no motion
    assert [bool(drifts) for drifts in found] == [False] * 9 + [True]
    assert found[-1][0].since == 10.0
    for k in range(100):  # wrong estimates after a restart of the identification, always corrected within 25 s
        monitor = monitor if k else DriftMonitor(estimate())
        assert not monitor.update(estimate(30.0 * k, J=1.5))
        assert not monitor.update(estimate(30.0 * k + 24.0, J=1.5))
        assert not monitor.update(estimate(30.0 * k + 25.0))


def test_a_drift_to_the_other_side_is_another_one():
    monitor = DriftMonitor(estimate(), AT_ONCE)
    (above,) = monitor.update(estimate(1.0, J=1.5))
    (below,) = monitor.update(estimate(2.0, J=0.5))
    assert (above.since, below.since) == (1.0, 2.0)
    assert "50 ± 1.4 % below its baseline" in below.text


def test_without_evidence_it_stays_as_it_was():
    monitor = DriftMonitor(estimate(), AT_ONCE)
    (drift,) = monitor.update(estimate(1.0, J=1.5))
    for status in (Status.POOR_FIT, Status.NO_MOTION, Status.TOO_SHORT, Status.MAX_ITERATIONS):
        assert monitor.update(estimate(2.0, status=status, J=1.0, c=3.0)) == (drift,)
    for word in (Verdict.PRIOR, Verdict.NOT_EXCITED, Verdict.AT_BOUND):
        assert monitor.update(verdict(estimate(3.0, J=1.0), "J", word)) == (drift,)
    for value, std_dev in ((math.nan, 0.01), (1.0, math.nan), (1.0, 0.0), (math.inf, 0.01)):
        assert monitor.update(estimate(4.0, std_dev, J=value)) == (drift,)
    assert monitor.update(estimate(5.0)) == ()


def test_a_parameter_that_the_baseline_does_not_know_is_not_compared():
    monitor = DriftMonitor(verdict(estimate(), "J", Verdict.PRIOR), AT_ONCE)
    assert names(monitor.update(estimate(1.0, J=5.0, c=2.0))) == ["c"]


def test_what_cannot_be_compared_is_refused_with_a_reason():
    monitor = DriftMonitor(estimate(), AT_ONCE)
    for other, text in (
        (replace(estimate(), model="motor_side"), r"of model rigid_joint \(gravity=False\), the .* of motor_side"),
        (replace(estimate(), model_options={"gravity": True}), r"are of rigid_joint \(gravity=True\): set a new"),
        (verdict(estimate(), "c", Verdict.FIXED), "c was estimated in the baseline and is held now"),
        (verdict(estimate(), "N", Verdict.ESTIMATED), "N was held in the baseline and is free now"),
        (
            replace(estimate(), parameters=tuple(replace(p, value=50.0) for p in estimate().parameters)),
            "N was held at 101 in the baseline and is held at 50 now: set a new baseline",
        ),
    ):
        with pytest.raises(JointIdError, match=text):
            monitor.update(other)
    for bad, text in (
        (estimate(status=Status.POOR_FIT), "cannot be a baseline: as it is"),
        (estimate(std_dev=math.nan), "determines no parameter"),
    ):
        with pytest.raises(JointIdError, match=text):
            DriftMonitor(bad)


def test_a_known_slope_takes_the_temperature_out():
    options = DriftOptions(drift_confirm_s=0.0, drift_per_kelvin=("c=-0.02",))
    monitor = DriftMonitor(estimate(temperature=30.0), options)
    warm = math.exp(-0.02 * 20.0)
    assert monitor.update(estimate(1.0, temperature=50.0, c=warm)) == ()
    assert names(DriftMonitor(estimate(), AT_ONCE).update(estimate(1.0, temperature=50.0, c=warm))) == ["c"]
    (drift,) = monitor.update(estimate(2.0, temperature=50.0, c=1.2 * warm))
    assert (drift.baseline, drift.warmer) == (pytest.approx(warm), 20.0)
    assert drift.text.startswith("c is 20 ±") and drift.text.endswith("the joint is 20 K warmer")
    assert monitor.update(estimate(3.0, temperature=math.nan)) == (drift,)  # no temperature, no evidence
    with pytest.raises(JointIdError, match="no parameter 'weight': it has J, c"):
        DriftMonitor(estimate(), DriftOptions(drift_per_kelvin=("weight=0.1",)))
    with pytest.raises(JointIdError, match="the temperature at the baseline is not known"):
        DriftMonitor(estimate(temperature=math.nan), options)
    with pytest.raises(JointIdError, match="drift_per_kelvin c=warm: 'warm' is not a number"):
        DriftOptions(drift_per_kelvin=("c=warm",))
    with pytest.raises(JointIdError, match="the slope of c is nan"):
        DriftOptions(drift_per_kelvin=("c=nan",))


def test_a_baseline_near_zero_is_told_in_its_unit():
    monitor = DriftMonitor(estimate(tau_f=0.001), AT_ONCE)
    (drift,) = monitor.update(estimate(1.0, tau_f=0.2))
    assert drift.text.startswith("tau_f is 0.199 ± 0.014 above its baseline")


def test_baselines_come_back_from_their_file(tmp_path):
    path = tmp_path / "baselines.json"
    assert baseline_file.load(path) == {}
    kept = {"wrist": estimate(3.0), "elbow": estimate(4.0, J=2.0, temperature=math.nan)}
    baseline_file.save(path, kept)
    again = baseline_file.load(path)
    assert again == kept
    assert names(DriftMonitor(again["elbow"], AT_ONCE).update(estimate(5.0))) == ["J"]
    content = json.loads(path.read_text())
    for spoil, text in (
        ("{", "not a JSON file"),
        ("[]", "no baselines"),
        (json.dumps(estimate().to_dict()), "no baselines"),
        (json.dumps(content | {"version": 9}), "reads up to 1: update joint_id"),
        (json.dumps(content | {"joints": {"elbow": {}}}), "not an estimate"),
    ):
        path.write_text(spoil)
        with pytest.raises(JointIdError, match=rf"baselines\.json: .*{text}"):
            baseline_file.load(path)
    with pytest.raises(JointIdError, match="cannot be written"):
        baseline_file.save(tmp_path / "missing" / "file.json", kept)
    with pytest.raises(JointIdError, match="cannot be read"):
        baseline_file.load(tmp_path)
