"""rosbag2 in: bags of other writers, and topics of others by a mapping."""

import numpy as np
import pytest
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from joint_id_core import formats
from joint_id_core.errors import JointIdError
from joint_id_core.formats.definitions import typestore

from .bag_parts import JOINT_STATE, joint_state, recording

# Bags of other writers


def test_topics_merge_on_the_union_of_stamps(tmp_path):
    store = get_typestore(Stores.ROS2_JAZZY)
    with Writer(tmp_path / "bag", version=9) as writer:
        link = writer.add_connection("/ur3e/link_states", JOINT_STATE, typestore=store)
        motor = writer.add_connection("/ur3e/motor_states", JOINT_STATE, typestore=store)
        writer.add_connection("/rosout", "std_msgs/msg/String", typestore=store)
        for connection, stamp, kwargs in (
            (link, 100, {"position": [1, 2], "effort": [3, 4]}),
            (motor, 150, {"velocity": [50, 60]}),
            (link, 200, {"position": [5, 6], "effort": [7, 8]}),
            (motor, 200, {"velocity": [70, 80]}),
        ):
            message = joint_state(store, stamp * 10**6, ["shoulder", "elbow"], **kwargs)
            writer.write(connection, 10**9, store.serialize_cdr(message, JOINT_STATE))
    elbow = formats.read(tmp_path / "bag", "elbow")
    np.testing.assert_array_equal(elbow.time, [0.1, 0.15, 0.2])
    np.testing.assert_array_equal(elbow["link_position"], [2, np.nan, 6])
    np.testing.assert_array_equal(elbow["current"], [4, np.nan, 8])
    np.testing.assert_array_equal(elbow["motor_velocity"], [np.nan, 60, 80])
    assert set(elbow.channels) == {"link_position", "current", "motor_velocity"}


def test_raw_topics_go_before_joint_samples(tmp_path):
    store = typestore()
    formats.write_bag(tmp_path / "samples", {"j": recording(("link_acceleration",))})
    with Reader(tmp_path / "samples") as reader:
        samples = [data for _, _, data in reader.messages()]
    with Writer(tmp_path / "bag", version=9) as writer:
        extra = writer.add_connection("/joint_samples", "joint_id_msgs/msg/JointSamples", typestore=store)
        link = writer.add_connection("/link_states", JOINT_STATE, typestore=store)
        for data in samples:
            writer.write(extra, 1, data)
        writer.write(link, 1, store.serialize_cdr(joint_state(store, 10**9, ["j"], [2.5]), JOINT_STATE))
    back = formats.read(tmp_path / "bag")
    assert (back.joint, back.time.tolist(), dict(back.channels)) == ("j", [1.0], {"link_position": [2.5]})


def test_older_definition_in_the_bag_is_honoured(tmp_path):
    name = "joint_id_msgs/msg/MotorTorques"
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg("std_msgs/Header header\nint32 version\nstring[] name\nfloat64[] torque\n", name))
    header = joint_state(store, 5, ["j"]).header
    message = store.types[name](header=header, version=1, name=["j"], torque=np.array([0.25]))
    for storage in StoragePlugin:
        with Writer(tmp_path / storage.name, version=9, storage_plugin=storage) as writer:
            connection = writer.add_connection("/motor_torques", name, typestore=store)
            writer.write(connection, 1, store.serialize_cdr(message, name))
        assert formats.read(tmp_path / storage.name)["torque"].tolist() == [0.25]


# Topics of others


def joint_states_bag(path, *topics):
    """A bag of two joints on topics of others; values of message k and topic number n are told apart by k and n."""
    store = get_typestore(Stores.ROS2_JAZZY)
    with Writer(path, version=9) as writer:
        text = writer.add_connection("/robot_description", "std_msgs/msg/String", typestore=store)
        writer.write(text, 1, store.serialize_cdr(store.types["std_msgs/msg/String"]("<robot/>"), text.msgtype))
        connections = [writer.add_connection(topic, JOINT_STATE, typestore=store) for topic in topics]
        for k in range(1, 4):
            for n, connection in enumerate(connections):
                values = {"position": [k, -k], "velocity": [k + 0.5, 0.0], "effort": [10 * n + k, np.nan]}
                message = joint_state(store, k * 10**9, ["elbow", "wrist"], **values)
                writer.write(connection, k, store.serialize_cdr(message, JOINT_STATE))
    return path


def test_a_mapping_names_fields_of_other_topics(tmp_path):
    bag = joint_states_bag(tmp_path / "bag", "/joint_states")
    mapping = {
        "link_position": "joint_states.position", "motor_velocity": "101*/joint_states.velocity",
        "torque": "joint_states.effort * 0.01 * 2",
    }  # fmt: skip
    assert formats.joints(bag, mapping) == ("elbow", "wrist")
    elbow = formats.read(bag, "elbow", mapping)
    assert elbow.time.tolist() == [1.0, 2.0, 3.0]
    assert {name: values.tolist() for name, values in elbow.channels.items()} == {
        "link_position": [1.0, 2.0, 3.0], "motor_velocity": [151.5, 252.5, 353.5], "torque": [0.02, 0.04, 0.06],
    }  # fmt: skip
    assert not elbow.derived
    assert set(formats.read(bag, "wrist", mapping).channels) == {"link_position", "motor_velocity"}


def test_a_mapping_of_a_bag_is_all_that_is_read(tmp_path):
    bag = joint_states_bag(tmp_path / "bag", "/left/link_states", "/right/link_states", "/link_states")
    mapping = {"torque": "right/link_states.effort", "link_position": "left/link_states.position"}
    channels = formats.read(bag, "elbow", mapping).channels
    assert {name: values.tolist() for name, values in channels.items()} == {
        "torque": [11.0, 12.0, 13.0], "link_position": [1.0, 2.0, 3.0],
    }  # fmt: skip


@pytest.mark.parametrize(
    ("mapping", "message"),
    [
        (
            {"current": "effort"},
            r"current=effort: 'effort' is neither .*: the columns are joint_states.pos",
        ),
        ({"current": "left/joint_states.effort"}, r"is neither a column nor a number"),
        ({"current": "robot_description.data"}, r"is neither a column nor a number"),
        ({"current": "2*0.5"}, r"current=2\*0.5 uses no column: the columns are joint_states.position"),
        ({"amps": "joint_states.effort"}, r"cannot map to 'amps': known are motor_position"),
        ({"time_s": "joint_states.position"}, r"time_s of a bag is always header.stamp"),
        ({"torque": "joint_states.effort*joint_states.velocity"}, r"take one field for each channel"),
        (
            {"link_position": "joint_states.position", "motor_position": "101*joint_states.position"},
            r"motor_position=101\*joint_states.position: take one field for each channel, .* and each field once",
        ),
    ],
)
def test_a_mapping_that_is_not_understood(tmp_path, mapping, message):
    bag = joint_states_bag(tmp_path / "bag", "/joint_states")
    for action in (formats.joints, lambda path, given: formats.read(path, "elbow", given)):
        with pytest.raises(JointIdError, match=message):
            action(bag, mapping)


# Joint states alone


def test_a_single_topic_of_joint_states_needs_no_mapping(tmp_path):
    bag = joint_states_bag(tmp_path / "bag", "/arm/joint_states")
    assert formats.joints(bag) == ("elbow", "wrist")
    channels = formats.read(bag, "elbow").channels
    assert {name: values.tolist() for name, values in channels.items()} == {
        "link_position": [1.0, 2.0, 3.0], "link_velocity": [1.5, 2.5, 3.5], "torque": [1.0, 2.0, 3.0],
    }  # fmt: skip
    assert set(formats.read_joints(bag).recordings) == {"elbow", "wrist"}
    (told,) = formats.taken(bag)
    assert told.startswith("/arm/joint_states.effort is taken as a torque in Nm, as the message is defined")
    assert told.endswith("--map link_position=arm/joint_states.position --map current=arm/joint_states.effort")
    assert formats.taken(bag, "elbow", {"torque": "arm/joint_states.effort"}) == []


def test_efforts_of_a_ur_robot_may_be_currents_so_they_are_asked_for(tmp_path):
    store, path = get_typestore(Stores.ROS2_JAZZY), tmp_path / "bag"
    with Writer(path, version=9) as writer:
        connection = writer.add_connection("/joint_states", JOINT_STATE, typestore=store)
        names = ["left_wrist_3_joint", "left_shoulder_pan_joint"]
        message = joint_state(store, 10**9, names, position=[1, 2], effort=[3, 4])
        writer.write(connection, 0, store.serialize_cdr(message, JOINT_STATE))
    with pytest.raises(JointIdError, match=r"--map current=joint_states.effort, or torque=joint_states.effort if it"):
        formats.joints(path)
