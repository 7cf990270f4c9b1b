"""Joint temperatures go from the robot over RTDE, driver, filter and identifier to joint_params."""

import math

from joint_id_msgs.msg import JointParams, JointSamples, RobotSignals
from joint_id_ros.qos import LATEST

HOST = "127.0.0.1"
JOINT = "elbow_joint"
INDEX = 2
START = 27.0  # deg C, of the emulated elbow


def test_the_estimate_tells_the_temperature_of_its_window(start, probe, robot):
    machine = robot()
    found = probe.collect(JointParams, "joint_params", LATEST)
    samples = probe.collect(JointSamples, "joint_samples")
    signals = probe.collect(RobotSignals, "robot_signals")
    start("identifier", model="motor_side", joints=[JOINT], set=["N=101", "k_t=0.1"], window_s=2.0)
    start("filter")
    probe.until(lambda: probe.count_subscribers("joint_samples") == 2, "the identifier")
    start("driver", robot_ip=HOST, port=machine.port)

    def both():
        """Temperatures that were sent and came with samples, in their order."""
        known = {s.temperature[s.name.index(JOINT)] for s in samples if len(s.temperature)}
        return [t for message in signals if (t := message.joint_temperatures[INDEX]) in known]

    probe.until(lambda: len(found) >= 2 and len(both()) >= 3, "estimates and temperatures")
    sent = [message.joint_temperatures[INDEX] for message in signals]
    assert len(set(sent)) > 1  # the joint warms up
    known = [s.temperature[s.name.index(JOINT)] for s in samples if len(s.temperature)]
    known = [value for value in known if not math.isnan(value)]
    # This process may have heard the driver later than the filter.
    seen = both()
    known = [value for value in known if seen[0] <= value <= seen[-1]]
    assert len(known) > 100 * len(seen) / 4  # every sample has one, though few messages carried it
    assert set(known) <= set(sent)
    told = [message.joints[0].temperature for message in found]
    assert all(START < value < max(sent) for value in told)
    assert told[-1] > told[0]
