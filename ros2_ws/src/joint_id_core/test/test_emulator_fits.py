"""The models that are meant for a robot describe the emulated one, through its sensors and our filter."""

from functools import cache

import numpy as np
import pytest

from joint_id_core.alignment.aligner import Aligner, Columns
from joint_id_core.alignment.inputs import InputOptions
from joint_id_core.data.recording import Recording
from joint_id_core.emulator.controller import Controller
from joint_id_core.emulator.robots import build_joints
from joint_id_core.estimators import ParameterSettings, fit
from joint_id_core.models import build

JOINTS = build_joints("ur3e")
WINDOW, FIRST, WINDOWS = 1000, 300, 2  # samples; where the robot has left its rest


@cache
def recordings():
    """What driver and filter make of the emulated robot, by joint."""
    names, ratio = tuple(joint.name for joint in JOINTS), np.array([joint.values["N"] for joint in JOINTS])
    controller = Controller(JOINTS, range(6), 0.3, (5, 13, 0))

    def clock() -> float:
        """Time of the robot: a fast computer is done before a topic that nobody publishes counts as absent."""
        return float(controller.values["timestamp"])

    aligner, batches = Aligner(InputOptions(effort_source="current"), clock=clock), []
    for _ in range(FIRST + WINDOWS * WINDOW + 100):  # what the filter still holds at the end has no velocity
        controller.tick()
        controller.report()
        q, w, current = (np.array(controller.values[f]) for f in ("actual_q", "actual_qd", "actual_current"))
        stamp = 1_000_000_000 + round(controller.values["timestamp"] * 1e9)
        aligner.join("link_states", stamp, Columns(names, {"link_position": q, "current": current}))
        aligner.join("motor_states", stamp, Columns(names, {"motor_velocity": w * ratio}))
        batches += aligner.align()
        controller.advance()
    part = slice(FIRST, FIRST + WINDOWS * WINDOW)
    instants_ns = np.concatenate([batch.instants_ns for batch in batches])[part]
    time = (instants_ns - instants_ns[0]) * 1e-9
    channels = {n: np.concatenate([batch.channels[n] for batch in batches])[part] for n in batches[-1].channels}
    found = []
    for k in range(len(JOINTS)):
        mine = {name: values[:, k] for name, values in channels.items()}
        found.append(Recording(time, mine, derived=batches[-1].derived))
    return found


@cache
def fits(k, model):
    """Estimates of joint `k`, one a window."""
    settings = ParameterSettings({"k_t": JOINTS[k].values["k_t"]})
    windows = [recordings()[k].slice(first, first + WINDOW) for first in range(0, WINDOWS * WINDOW, WINDOW)]
    return [fit(build(model, actuation="current"), window, settings) for window in windows]


def errors(k, estimate):
    """Errors of the free parameters of joint `k` over their standard deviations, by name; a true offset is zero."""
    truth = JOINTS[k].values
    return {n: (estimate[n].value - truth.get(n, 0.0)) / estimate[n].std_dev for n in estimate.free}


@pytest.mark.parametrize("model", ["motor_side", "harmonic_drive"])
@pytest.mark.parametrize("k", range(6), ids=[joint.name for joint in JOINTS])
def test_every_window_of_every_joint_is_described(k, model):
    for estimate in fits(k, model):
        assert estimate.converged, estimate.message
        found = errors(k, estimate)
        assert max(map(abs, found.values())) < 4.0, found


def test_noise_of_the_link_encoder_which_is_an_input_does_not_bias_the_inertia():
    """Without correction the mean of these twelve is 1.7."""
    assert abs(np.mean([errors(k, e)["J_m"] for k in range(6) for e in fits(k, "motor_side")])) < 1.1
