"""Node `filter`: what comes in must come out, aligned, with true derivatives, whatever else arrives."""

import math
import time

import pytest
from robot_messages import (
    NANO,
    PERIOD_NS,
    RATIO,
    link_acceleration,
    link_position,
    link_state,
    link_velocity,
    motor_state,
    stamp,
    voltages,
)
from sensor_msgs.msg import JointState

from joint_id_msgs.msg import JointSamples, MotorVoltages

BEGIN = 100 * NANO
COUNT = 1500
JOINTS = tuple(f"joint_{k}" for k in range(6))


def instants(count=COUNT, begin=BEGIN):
    return [begin + k * PERIOD_NS for k in range(count)]


def instant(sample):
    return sample.header.stamp.sec * NANO + sample.header.stamp.nanosec


@pytest.fixture
def filtering(start, probe):
    """Start a filter and return the list of its samples and a publisher of link states."""

    def begin(**parameters):
        samples = probe.collect(JointSamples, "joint_samples")
        start("filter", **parameters)
        links = probe.source(JointState, "link_states")
        probe.until(lambda: probe.count_publishers("joint_samples"), "the filter's publisher")
        probe.until(lambda: probe.get_publishers_info_by_topic("joint_samples"), "the filter's publisher")
        return samples, links

    return begin


def publish_at_500_hz(times, *publish):
    """Publish in real time, without ever running ahead; late wake-ups are made up for."""
    begin = time.monotonic()
    for k, t in enumerate(times):
        while time.monotonic() < begin + k * PERIOD_NS / NANO:
            time.sleep(0.0005)
        for one in publish:
            one(t)


def test_six_joints_on_three_topics_at_500_hz_lose_no_sample(filtering, probe):
    samples, links = filtering()
    motors, volts = probe.source(JointState, "motor_states"), probe.source(MotorVoltages, "motor_voltages")
    publish_at_500_hz(
        instants(),
        lambda t: links.publish(link_state(t, JOINTS)),
        lambda t: motors.publish(motor_state(t, JOINTS)),
        lambda t: volts.publish(voltages(t, 12.0, JOINTS)),
    )
    held = 100  # samples that the lag of the filter still holds at the end
    probe.until(lambda: len(samples) >= COUNT - held, "the samples")
    assert [instant(s) for s in samples] == instants()[: len(samples)]
    assert all(s.name == list(JOINTS) for s in samples)
    measured = (
        JointSamples.LINK_POSITION | JointSamples.CURRENT | JointSamples.MOTOR_POSITION
        | JointSamples.MOTOR_VELOCITY | JointSamples.VOLTAGE
    )  # fmt: skip
    assert {s.measured for s in samples} == {measured}
    for s in samples[500:1000:50]:
        t = instant(s) / NANO
        assert list(s.link_position) == [k * link_position(t) for k in range(1, 7)]  # measured: untouched, bit by bit
        assert list(s.motor_velocity) == [RATIO * k * link_velocity(t) for k in range(1, 7)]
        assert list(s.voltage) == [12.0] * 6
        # Derived: the 50 Hz filter leaves 1 Hz as it is, to 1 part in 10^5 of the amplitude.
        assert s.link_velocity[2] == pytest.approx(3 * link_velocity(t), abs=1e-4)
        assert s.link_acceleration[2] == pytest.approx(3 * link_acceleration(t), abs=1e-3)


def test_a_topic_that_nobody_publishes_is_not_measured(filtering, probe):
    samples, links = filtering()
    for t in instants(600):
        links.publish(link_state(t))
    probe.until(lambda: len(samples) > 400, "samples without motor topics")
    assert samples[-1].measured == JointSamples.LINK_POSITION | JointSamples.CURRENT
    assert len(samples[-1].motor_position) == 0
    assert instant(samples[0]) == BEGIN


def test_joint_torque_comes_to_the_motor_shaft(filtering, probe):
    samples, links = filtering(effort_source="torque", gear_ratio=50.0)
    for t in instants(300):
        links.publish(link_state(t))
    probe.until(lambda: len(samples) > 100, "samples")
    s = samples[100]
    assert s.measured == JointSamples.LINK_POSITION | JointSamples.TORQUE
    assert len(s.current) == 0
    assert s.torque[0] == pytest.approx(2.0 * link_position(instant(s) / NANO) / 50.0, rel=1e-12)


def test_a_motor_velocity_in_link_states_is_a_measured_motor_velocity(filtering, probe):
    samples, links = filtering(velocity_source="motor_over_gear_ratio")
    for t in instants(300):
        message = link_state(t)
        message.velocity = [link_velocity(t / NANO)]
        links.publish(message)
    probe.until(lambda: len(samples) > 200, "samples")
    s = samples[150]
    t = instant(s) / NANO
    assert s.measured == JointSamples.LINK_POSITION | JointSamples.MOTOR_VELOCITY | JointSamples.CURRENT
    assert s.motor_velocity[0] == RATIO * link_velocity(t)
    # Derived from the position, each from its own side of the gear.
    assert s.link_velocity[0] == pytest.approx(link_velocity(t), abs=1e-4)
    assert s.motor_acceleration[0] == pytest.approx(RATIO * link_acceleration(t), abs=0.1)


def test_an_effort_that_is_not_stated_ends_the_filter_with_one_line_and_exit_code_2(start, probe):
    process = start("filter", "-r", "link_states:=/arm/joint_states")
    assert process.wait() == 2
    (line,) = process.text.strip().splitlines()
    assert line.startswith("filter: ") and "effort_source" in line and "/arm/joint_states" in line


@pytest.mark.parametrize("arguments", [("-r", "__ns:=/left/arm"), ("-r", "link_states:=/left/arm/link_states")])
def test_our_own_topic_in_a_namespace_needs_no_effort_source(start, probe, arguments):
    start("filter", *arguments)
    probe.source(JointState, "/left/arm/link_states")
    probe.until(lambda: any(v.key == "effort" and v.value == "current" for s in probe.diagnostics for v in s.values),
                "what the filter takes the effort for")  # fmt: skip


def wrong_length(message):
    message.position = [0.0, 1.0]


def no_names(message):
    message.name, message.position, message.effort = [], [], []


def doubled_name(message):
    message.name, message.position, message.effort = ["joint"] * 2, [0.0] * 2, [0.0] * 2


def no_values(message):
    message.position, message.effort = [], []


def infinite(message):
    message.effort = [math.inf]


def huge(message):
    message.effort = [1e300]


def before_the_epoch(message):
    message.header.stamp.sec = -5


def not_a_number(message):
    message.position = [math.nan]


def unstamped(message):
    message.header.stamp.sec = message.header.stamp.nanosec = 0


def backwards(message):
    message.header.stamp = stamp(BEGIN + 490 * PERIOD_NS)


@pytest.mark.parametrize(
    ("spoil", "text"),
    [
        (wrong_length, "2 values of position for 1 joints"),
        (not_a_number, "not finite"),
        (unstamped, "the stamp is zero"),
        *(
            pytest.param(spoil, text, marks=pytest.mark.long)  # test_conversions.py has their texts without a node
            for spoil, text in (
                (no_names, "names no joint"),
                (doubled_name, "twice"),
                (no_values, "holds no values"),
                (infinite, "effort of joint joint is infinite"),
                (huge, "effort of joint joint is 1e+300"),
                (before_the_epoch, "is no time"),
                (backwards, "goes back by 0.018 s"),
            )
        ),
    ],
)
def test_a_bad_message_is_reported_and_the_filter_goes_on(filtering, probe, spoil, text):
    samples, links = filtering()
    times = instants(1000)
    for t in times[:500]:
        links.publish(link_state(t))
    bad = link_state(times[500])
    spoil(bad)
    links.publish(bad)
    for t in times[501:]:
        links.publish(link_state(t))
    probe.until(lambda: samples and instant(samples[-1]) >= times[800], "samples after the bad message")
    probe.until(lambda: probe.told("filter", text), f"a diagnostic with {text!r}")
    assert probe.told("filter", text).level >= b"\x01"  # an error, if this computer has too much to do as well
    stamps = [instant(s) for s in samples]
    assert stamps == sorted(set(stamps))
    good = next(s for s in samples if instant(s) == times[799])
    assert good.link_velocity[0] == pytest.approx(link_velocity(times[799] / NANO), abs=1e-4)


def odd_messages(instant_ns):
    """Every kind of names with every kind of arrays, on each topic."""
    for names in ([], ["joint"], ["joint", "joint"], ["other"]):
        for values in ([], [math.nan], [math.inf], [1e300], [0.1, 0.2, 0.3]):
            link = JointState(name=names, position=values, effort=values)
            motor = JointState(name=names, position=values, velocity=values)
            volts = MotorVoltages(name=names, voltage=values)
            for message in (link, motor, volts):
                message.header.stamp = stamp(instant_ns)
            instant_ns += PERIOD_NS
            yield link, motor, volts


def test_dozens_of_odd_messages_end_nothing(filtering, probe):
    samples, links = filtering(join_wait_s=0.1)
    motors, volts = probe.source(JointState, "motor_states"), probe.source(MotorVoltages, "motor_voltages")
    for odd in odd_messages(BEGIN):
        for publisher, message in zip((links, motors, volts), odd, strict=True):
            publisher.publish(message)
    times = instants(600, BEGIN + 10 * NANO)
    for t in times:
        links.publish(link_state(t))
    probe.until(lambda: any(instant(s) == times[400] for s in samples), "good samples after the odd ones")
    good = next(s for s in samples if instant(s) == times[400])
    assert good.link_position[good.name.index("joint")] == link_position(times[400] / NANO)
    key = "problems: message left out"

    def left_out():
        return max((int(v.value) for s in probe.diagnostics for v in s.values if v.key == key), default=0)

    probe.until(lambda: left_out() >= 50, "50 messages left out")  # of 60; the others say something that can be true


def test_a_second_run_with_earlier_stamps_is_filtered_as_well(filtering, probe):
    samples, links = filtering()
    for begin in (BEGIN, BEGIN - 50 * NANO):
        for t in instants(400, begin):
            links.publish(link_state(t))
    probe.until(lambda: samples and 0 < instant(samples[-1]) < BEGIN - 49 * NANO, "samples of the second run")
    probe.until(lambda: probe.told("filter", "restarted"), "a report")
