"""Node `sim`: the parameters of its joint change while it moves, and nothing that is wrong is taken."""

import numpy as np
import pytest
from robot_messages import NANO
from sensor_msgs.msg import JointState

from joint_id_core.models import build
from joint_id_msgs.msg import JointParams
from joint_id_ros.qos import LATEST

NOMINAL = build("harmonic_drive").values()
PERIOD_S = 0.002
SUDDEN = 10.0  # rad/s of the motor shaft within one sample; its largest acceleration gives 7.3, its speed is up to 200


def stamp_s(header):
    return header.stamp.sec + header.stamp.nanosec / NANO


def values(message):
    return {p.name: p.value for p in message.joints[0].parameters}


@pytest.fixture
def sim(start, probe):
    """A joint that moves, with its states and what it says of its parameters."""
    truth = probe.collect(JointParams, "truth", LATEST)
    motors = probe.collect(JointState, "motor_states")
    node = start("sim", model="harmonic_drive", noise=False, wait_subscribers=0, set=["k_1=6000"])
    probe.until(lambda: truth and len(motors) > 100, "motion")
    return node, truth, motors


def test_a_load_is_picked_up_while_the_joint_moves_on(sim, probe):
    _, truth, motors = sim
    assert probe.set_parameter("sim", "set", ["k_1=6000", "J_q=1.556"]).successful
    probe.until(lambda: len(truth) == 2, "the new truth")
    before, after = map(values, truth)
    assert (before["J_q"], after["J_q"]) == (NOMINAL["J_q"], 1.556)
    assert {n: v for n, v in after.items() if n != "J_q"} == {n: v for n, v in before.items() if n != "J_q"}
    since = stamp_s(truth[1].header)
    probe.until(lambda: stamp_s(motors[-1].header) > since + 0.5, "motion after the change")
    times, speeds = (np.array([f(m) for m in motors]) for f in (lambda m: stamp_s(m.header), lambda m: m.velocity[0]))
    # The stamps go on at their rate, and the state goes on from where it was.
    around = (times > since - 0.1) & (times < since + 0.1)
    assert around.sum() > 90 and np.diff(times[around]) == pytest.approx(PERIOD_S, abs=1e-6)
    assert np.abs(np.diff(speeds[around])).max() < SUDDEN < np.ptp(speeds)
    # The list is the whole of what is given: without the load, its own inertia is back.
    assert probe.set_parameter("sim", "set", ["k_1=6000"]).successful
    probe.until(lambda: len(truth) == 3, "the joint without the load")
    assert values(truth[2]) == before


WRONG = (
    (["J_x=1.0"], "has no parameter 'J_x'"),
    (["J_q=-1.0"], "J_q = -1"),
    (["J_q"], "parameter set J_q: not of the form NAME=VALUE"),
    (["J_q=heavy"], "'heavy' is not a number"),
    (["J_m=1e-18"], "check units, inputs and parameters"),
    (1.556, "STRING_ARRAY"),
    (None, "cannot be undeclared"),
)


def test_a_wrong_change_is_refused_in_words_and_the_joint_moves_on(sim, probe):
    node, truth, motors = sim
    for wrong, says in WRONG:
        refused = probe.set_parameter("sim", "set", wrong)
        assert not refused.successful and says in refused.reason, (wrong, refused.reason)
    count = len(motors)
    probe.until(lambda: len(motors) > count + 100, "motion")
    assert node.running and len(truth) == 1
