"""Regression on public measurements: published values, and recordings that agree within their intervals.

The data are not part of the project; they are expected beside it, in ../shared/data.
"""

from __future__ import annotations

import functools
import re
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from robots.recordings import kuka, parts, ur3e_shoulder

from joint_id_core.checking.findings import findings
from joint_id_core.data.recording import Array, Recording
from joint_id_core.estimators import DEFAULT, Estimator, Innovations, ParameterSettings, Regression, fit
from joint_id_core.estimators.regression.side_faults import side_fault
from joint_id_core.estimators.regression_starts import started
from joint_id_core.models import build
from joint_id_core.results.estimate import Estimate, Status, Verdict
from joint_id_core.validation.prediction import held_out, held_out_drive

DATA = Path(__file__).resolve().parents[2] / "shared/data"
EMPS, UR10E = DATA / "emps/DATA_EMPS.mat", DATA / "ur10e"
# Nm at the link: config/ur10e.yaml times the gear ratio
PER_AMPERE = {1: 11.8, 2: 12.0, 3: 9.8, 4: 10.7, 5: 10.6, 6: 10.7}
ALL_JOINTS = ("ur-20_02_12-40sec_12harm", "ur-20_02_12-50sec_12harm", "ur-20_02_19_14harm50sec")

pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason=f"measured data are not there: {DATA}")


@functools.cache
def ur10e_table(name: str) -> Array:
    table = np.genfromtxt(UR10E / f"{name}.csv", delimiter=",")
    return table[np.concatenate([[True], np.diff(table[:, 0]) > 0.0])]  # some stamps repeat


def ur10e(name: str, joint: int, load: bool = False) -> Recording:
    table = ur10e_table(name)
    torque = PER_AMPERE[joint] * table[:, 12 + joint]
    channels = {"link_position": table[:, joint], "torque": torque}
    if load:
        channels["external_torque"] = table[:, 24 + joint]
    return Recording(table[:, 0], channels, source=name)


def found(recording: Recording, gravity: bool = False, estimator: Estimator | None = None) -> Estimate:
    return fit(build("rigid_joint", gravity=gravity), recording, estimator=estimator or Regression())


def test_emps_has_the_published_parameters():
    """Janot, Gautier and Brunot 2019."""
    record = scipy.io.loadmat(EMPS)
    force = record["vir"].ravel() * record["gtau"].item()
    result = found(Recording(record["t"].ravel(), {"link_position": record["qm"].ravel(), "torque": force}))
    assert result.converged
    for name, published in {"J": 95.1089, "c": 203.5034, "tau_f": 20.3935, "tau_0": -3.1648}.items():
        assert abs(result[name].value - published) < min(2.0 * result[name].std_dev, 0.03 * abs(published))


def agreement(estimates: list[Estimate], names: tuple[str, ...] = ("c", "tau_f")) -> list[bool]:
    """Whether the 95 % interval of the difference holds zero, for every pair of recordings."""
    agree = []
    for name in names:
        assert {e[name].verdict for e in estimates} == {Verdict.ESTIMATED}
        values = [(e[name].value, e[name].std_dev) for e in estimates]
        agree += [abs(a[0] - b[0]) < 1.96 * np.hypot(a[1], b[1]) for a, b in combinations(values, 2)]
    return agree


@pytest.mark.parametrize(
    "estimator", [DEFAULT, pytest.param(Regression(), marks=pytest.mark.long)], ids=lambda estimator: estimator.name
)
def test_thirds_of_a_record_of_one_joint_agree_within_their_intervals(estimator):
    """Their means are those of the data's authors (joint 1, least squares) and of the whole arm (joint 4)."""
    agree, sigma = [], []
    for joint, gravity, c, tau_f in ((1, False, 25.9, 16.1), (4, True, 3.6, 2.8)):
        record = ur10e(f"ur-20_01_22-joint_{joint}", joint)
        count = len(record) // 3
        thirds = [found(record.slice(k * count, (k + 1) * count), gravity, estimator) for k in range(3)]
        assert np.mean([e["c"].value for e in thirds]) == pytest.approx(c, rel=0.05)
        assert np.mean([e["tau_f"].value for e in thirds]) == pytest.approx(tau_f, rel=0.05)
        sigma += [e[n].std_dev / e[n].value for e in thirds for n in ("c", "tau_f")]
        agree += agreement(thirds)
    assert np.median(sigma) < 0.05
    assert np.mean(agree) > 0.8


@pytest.mark.long
def test_a_short_move_of_a_shoulder_shows_its_friction():
    """The inertia is not known by `innovations`; friction is, and both halves agree."""
    halves = [found(half, True, DEFAULT) for half in parts(ur3e_shoulder(), 2)]
    assert all(e.status in (Status.CONVERGED, Status.DISAGREE) for e in halves)
    assert all(agreement(halves))
    assert all(e["tau_f"].std_dev < 0.1 * e["tau_f"].value for e in halves)


def test_recordings_with_all_joints_moving_agree_within_their_intervals():
    """Base and last two wrists, whose loads the other joints change least; Newey-West, not white residuals."""
    agree = [a for j in (1, 5, 6) for a in agreement([found(ur10e(name, j)) for name in ALL_JOINTS])]
    assert np.mean(agree) > 0.8


@pytest.mark.long
@pytest.mark.parametrize(
    "names", [ALL_JOINTS[:1], pytest.param(ALL_JOINTS[1:], marks=pytest.mark.long)], ids=["one log", "two more"]
)
def test_joints_whose_load_the_others_change_are_poor_fits(names):
    """Lift, elbow and first wrist, by either estimator: on the lift J is 17.5 kg m2, and was 100 and more."""
    for joint in (2, 3, 4):
        for estimator in (Regression(), Innovations()):
            for name in names:
                result = fit(build("rigid_joint", gravity=True), ur10e(name, joint), estimator=estimator)
                assert result.status is Status.POOR_FIT, (joint, estimator, name, str(result))


@pytest.mark.long
def test_an_inertia_that_two_estimators_do_not_agree_on_is_no_good_estimate():
    """Wrists 2 and 3, 0.43 and 0.42 kg m2 by a fit of the whole arm; `innovations` alone finds 0.85 to 3."""
    for joint, truth in ((5, 0.43), (6, 0.42)):
        for name in ALL_JOINTS:
            result = fit(build("rigid_joint", gravity=True), ur10e(name, joint), estimator=Innovations())
            assert result.status is Status.DISAGREE and "J is " in result.message
            assert abs(result["J"].value - truth) < 1.96 * result["J"].std_dev


def test_friction_with_the_controllers_load_is_that_of_the_whole_arm():
    """With `target_moment` as external torque; +- of the reference is the spread between seven logs."""
    reference = {
        1: (21.9, 1.3, 16.4, 0.4), 2: (18.4, 1.6, 17.0, 0.9), 3: (9.6, 0.7, 6.8, 0.3), 4: (3.6, 0.2, 2.8, 0.1),
        5: (2.45, 0.1, 3.2, 0.05), 6: (3.2, 0.2, 2.5, 0.05),
    }  # fmt: skip
    off = []
    for joint, (c, c_sigma, tau_f, tau_f_sigma) in reference.items():
        for name in ALL_JOINTS:
            result = found(ur10e(name, joint, load=True))
            assert result.converged
            off += [
                (result[n].value - value) / np.hypot(result[n].std_dev, sigma)
                for n, value, sigma in (("c", c, c_sigma), ("tau_f", tau_f, tau_f_sigma))
            ]
    assert np.abs(off).max() < 2.0


def test_a_wrist_without_gravity_is_a_poor_fit():
    result = found(ur10e("ur-20_01_22-joint_4", 4))
    assert result.status is Status.POOR_FIT and "--gravity" in result.message


def test_a_fit_without_inertia_predicts_another_recording():
    """With the controller's torque as load, which holds the inertia, the regression finds none."""
    model = build("rigid_joint")
    fitted = fit(model, ur10e(ALL_JOINTS[0], 5, load=True), estimator=Regression())
    assert fitted["J"].value == 0.0
    other = ur10e(ALL_JOINTS[1], 5, load=True)
    explained = held_out_drive(model, other, fitted)
    assert explained is not None and explained[1] > 0.95
    assert "link_position" in held_out(model, other, fitted)


def test_no_lag_of_a_robots_current_is_invented():
    """Friction that is not what the law says looks like a lag of 10 to 30 ms; a true one is found."""
    for name, joint, gravity in (("ur-20_01_22-joint_1", 1, False), (ALL_JOINTS[1], 6, True)):
        assert not any("against the motion" in note for note in found(ur10e(name, joint), gravity).notes)
    record = scipy.io.loadmat(EMPS)
    time, force = record["t"].ravel(), record["vir"].ravel() * record["gtau"].item()
    for late, text in ((0.0, ""), (0.02, "19.8 ms late")):
        shifted = np.interp(time - late, time, force)
        notes = found(Recording(time, {"link_position": record["qm"].ravel(), "torque": shifted})).notes
        told = [note for note in notes if "against the motion" in note]
        assert len(told) == bool(text) and all(text in note for note in told)


def test_the_late_velocities_of_a_kuka_are_named_and_those_of_a_ur_are_not():
    table = ur10e_table(ALL_JOINTS[0])
    for joint in range(1, 7):
        channels = {"link_position": table[:, joint], "link_velocity": table[:, 6 + joint]}
        assert not findings(Recording(table[:, 0], channels))
    kuka = scipy.io.loadmat(DATA / "kuka_kr300/trajectory_A.mat", squeeze_me=True, struct_as_record=False)
    signals, ratios = kuka["rec"], kuka["para"].u
    for axis in (0, 1, 2):
        channels = {
            "motor_position": np.radians(signals.act_pos_mot_deg[axis]) * ratios[axis],
            "motor_velocity": np.radians(signals.act_vel_mot_deg_per_s[axis]) * ratios[axis],
            "link_position": np.radians(signals.act_pos_se_deg[axis]),
            "link_velocity": np.radians(signals.act_vel_se_deg_per_s[axis]),
        }
        motor, link = findings(Recording(0.004 * np.arange(2501), channels))
        assert "motor_velocity is late by 4." in motor.text and "link_velocity is late by 23" in link.text
        assert not motor.fatal and not link.fatal


@pytest.mark.parametrize(("axis", "published"), [(1, None), (2, 7.519e6), (3, 4.100e6)])
def test_stiffness_of_a_kuka_is_the_published_one_or_not_known(axis, published):
    """Two runs together, with the motor inertia of the data sheet. These runs do not show the stiffness of axis 1."""
    runs = [kuka(run, axis) for run in "AB"]
    settings = ParameterSettings({"N": runs[0][0], "J_m": 0.0118, "k_2": 0.0}, ("J_m", "k_2"))
    result = fit(build("motor_side", delays=True), [recording for _, recording in runs], settings, Regression())
    assert result.converged
    assert 0.0025 < result["delta_q"].value < 0.0035  # published: 2.7 to 3.1 ms
    stiffness = result["k_1"]
    if published is None:
        assert stiffness.verdict is not Verdict.ESTIMATED
    else:
        assert stiffness.verdict is Verdict.ESTIMATED
        assert abs(stiffness.value - published) < min(0.3 * published, 2.0 * stiffness.std_dev)


@pytest.mark.parametrize("parts", [1, pytest.param(2, marks=pytest.mark.long)], ids=["whole", "halves"])
def test_of_the_axes_of_a_kuka_the_late_encoders_are_named_and_nothing_else(parts):
    """Published: they are 2.7 to 3.1 ms late. Half of a recording does not tell it beyond doubt."""
    found = []
    for run in "AB":
        for axis in range(1, 7):
            ratio, recording = kuka(run, axis)
            count = len(recording) // parts
            found += [side_fault(recording.slice(k * count, (k + 1) * count), "torque", ratio) for k in range(parts)]
    named = [text for text in found if text]
    assert named or parts > 1
    assert all(re.match("the link's encoder is (2[.][7-9]|3|3[.]1) ms late", text) for text in named), named


@pytest.mark.long
@pytest.mark.parametrize("axis", [1, *(pytest.param(k, marks=pytest.mark.long) for k in (2, 3))])
def test_nothing_of_a_kuka_that_is_called_good_is_far_off(axis):
    """Its residual torque has a memory: a fit that takes it for white found a motor inertia 22 sigma off."""
    for run in "AB":
        ratio, recording = kuka(run, axis)
        for estimator in (Innovations(), Regression()):
            result = fit(build("motor_side", delays=True), recording, ParameterSettings({"N": ratio}), estimator)
            inertia = result["J_m"]
            if result.converged and inertia.verdict is Verdict.ESTIMATED:
                assert abs(inertia.value - 0.0118) < 4.0 * inertia.std_dev


@pytest.mark.parametrize("run", "AB")
@pytest.mark.parametrize("axis", [1, 2, 3])
def test_the_offset_of_the_encoders_is_a_start_only_with_a_stiffness(run, axis):
    """It is the torque offset over the stiffness: with that of the table, of a cobot, it would be a radian and more."""
    ratio, recording = kuka(run, axis)
    values = started(build("motor_side", delays=True), recording, ParameterSettings({"N": ratio})).values
    assert ("dtheta_0" in values) <= ("k_1" in values)
    assert abs(values.get("dtheta_0", 0.0)) < 0.01
