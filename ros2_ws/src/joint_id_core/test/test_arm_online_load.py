"""The load of an arm while samples arrive: that of whole recordings, and what online estimates make of it."""

from __future__ import annotations

import numpy as np
import pytest

from joint_id_core.data.recording import Recording
from joint_id_core.estimators import ParameterSettings
from joint_id_core.models import build
from joint_id_core.online import OnlineIdentifier
from joint_id_core.results.estimate import Status

from . import moving_arm
from .moving_arm import (
    COULOMB,
    DAMPING_S,
    JOINTS,
    LINK_VISCOUS,
    ONE_QUICK,
    RATIO,
    ROTOR,
    STIFFNESS,
    URDF,
    VISCOUS,
    joint,
    link,
)

pytest.importorskip("pinocchio", reason="a robot's description needs Pinocchio")
pytest.importorskip("mujoco", reason="the arm of these tests is one of MuJoCo")

from joint_id_core.arm.description import Description
from joint_id_core.arm.loaded import loaded
from joint_id_core.arm.online_load import OnlineLoad, with_unknown_load
from joint_id_core.arm.typical_inertia import typical_inertia

from .arm_stream import as_recordings, batches, passed
from .quick import first_quick

RIGID, FLEXIBLE = build("rigid_joint"), build("harmonic_drive")
MAX_GAP = 5.0
UNSETTLED_S = 0.6  # after a start or a gap the load is not known for so long


@pytest.fixture(scope="module")
def rigid() -> dict[str, Recording]:
    return moving_arm.rigid(12.0)


@pytest.fixture(scope="module")
def online(rigid) -> dict[str, Recording]:
    return as_recordings(passed(OnlineLoad(Description(URDF), MAX_GAP), batches(rigid)))


@pytest.mark.parametrize("name", first_quick(JOINTS, 2))
def test_it_is_the_load_of_the_whole_recording(rigid, online, name):
    """But for what the cut of the backward pass leaves out; near its end the whole recording is less accurate."""
    whole, stream = loaded(Description(URDF), name, [rigid]).recordings[0], online[name]
    assert stream.derived == {"external_torque"} == whole.derived
    np.testing.assert_allclose(stream.time, rigid[name].time, atol=1e-6)
    load = stream["external_torque"][np.searchsorted(stream.time, whole.time - 1e-6)]
    assert np.count_nonzero(np.isnan(load)) < UNSETTLED_S * moving_arm.RATE
    known = np.isfinite(load) & (whole.time < whole.time[-1] - 0.5)
    away = load[known] - whole["external_torque"][known]
    assert np.sqrt(np.mean(away**2)) < 2e-4 * np.std(whole["external_torque"])


def test_no_sample_is_lost_or_changed(rigid, online):
    for name, stream in online.items():
        for channel in ("link_position", "torque"):
            np.testing.assert_array_equal(stream[channel], rigid[name][channel])


def test_results_do_not_depend_on_how_samples_arrive(rigid, online):
    few = {name: r.slice(0, 1500) for name, r in rigid.items()}
    one_by_one = as_recordings(passed(OnlineLoad(Description(URDF), MAX_GAP), batches(few, 1), to_the_end=False))
    for name, stream in one_by_one.items():
        np.testing.assert_allclose(
            stream["external_torque"], online[name]["external_torque"][: len(stream)], rtol=1e-9, atol=1e-9
        )


def test_it_waits_for_the_latency_and_not_longer(rigid):
    load = OnlineLoad(Description(URDF), MAX_GAP)
    few = {name: r.slice(0, 1000) for name, r in rigid.items()}
    done = as_recordings(passed(load, batches(few, 1), to_the_end=False))["lift"]
    assert rigid["lift"].time[999] - done.time[-1] <= load.latency + 1e-9 < 0.2


def test_a_joint_without_values_leaves_the_load_unknown_until_it_is_back(rigid):
    load, parts = OnlineLoad(Description(URDF), MAX_GAP), list(batches(rigid))
    gone = JOINTS.index("tilt")
    for k in range(400, 500):  # from 4 s to 5 s
        parts[k].channels["link_position"][:, gone] = np.nan
    done = []
    for k, part in enumerate(parts):
        done += load.add(part)
        assert load.missing == (("tilt",) if 400 <= k < 500 else ())
    stream = as_recordings(done)["lift"]
    unknown = stream.time[np.isnan(stream["external_torque"])]
    unknown = unknown[unknown > UNSETTLED_S]
    assert 4.0 - load.latency < unknown.min() < 4.0 and 5.0 < unknown.max() < 5.0 + UNSETTLED_S
    whole = loaded(Description(URDF), "lift", [rigid]).recordings[0]
    late = stream.window(6.0, 11.0)
    torque = np.interp(late.time, whole.time, whole["external_torque"])
    np.testing.assert_allclose(late["external_torque"], torque, atol=0.05)


def test_joints_that_are_missing_or_strange_are_named(rigid):
    five = {name: r for name, r in rigid.items() if name != "spin"} | {"gripper": rigid["spin"]}
    load = OnlineLoad(Description(URDF, "robot.urdf"), MAX_GAP)
    found = as_recordings(passed(load, batches({name: r.slice(0, 1000) for name, r in five.items()})))
    assert load.missing == ("spin",)
    assert set(load.unloaded) == {"gripper"} and "robot.urdf: it has no 'gripper'" in load.unloaded["gripper"]
    assert all(np.isnan(stream["external_torque"]).all() for stream in found.values())


def test_more_joints_than_the_description_has_do_no_harm(rigid, online):
    seven = {"rail": rigid["turn"]} | {name: r.slice(0, 2000) for name, r in rigid.items()}
    seven["rail"] = seven["rail"].slice(0, 2000)
    found = as_recordings(passed(OnlineLoad(Description(URDF), MAX_GAP), batches(seven), to_the_end=False))
    assert np.isnan(found["rail"]["external_torque"]).all()
    for name in JOINTS:
        np.testing.assert_array_equal(
            found[name]["external_torque"], online[name]["external_torque"][: len(found[name])]
        )


def test_a_joint_that_drives_another_one_has_no_load(rigid):
    """Nor has the one that follows it; the others have."""
    more = link("left", 0.2, (0.0, 0.05, 0.02), 1e-4) + link("right", 0.2, (0.0, -0.05, 0.02), 1e-4)
    more += joint("close", "tool", "left", 'xyz="0 0 0.1"', "0 1 0", "prismatic")
    more += joint("other", "tool", "right", "", "0 1 0", "prismatic", '<mimic joint="close" multiplier="-1"/>')
    load = OnlineLoad(Description(URDF.replace("</robot>", f"{more}</robot>")), MAX_GAP)
    hand = {name: rigid["spin"].slice(0, 1000) for name in ("close", "other")}
    found = as_recordings(passed(load, batches({name: r.slice(0, 1000) for name, r in rigid.items()} | hand)))
    assert set(load.unloaded) == {"close", "other"} and all("follows" in why for why in load.unloaded.values())
    assert np.isnan(found["close"]["external_torque"]).all()
    assert np.isfinite(found["lift"]["external_torque"]).any()


@pytest.mark.parametrize("shift_s", first_quick([-3600.0, 3600.0, 2e5]))
def test_a_new_run_begins_anew(rigid, shift_s):
    load, parts = OnlineLoad(Description(URDF), MAX_GAP), list(batches(rigid))[:300]
    shifted = [p._replace(instants_ns=[ns + round(1e9 * shift_s) for ns in p.instants_ns]) for p in parts]
    done = passed(load, [*parts, *shifted])
    times = [ns for part in done for ns in part.instants_ns]
    assert times == [ns for part in [*parts, *shifted] for ns in part.instants_ns]
    torque = np.concatenate([part.channels["external_torque"] for part in done])
    first, second = torque[: len(times) // 2], torque[len(times) // 2 :]
    both = np.isfinite(first) & np.isfinite(second)
    assert np.count_nonzero(both.all(axis=1)) > 900
    np.testing.assert_allclose(first[both], second[both], rtol=1e-5, atol=1e-6)


def test_a_position_that_jumps_by_a_turn_gives_the_same_load(rigid, online):
    """Joints that turn for ever are often told within one turn."""
    wrapped = {name: r.slice(0, 3000) for name, r in rigid.items()}
    jumps = np.mod(wrapped["roll"]["link_position"], 2.0 * np.pi)
    assert np.abs(np.diff(jumps)).max() > 6.0
    wrapped["roll"] = wrapped["roll"].with_channels({"link_position": jumps})
    found = as_recordings(passed(OnlineLoad(Description(URDF), MAX_GAP), batches(wrapped), to_the_end=False))
    np.testing.assert_array_equal(found["roll"]["link_position"], jumps[: len(found["roll"])])
    for name in ("lift", "roll", "tilt"):
        load = online[name]["external_torque"][: len(found[name])]
        np.testing.assert_allclose(found[name]["external_torque"], load, rtol=1e-4, atol=1e-4)


def test_samples_without_positions_have_no_load(rigid):
    motor = {name: Recording(r.time, {"motor_position": r["link_position"]}) for name, r in rigid.items()}
    load = OnlineLoad(Description(URDF), MAX_GAP)
    found = as_recordings(passed(load, batches({name: r.slice(0, 500) for name, r in motor.items()})))
    assert load.missing == JOINTS and np.isnan(found["lift"]["external_torque"]).all()


# --- estimates


def last_estimate(identifier: OnlineIdentifier, recording: Recording, size: int = 25):
    """The last estimate of a recording that comes in parts."""
    newest = None
    for k in range(0, len(recording), size):
        newest = identifier.update(recording.slice(k, k + size)) or newest
    return newest


@pytest.mark.parametrize("name", ONE_QUICK)
def test_a_rigid_joint_is_found_online_while_all_joints_move(online, name):
    k = JOINTS.index(name)
    estimate = last_estimate(OnlineIdentifier(RIGID), online[name])
    assert estimate.converged, estimate.message
    links = typical_inertia(Description(URDF))[k]
    for parameter, truth in (("J", ROTOR[k] + links), ("c", VISCOUS[k]), ("tau_f", COULOMB[k])):
        row = estimate[parameter]
        assert abs(row.value - truth) < 4.0 * row.std_dev, (parameter, row, truth)
        assert row.std_dev < 0.03 * truth


def test_no_number_comes_of_a_load_that_is_not_known(rigid):
    unknown = as_recordings([with_unknown_load(part) for part in batches(rigid)])["lift"]
    estimate = last_estimate(OnlineIdentifier(RIGID), unknown)
    assert estimate.status is Status.MISSING_SIGNAL and "load of the rest of the arm" in estimate.message
    assert np.isnan(estimate["J"].std_dev)


def test_what_is_known_stays_while_the_load_is_not(rigid, online):
    identifier, lift = OnlineIdentifier(RIGID), online["lift"]
    known = last_estimate(identifier, lift.slice(0, 4000))
    without = lift.slice(4000, 5500).with_channels({"external_torque": np.full(1500, np.nan)}, derived=True)
    during = last_estimate(identifier, without)
    assert known.converged and during.status is Status.MISSING_SIGNAL
    assert abs(during["J"].value - known["J"].value) < known["J"].std_dev
    after = last_estimate(identifier, lift.slice(5500, 5900))
    assert after.converged, after.message
    assert abs(after["J"].value - known["J"].value) < 3.0 * known["J"].std_dev


HELD = ParameterSettings({"N": RATIO, "k_2": 0.0, "tau_fq": 0.0}, fixed=["k_2", "tau_fq"])


def truth_of(k: int) -> dict[str, float]:
    """Parameters of the flexible joint number k."""
    return {
        "J_m": ROTOR[k] / RATIO**2, "k_1": STIFFNESS[k], "J_q": typical_inertia(Description(URDF))[k],
        "c_q": LINK_VISCOUS * VISCOUS[k], "c_m": (1.0 - LINK_VISCOUS) * VISCOUS[k] / RATIO**2,
        "tau_fm": COULOMB[k] / RATIO, "c_1": DAMPING_S * STIFFNESS[k],
    }  # fmt: skip


@pytest.fixture(scope="module", params=[moving_arm.at, moving_arm.with_rests], ids=["moving", "with rests"])
def flexible(request) -> dict[str, Recording]:
    recordings = moving_arm.flexible(16.0, path=request.param)
    return as_recordings(passed(OnlineLoad(Description(URDF), MAX_GAP), batches(recordings)))


@pytest.mark.long
@pytest.mark.parametrize("name", JOINTS)
def test_flexible_joints_are_found_online_while_all_of_them_move(flexible, name):
    estimate = last_estimate(OnlineIdentifier(FLEXIBLE, HELD), flexible[name])
    assert estimate.status in (Status.CONVERGED, Status.POOR_FIT, Status.NO_MOTION), estimate.message
    for parameter, truth in truth_of(JOINTS.index(name)).items():
        row = estimate[parameter]
        assert abs(row.value - truth) < 4.0 * row.std_dev, (parameter, row, truth)
    assert estimate["c_1"].std_dev >= 0.5 * estimate["c_1"].value
