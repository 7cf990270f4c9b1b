"""rosbag2 in: bags that are damaged, or whose topics, joints or stamps cannot be read."""

import resource

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from joint_id_core import formats
from joint_id_core.errors import JointIdError

from .bag_parts import JOINT_STATE, STORAGES, data_file, joint_state, recording
from .quick import first_quick


def states_bag(path, samples, topic="/link_states", names=("elbow",), storage=StoragePlugin.MCAP):
    """A bag of JointState by rosbags alone: stamp in ns and position of each message."""
    store = get_typestore(Stores.ROS2_JAZZY)
    with Writer(path, version=9, storage_plugin=storage) as writer:
        topics = [topic] if isinstance(topic, str) else topic
        connections = [writer.add_connection(t, JOINT_STATE, typestore=store) for t in topics]
        for k, (stamp, position) in enumerate(samples):
            for connection in connections:
                message = joint_state(store, stamp, names, np.full(len(names), position))
                writer.write(connection, 10**9 + k, store.serialize_cdr(message, JOINT_STATE))
    return path


@pytest.mark.parametrize("storage", STORAGES)
@pytest.mark.parametrize("share", first_quick([0.3, 0.0, 0.001, 0.7, 0.99], 2))
@pytest.mark.parametrize("bare", [False, True])
def test_truncated_bags(tmp_path, storage, share, bare):
    formats.write_bag(tmp_path / "bag", {"j": recording(n=2000)}, storage)
    file = data_file(tmp_path / "bag")
    whole = file.read_bytes()
    file.write_bytes(whole[: int(share * len(whole))])
    if storage == "mcap" and share == 0.99:  # only the index is cut off: see test_unclosed_bag
        assert len(formats.read(file if bare else tmp_path / "bag")) == 2000
        return
    target = file if bare else tmp_path / "bag"
    expected = "the file is empty" if bare and share == 0 else "not a readable bag, damaged or truncated"
    for action in (formats.read, formats.joints):
        with pytest.raises(JointIdError, match=expected) as caught:
            action(target)
        assert str(caught.value).startswith(str(target))
        assert "\n" not in str(caught.value)


def test_bag_with_fewer_messages_than_its_index(tmp_path):
    bag = states_bag(tmp_path / "bag", [(10**9, 1.0), (2 * 10**9, 2.0)], storage=StoragePlugin.SQLITE3)
    meta = bag / "metadata.yaml"
    meta.write_text(meta.read_text().replace("message_count: 2", "message_count: 5"))
    with pytest.raises(JointIdError, match=r"bag: truncated, /link_states has 2 of 5 messages: record it again"):
        formats.read(bag)


@pytest.mark.parametrize("name", ["x.mcap", "x.db3"])
def test_files_that_are_no_bag(tmp_path, name):
    (tmp_path / name).write_bytes(b"time_s,link_position\n" * 1000)
    with pytest.raises(JointIdError, match=rf"{name}: not a readable bag"):
        formats.read(tmp_path / name)


def test_directory_that_is_no_bag(tmp_path):
    with pytest.raises(JointIdError, match=r"not a bag, there is no metadata.yaml in it: .*ros2 bag reindex"):
        formats.read(tmp_path)
    (tmp_path / "metadata.yaml").write_text("rosbag2_bagfile_information: [")
    with pytest.raises(JointIdError, match=r"not a readable bag, damaged or truncated"):
        formats.read(tmp_path)
    with pytest.raises(JointIdError, match=r"this is the index of a bag: give its directory"):
        formats.read(tmp_path / "metadata.yaml")


@pytest.mark.parametrize("storage", list(StoragePlugin))
def test_empty_bag(tmp_path, storage):
    with pytest.raises(JointIdError, match=r"bag: the bag holds no message: record it again"):
        formats.read(states_bag(tmp_path / "bag", [], storage=storage))


@pytest.mark.parametrize(
    ("topic", "message"),
    [
        (
            ["/left/joint_states", "/right/joint_states"],
            r"no known topic: it has /left/joint_states \(sensor_msgs/msg/JointState\), .*; understood are link_st.*"
            r"; name the fields of others, e.g. --map link_position=left/joint_states.position --map current=left/jo",
        ),
        (
            "/a/motor_torques",
            r"topic /a/motor_torques is of type sensor_msgs/msg/JointState, not joint_id_msgs/msg/Motor",
        ),
        (
            ["/a/link_states", "/b/link_states"],
            r"several namespaces hold known topics \(/a, /b\): keep one robot a bag",
        ),
        (["/link_states", "/b/motor_states"], r"several namespaces hold known topics \(/, /b\)"),
    ],
)
def test_wrong_topics(tmp_path, topic, message):
    with pytest.raises(JointIdError, match=message):
        formats.read(states_bag(tmp_path / "bag", [(10**9, 1.0)], topic))


def test_missing_and_ambiguous_joints(tmp_path):
    bag = states_bag(tmp_path / "bag", [(10**9, 1.0)], names=("shoulder", "elbow"))
    assert formats.joints(bag) == ("shoulder", "elbow")
    with pytest.raises(JointIdError, match=r"bag has no joint 'wrist': it has shoulder, elbow"):
        formats.read(bag, "wrist")
    with pytest.raises(
        JointIdError, match=r"bag holds the joints shoulder, elbow: choose one of them \(--joint shoulder"
    ):
        formats.read(bag)
    with pytest.raises(JointIdError, match=r"the messages name no joint"):
        formats.joints(states_bag(tmp_path / "nameless", [(10**9, 1.0)], names=()))


@pytest.mark.parametrize(
    ("stamps", "message"),
    [
        ([10, 30, 20], r"topic /link_states: time goes backwards at sample 2 \(3e-08 s, then 2e-08 s\): sort"),
        ([10, 20, 20], r"topic /link_states: time repeats at sample 2"),
        ([0, 0, 0], r"topic /link_states: every header.stamp is zero: stamp the messages"),
    ],
)
def test_bad_stamps(tmp_path, stamps, message):
    with pytest.raises(JointIdError, match=message):
        formats.read(states_bag(tmp_path / "bag", [(stamp, 1.0) for stamp in stamps]))


def test_array_lengths_must_match_the_names(tmp_path):
    store = get_typestore(Stores.ROS2_JAZZY)
    with Writer(tmp_path / "bag", version=9) as writer:
        connection = writer.add_connection("/link_states", JOINT_STATE, typestore=store)
        message = joint_state(store, 5, ["a", "b"], position=[1, 2], effort=[3])
        writer.write(connection, 1, store.serialize_cdr(message, JOINT_STATE))
    with pytest.raises(JointIdError, match=r"topic /link_states: message 0 has 1 values of effort for 2 joints"):
        formats.read(tmp_path / "bag", "a")


def test_bag_without_any_value(tmp_path):
    with pytest.raises(JointIdError, match=r"joint elbow has no value on any topic"):
        formats.read(states_bag(tmp_path / "bag", [(10**9, np.nan)]))


@pytest.mark.parametrize("storage", STORAGES)
def test_a_bag_that_cannot_be_written_leaves_nothing(tmp_path, storage):
    """A limit of the size of files ends writing half way, as a full disk does."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, before[1]))
    try:
        with pytest.raises(JointIdError, match=r"bag: the bag cannot be written: .+: check folder, permissions and"):
            formats.write_bag(tmp_path / "bag", {"j": recording(n=2000)}, storage)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert not (tmp_path / "bag").exists()
    formats.write_bag(tmp_path / "bag", {"j": recording(n=2000)}, storage)
    assert len(formats.read(tmp_path / "bag")) == 2000
