"""Joints whose load on another one nobody knows: they are named in its estimates."""

from __future__ import annotations

import numpy as np
import pytest

from joint_id_core.data.recording import Recording
from joint_id_core.estimators import fit
from joint_id_core.models import build
from joint_id_core.online.others_moving import OthersMoving
from joint_id_core.results.estimate import Status

from .online_motion import MODEL, motion

NOISE, SHAKEN = 1e-5, 5e-4  # rad: an encoder's, and how far joints of a UR3e go that stand while another moves


@pytest.fixture(scope="module")
def estimate():
    """That of a joint in the window from 2 to 4 s."""
    found = fit(MODEL, motion().window(2.0, 4.0))
    assert found.converged
    return found


def robot(**amplitudes: float) -> dict[str, Recording]:
    """Two joints beside "own", which swing by so many rad in the first seconds."""
    time, rng = np.arange(0.0, 3.0, 0.002), np.random.default_rng(0)
    swing = {name: a * np.sin(2.0 * time) + NOISE * rng.standard_normal(len(time)) for name, a in amplitudes.items()}
    return {name: Recording(time, {"link_position": q}) for name, q in swing.items()}


def told(estimate, recordings, model=MODEL, **more):
    """The estimate of "own" after samples of all joints in batches."""
    others = OthersMoving()
    own = motion().window(0.0, 3.0)
    own = own.with_channels({name: np.full(len(own), value) for name, value in more.items()})
    for at in np.arange(0.0, 3.0, 0.05):
        others.take({name: r.window(at, at + 0.05 - 1e-9) for name, r in {**recordings, "own": own}.items()})
    return others.told("own", estimate, own, model)


def test_a_joint_that_moves_in_the_window_is_named(estimate):
    found = told(estimate, robot(wrist=0.3, elbow=0.3))
    assert found.message.startswith("Converged. Other joints move, too (elbow, wrist), and their load")
    assert found.status is Status.CONVERGED and found.notes[0] == estimate.notes[0]
    assert set(estimate.notes) < set(found.notes)
    assert found.values == estimate.values


def test_what_changed_is_still_said(estimate):
    several = estimate.updated(notes=("Converged.", "Changed: J.", "This motion hardly shows c.", "More."))
    found = told(several, robot(wrist=0.3))
    assert found.message.startswith("Converged. Changed: J. Other joints move, too (wrist), and")
    assert set(several.notes) < set(found.notes)


def test_one_that_stands_or_is_shaken_is_not(estimate):
    assert told(estimate, robot(wrist=0.0, elbow=SHAKEN)) == estimate
    assert "(elbow)" in told(estimate, robot(wrist=SHAKEN, elbow=0.3)).message


def test_one_that_creeps_is(estimate):
    creeping = robot(wrist=0.0)["wrist"]
    creeping = creeping.with_channels({"link_position": 0.02 * creeping.time})
    assert "(wrist)" in told(estimate, {"wrist": creeping}).message


def test_motion_before_the_window_does_not_count(estimate):
    stopped = robot(wrist=0.3)["wrist"]
    q = np.where(stopped.time < 1.0, stopped["link_position"], stopped["link_position"][500])
    assert told(estimate, {"wrist": stopped.with_channels({"link_position": q})}) == estimate


def test_samples_without_a_position_are_no_motion(estimate):
    unknown = robot(wrist=0.3)["wrist"].with_channels({"link_position": np.full(1500, np.nan)})
    assert told(estimate, {"wrist": unknown}) == estimate


def test_where_the_load_is_known_or_does_not_count_nothing_is_said(estimate):
    moving = robot(wrist=0.3)
    assert told(estimate, moving, external_torque=1.0) == estimate
    for model in (build("motor_side"), build("harmonic_drive", drifting_load=True)):
        assert told(estimate, moving, model) == estimate
    assert told(estimate, moving, build("harmonic_drive")) != estimate


def test_what_is_said_without_a_fit_stays_as_it_is(estimate):
    at_rest = estimate.updated(status=Status.NO_MOTION)
    assert told(at_rest, robot(wrist=0.3)) == at_rest
