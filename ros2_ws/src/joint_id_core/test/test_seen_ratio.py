"""A wrong gear ratio is named where only the motor's velocity is measured, as of a UR robot; offline and online."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest

from joint_id_core import formats
from joint_id_core.data.recording import Recording
from joint_id_core.estimators import Innovations, ParameterSettings, Regression, fit
from joint_id_core.estimators.exact_ratio import exact_ratio
from joint_id_core.estimators.seen_ratio import seen_ratio, torque_of_link, with_seen_ratio, wrong_ratio
from joint_id_core.models import build
from joint_id_core.online import OnlineIdentifier, OnlineOptions
from joint_id_core.results.estimate import Estimate, Status
from joint_id_core.simulation import simulate_motion

from .online_motion import MODEL as RIGID
from .online_motion import motion

MODEL = build("motor_side")
SHOWN = r"Motor_velocity is about 101 times that of the link, and the gear ratio N is 60: correct N (--set N=101)"


@pytest.fixture(scope="module")
def moved() -> Recording:
    recording = simulate_motion(MODEL, 4.0)
    return Recording(recording.time, {n: recording[n] for n in ("motor_velocity", "link_position", "torque")})


def bad(status: Status = Status.POOR_FIT) -> Estimate:
    return Estimate("motor_side", "innovations", status, "Bad.", (), notes=("Bad.",))


def told(recording: Recording, ratio: float = 101.0, status: Status = Status.POOR_FIT) -> str:
    return with_seen_ratio(bad(status), MODEL, recording, ParameterSettings({"N": ratio})).message


def test_a_fit_says_which_ratio_it_is(moved):
    found = fit(MODEL, moved.slice(0, 750), ParameterSettings({"N": 60.0}))
    assert found.status is Status.POOR_FIT and found.message.startswith(SHOWN)


def test_an_online_fit_says_it_too(moved):
    identifier = OnlineIdentifier(MODEL, ParameterSettings({"N": 60.0}), OnlineOptions(window_s=1.2, hop_s=0.5))
    given = moved.with_channels({"link_velocity": np.gradient(moved["link_position"], moved.time)}, derived=True)
    found = next(e for k in range(0, 1500, 50) if (e := identifier.update(given.slice(k, k + 50))) and e.status in
                 (Status.POOR_FIT, Status.DIVERGED))  # fmt: skip
    assert re.match(r"Motor_velocity is about 10[012] times .* the gear ratio N is 60: correct N", found.message)


@pytest.mark.parametrize("ratio", [40.0, 1.0, 250.0])
def test_one_that_is_far_off_is_told_without_a_fit(moved, monkeypatch, ratio):
    """For N 40 one fit took the processor for 15 s, and the other joints of an identifier waited."""
    monkeypatch.setattr(Innovations, "fit", pytest.fail)
    monkeypatch.setattr("joint_id_core.online.task.fit_innovations", pytest.fail)
    settings = ParameterSettings({"N": ratio})
    found = fit(MODEL, moved.slice(0, 750), settings)
    identifier = OnlineIdentifier(MODEL, settings, OnlineOptions(window_s=2.0, hop_s=0.5))
    given = moved.with_channels({"link_velocity": np.gradient(moved["link_position"], moved.time)}, derived=True)
    parts = (given.slice(k, k + 50) for k in range(0, 1500, 50))
    live = [e for e in map(identifier.update, parts) if e is not None and e.status is not Status.TOO_SHORT]
    for estimate in (found, *live):
        assert estimate.status is Status.BAD_DATA, estimate.message
        assert f"the gear ratio N is {ratio:.4g}: correct N (--set N=101)" in estimate.message
        assert estimate["N"].value == ratio
    assert live


@pytest.mark.parametrize(("sides", "source"), [(("motor_velocity",), "velocity"), (("motor_position",), "position")])
def test_a_ratio_of_100_is_told_from_one_of_101_without_a_fit(sides, source, monkeypatch):
    """The fit told play and hysteresis. Torque, gravity and resonance twist the gear meanwhile."""
    shown = simulate_motion(build("harmonic_drive", gravity=True), 4.0, values={"a_g": 20.0, "b_g": 5.0})
    recording = Recording(shown.time, {n: shown[n] for n in (*sides, "link_position", "torque")})
    ratio, sigma = exact_ratio(recording)
    assert abs(ratio - 101.0) < 0.1 and sigma < 0.05
    model = build("harmonic_drive", gravity=True)
    assert wrong_ratio(model, "innovations", recording, None) is None
    monkeypatch.setattr(Innovations, "fit", pytest.fail)
    found = fit(model, recording, ParameterSettings({"N": 100.0}))
    assert found.status is Status.BAD_DATA
    said = f"motor_{source} is 101 times that of the link, and the gear ratio N is 100: correct N (--set N=101), or the"
    assert said in found.message


def test_one_with_the_other_sign_is_told_without_a_fit(moved, monkeypatch):
    """It took 30 s where a good fit takes 0.2 s."""
    monkeypatch.setattr(Innovations, "fit", pytest.fail)
    turned = moved.with_channels({"link_position": -moved["link_position"]})
    found = fit(MODEL, turned.slice(0, 750))
    assert found.status is Status.BAD_DATA
    shown = "about -101 times that of the link, and the gear ratio N is 101: correct the factor of the column"
    assert f"{shown} (--map motor_velocity=-1*COLUMN)" in found.message


def test_a_velocity_at_the_link_and_one_in_rpm_have_their_factors(moved):
    for factor, shown in ((1.0 / 101.0, "=101*COLUMN"), (30.0 / np.pi, "=0.1047*COLUMN")):
        assert f"--map motor_velocity{shown}" in told(
            moved.with_channels({"motor_velocity": factor * moved["motor_velocity"]})
        )


def test_nothing_is_said_of_the_right_ratio_a_good_fit_or_a_joint_that_is_held(moved):
    assert told(moved) == told(moved, 100.9) == told(moved, 60.0, Status.CONVERGED) == "Bad."
    offset = moved.with_channels({"motor_velocity": moved["motor_velocity"] + 3.0})
    assert seen_ratio(offset, "motor_velocity") == pytest.approx(101.0, rel=5e-3)
    held = 1e-4 * np.random.default_rng(0).standard_normal(len(moved))
    assert told(moved.with_channels({"link_position": held}), 60.0) == "Bad."
    assert told(moved.with_channels({"link_position": np.full(len(moved), np.nan)}), 60.0) == "Bad."


@pytest.mark.parametrize("missing", [[100], [0], slice(700, 720), slice(None)], ids=["one", "first", "gap", "all"])
def test_a_motor_whose_velocity_is_missing_at_times_has_a_ratio_or_none(moved, missing):
    """It was "nan times that of the link", and nothing was fitted: a driver that starts has its first velocity late."""
    speed = moved["motor_velocity"].copy()
    speed[missing] = np.nan
    found = exact_ratio(moved.with_channels({"motor_velocity": speed}))
    if missing == slice(None):
        assert found is None
    else:
        assert found is not None and found[0] == pytest.approx(101.0, abs=5.0 * found[1])


@pytest.mark.parametrize(("settings", "turns", "said"), [
    (None, 101.0, True),
    (ParameterSettings({"J": 2.0}), -101.0, True),
    (ParameterSettings({"N": 1.0}), 101.0, False),
    (None, 1.0, False),
])  # fmt: skip
@pytest.mark.parametrize("estimator", [Innovations(), Regression()], ids=lambda e: e.name)
def test_a_model_of_the_link_says_that_the_torque_may_be_that_of_the_motor(estimator, settings, turns, said):
    """As of a UR log: with the torque of the motor all values were 101 times too small, and converged."""
    recording = motion(3.0)
    speed = turns * np.gradient(recording["link_position"], recording.time)
    found = fit(RIGID, recording.with_channels({"motor_velocity": speed}), settings, estimator)
    assert found.converged
    text = f"Motor_velocity is about {turns:.3g} times that of the link, and N is 1, as for a torque at the link"
    assert (text in found.message) is said and ("(--set N=101)" in found.message) is said


@pytest.mark.parametrize("wraps", [True, False])
def test_a_motor_position_that_shows_no_ratio_does_not_hide_that_of_the_velocity(wraps):
    """One that wraps, or that was divided by the ratio, left "converged" without a word."""
    recording = motion(3.0)
    link = recording["link_position"]
    angle = (101.0 * link + np.pi) % (2.0 * np.pi) - np.pi if wraps else link
    speed = 101.0 * np.gradient(link, recording.time)
    found = fit(RIGID, recording.with_channels({"motor_position": angle, "motor_velocity": speed}))
    assert "Motor_velocity is about 101 times that of the link, and N is 1" in found.message


def test_info_tells_the_ratio_that_nobody_gave(moved, tmp_path, run):
    path = tmp_path / "both.csv"
    formats.write(path, moved)
    said = re.search(r"the motor goes (\S+) ± (\S+) times as far as the link", run("info", path)[1])
    assert said is not None and abs(float(said[1]) - 101.0) < 0.1 and float(said[2]) < 0.1
    row = json.loads(run("info", path, "--json")[1])["joints"][0]["gear_ratio"]
    assert row["value"] == pytest.approx(float(said[1]), abs=0.1)
    link = Recording(moved.time, {n: moved[n] for n in ("link_position", "torque")})
    alone = tmp_path / "link.csv"
    formats.write(alone, link)
    assert json.loads(run("info", alone, "--json")[1])["joints"][0]["gear_ratio"] is None


@pytest.mark.parametrize(("factor", "ratio", "said"), [(1.0, 101.0, False), (101.0, 101.0, True), (20.0, 160.0, True)])
def test_a_model_of_the_motor_says_that_the_torque_may_be_that_of_the_link(factor, ratio, said):
    """All values of a flexible joint were 101 times too large, and converged, without a word."""
    torque = factor * np.sin(np.arange(0.0, 2.0, 0.002))
    recording = Recording(np.arange(0.0, 2.0, 0.002), {"torque": torque})
    found = list(torque_of_link(build("harmonic_drive"), recording, ParameterSettings({"N": ratio})))
    told = f"{ratio:.4g} times too large (--map torque={1.0 / ratio:.4g}*COLUMN)"
    assert [told in one.text for one in found] == [True] * said
    assert not list(torque_of_link(build("rigid_joint"), recording, None))
    assert not list(torque_of_link(build("harmonic_drive", actuation="current"), recording, None))
