"""What computed loads may be off by while samples arrive, and what online estimates make of it."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from joint_id_core.data.recording import Recording
from joint_id_core.estimators.matched_load import MatchedLoad
from joint_id_core.models import build
from joint_id_core.online import OnlineIdentifier
from joint_id_core.online.window import SlidingWindow

from .moving_arm import COULOMB, JOINTS, RATE, URDF, VISCOUS
from .test_matched_load import GAIN, moved, real

pytest.importorskip("pinocchio", reason="a robot's description needs Pinocchio")
pytest.importorskip("mujoco", reason="the arm of these tests is one of MuJoCo")

from joint_id_core.arm.description import Description
from joint_id_core.arm.loaded import loaded
from joint_id_core.arm.online_errors import OnlineErrors

RIGID, LOAD = build("rigid_joint"), "external_torque"
SEED, BATCH = 1, 25
TRUE = real(SEED)


def errors() -> OnlineErrors:
    return OnlineErrors(Description(URDF))


@functools.cache
def samples(seconds: float = 18.0) -> dict[str, Recording]:
    """What the filter makes of an arm whose masses are not those of its description: the load is that of the latter."""
    arm, found = moved(TRUE, SEED, seconds), {}
    time = arm["turn"].time
    for name in JOINTS:
        own = loaded(Description(URDF), name, [arm]).recordings[0]
        found[name] = arm[name].with_channels({LOAD: np.interp(time, own.time, own[LOAD], np.nan, np.nan)}, True)
    return found


def arriving(seconds: float = 18.0):
    """The same, some samples at a time."""
    whole = samples()
    for k in range(0, round(seconds * RATE), BATCH):
        yield {name: recording.slice(k, k + BATCH) for name, recording in whole.items()}


def test_they_are_those_of_the_whole_recording():
    window, online = SlidingWindow(100.0), errors()
    for part in arriving(6.0):
        window.append(online.attached(part)["lift"])
    stream = window.recording()
    whole = loaded(Description(URDF), "lift", [moved(TRUE, SEED, 18.0)]).recordings[0].load_errors
    time = stream.time[200:-200]
    wanted = whole.at(time)
    assert stream.load_errors.of == whole.of
    assert np.abs(stream.load_errors.at(time) - wanted).max() < 0.01 * np.abs(wanted).max()


@pytest.mark.long
def test_friction_is_right_live_though_masses_are_not():
    estimates = {True: [], False: []}
    for known, found in estimates.items():
        identifier, online = OnlineIdentifier(RIGID), errors()
        for part in arriving():
            part = online.attached(part) if known else part
            estimate = identifier.update(part["lift"])
            if estimate is not None and estimate.end > 12.0:
                found.append(estimate)
    k = JOINTS.index("lift")
    for estimate in estimates[True]:
        assert estimate.converged, estimate.message
        for name, truth in (("c", GAIN * VISCOUS[k]), ("tau_f", GAIN * COULOMB[k])):
            row = estimate[name]
            assert abs(row.value - truth) < 4.0 * row.std_dev < 0.3 * truth, (estimate.end, row, truth)
    share = np.mean([estimate.converged for estimate in estimates[False]])
    assert share < 0.5, "with the load as computed it would be known, too"


@pytest.mark.parametrize("lacking", ["a joint", "a position", "the load", "instants"])
def test_samples_without_the_motion_of_the_arm_stay_as_they_are(lacking):
    part = next(arriving())
    lift = part["lift"]
    if lacking == "a joint":
        del part["spin"]
    elif lacking == "a position":
        rest = {n: v for n, v in part["spin"].channels.items() if n != "link_position"}
        part["spin"] = part["spin"].trusted(part["spin"].time, rest, part["spin"].derived)
    elif lacking == "the load":
        part = {
            n: r.trusted(r.time, {m: v for m, v in r.channels.items() if m != LOAD}, frozenset())
            for n, r in part.items()
        }
    else:
        part["spin"] = part["spin"].slice(0, 5)
    found = errors().attached(part)
    assert found["lift"].load_errors is None
    assert found.keys() == part.keys() and len(found["lift"]) == len(lift)


def test_a_description_with_joints_that_follow_others_tells_no_errors():
    follows = '<mimic joint="tilt"/></joint>'
    head, _, tail = URDF.partition('<joint name="spin"')
    mimic = OnlineErrors(Description(head + '<joint name="spin"' + tail.replace("</joint>", follows, 1)))
    assert mimic.attached(next(arriving()))["lift"].load_errors is None


def test_samples_from_before_the_description_are_left_out():
    """Errors are not known there, and must not be those of the first instant at which they are."""
    window, online = SlidingWindow(100.0), errors()
    for k, part in enumerate(arriving(12.0)):
        window.append((online.attached(part) if k > 40 else part)["lift"])
    recording = window.recording()
    found = MatchedLoad(RIGID, [recording], None).of(recording)[LOAD]
    assert np.isnan(found[: 40 * BATCH]).all() and np.isfinite(found[47 * BATCH : -200]).all()


def test_another_run_begins_anew():
    """Its instants may be those of the one before."""
    online, first = errors(), list(arriving(3.0))
    for part in first:
        last = online.attached(part)["lift"]
    time = np.concatenate([part["lift"].time for part in first])
    before = last.load_errors.at(time)
    other = [{n: r.with_channels({"link_position": 0.5 * r["link_position"]}) for n, r in p.items()} for p in first]
    for part in other:
        last = online.attached(part)["lift"]
    after = last.load_errors.at(time)
    known = np.isfinite(before).all(axis=1)
    assert known.mean() > 0.9 and np.abs(after - before)[known].max() > 0.1 * np.abs(before[known]).max()


def test_samples_that_come_one_by_one_tell_the_same():
    few, one_by_one = errors(), errors()
    parts = list(arriving(2.0))
    for part in parts:
        many = few.attached(part)["lift"]
        for k in range(BATCH):
            single = one_by_one.attached({n: r.slice(k, k + 1) for n, r in part.items()})["lift"]
    time = np.linspace(0.5, 1.5, 100)
    wanted = many.load_errors.at(time)
    assert np.abs(single.load_errors.at(time) - wanted).max() < 0.01 * np.abs(wanted).max()
