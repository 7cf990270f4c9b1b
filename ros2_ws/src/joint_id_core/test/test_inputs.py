"""What the numbers in link_states mean is known or stated, never guessed."""

import numpy as np
import pytest

from joint_id_core.alignment.inputs import InputOptions
from joint_id_core.errors import JointIdError

RAW = {"link_position": [0.1, 0.2], "link_velocity": [0.5, np.nan], "current": [2.0, 3.0]}


def raw(**more):
    return {name: np.array(values) for name, values in {**RAW, **more}.items()}


def plain(channels):
    return {name: values.tolist() for name, values in channels.items()}


@pytest.mark.parametrize("topic", ["/link_states", "/left/arm/link_states"])
def test_on_our_own_topic_effort_is_the_current(topic):
    assert InputOptions().for_topic(topic).effort_source == "current"
    assert InputOptions(effort_source="torque").for_topic(topic).effort_source == "torque"


@pytest.mark.parametrize("topic", ["/joint_states", "/link_states/joint_states", "/my_link_states"])
def test_on_a_topic_of_another_name_effort_must_be_stated(topic):
    with pytest.raises(JointIdError) as error:
        InputOptions().for_topic(topic)
    for part in ("effort_source", topic, "current, torque, gravity_free_torque"):
        assert part in str(error.value)
    for effort in ("current", "torque", "gravity_free_torque"):
        assert InputOptions(effort_source=effort).for_topic(topic) == InputOptions(effort_source=effort)


def test_currents_and_link_velocities_pass_untouched():
    np.testing.assert_equal(plain(InputOptions(effort_source="current").channels(raw())), RAW)


@pytest.mark.parametrize("effort", ["torque", "gravity_free_torque"])
def test_a_joint_torque_is_brought_to_the_motor_shaft(effort):
    channels = plain(InputOptions(effort_source=effort, gear_ratio=50.0).channels(raw()))
    assert channels["torque"] == [0.04, 0.06]
    assert "current" not in channels


def test_a_motor_velocity_over_the_gear_ratio_is_no_link_velocity():
    options = InputOptions(effort_source="current", velocity_source="motor_over_gear_ratio", gear_ratio=50.0)
    channels = plain(options.channels(raw()))
    np.testing.assert_equal(channels["motor_velocity"], [25.0, np.nan])
    assert "link_velocity" not in channels
    assert channels["current"] == RAW["current"]


def test_what_is_given_at_the_motor_shaft_is_not_replaced():
    options = InputOptions(effort_source="torque", velocity_source="motor_over_gear_ratio")
    channels = plain(options.channels(raw(torque=[7.0, 8.0], motor_velocity=[9.0, 10.0])))
    assert channels == {"link_position": [0.1, 0.2], "torque": [7.0, 8.0], "motor_velocity": [9.0, 10.0]}


@pytest.mark.parametrize(
    "wrong", [{"effort_source": "torques"}, {"velocity_source": ""}, {"velocity_source": "motor"}, {"gear_ratio": 0.0}]
)
def test_values_out_of_range_are_refused_by_name(wrong):
    with pytest.raises(JointIdError, match=next(iter(wrong))):
        InputOptions(**wrong)
