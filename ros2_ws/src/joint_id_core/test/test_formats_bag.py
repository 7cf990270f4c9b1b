"""rosbag2 out and back in: our bags against our reader and other readers."""

from pathlib import Path

import mcap.reader
import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from joint_id_core import formats
from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.formats import bag_reader
from joint_id_core.formats.definitions import DEFINITIONS, typestore
from joint_id_core.formats.topics import MEASURED_BITS
from joint_id_core.jobs.given import Part

from .bag_parts import RAW, STORAGES, data_file, recording

MESSAGES = Path(__file__).resolve().parents[2] / "joint_id_msgs" / "msg"


def instants(held):
    """Its instants in whole nanoseconds."""
    return held.origin * 10**9 + np.rint(held.time * 1e9).astype(np.int64)


def assert_same(back, original):
    np.testing.assert_array_equal(instants(back), instants(original))
    assert set(back.channels) == set(original.channels)
    assert back.derived == original.derived
    for name in original.channels:
        np.testing.assert_array_equal(back[name], original[name], strict=True)


@pytest.mark.parametrize("storage", STORAGES)
def test_raw_topics_read_back_exactly(tmp_path, storage):
    bag = tmp_path / "bag"
    robot = {"shoulder": recording(RAW, seed=1), "elbow": recording(("link_position", "current"), n=33, seed=2)}
    formats.write_bag(bag, robot, storage)
    assert formats.joints(bag) == ("shoulder", "elbow") or formats.joints(bag) == ("elbow", "shoulder")
    for joint, original in robot.items():
        assert_same(formats.read(bag, joint), original)
        assert_same(formats.read(data_file(bag), joint), original)
    assert formats.contents(bag) == (
        "/link_states (sensor_msgs/msg/JointState)",
        "/motor_states (sensor_msgs/msg/JointState)",
        "/motor_torques (joint_id_msgs/msg/MotorTorques)",
        "/motor_voltages (joint_id_msgs/msg/MotorVoltages)",
    )


@pytest.mark.parametrize("storage", STORAGES)
def test_derived_channels_go_to_joint_samples_and_keep_their_mark(tmp_path, storage):
    one = recording(tuple(MEASURED_BITS), seed=3)
    one = one.with_channels({"link_acceleration": one["link_acceleration"]}, derived=True)
    two = Recording(one.time, {"current": np.arange(20.0)})
    formats.write_bag(tmp_path / "bag", {"one": one, "two": two}, storage)
    assert formats.contents(tmp_path / "bag") == ("/joint_samples (joint_id_msgs/msg/JointSamples)",)
    assert_same(formats.read(tmp_path / "bag", "one"), one)
    assert_same(formats.read(tmp_path / "bag", "two"), two)


@pytest.mark.parametrize("start", [0.0, 1.7e9])
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=25, deadline=None)
@given(data=st.data())
def test_any_recording_reads_back_exactly(tmp_path_factory, start, data):
    steps = data.draw(st.lists(st.integers(1000, 10**10), min_size=1, max_size=12))
    stamps = np.cumsum(steps).tolist()
    values = st.one_of(st.floats(allow_nan=False, allow_infinity=False), st.just(np.nan))
    columns = {
        name: np.array(data.draw(st.lists(values, min_size=len(stamps), max_size=len(stamps))))
        for name in data.draw(st.sets(st.sampled_from(RAW), min_size=1))
    }
    columns = {name: column for name, column in columns.items() if not np.isnan(column).all()}
    if not columns:
        return
    original = Recording(np.array([k / 10**9 for k in stamps]), columns, origin=int(start))
    path = tmp_path_factory.mktemp("round") / "bag"
    formats.write_bag(path, {"j": original}, data.draw(st.sampled_from(STORAGES)))
    assert_same(formats.read(path), original)


def test_a_command_and_the_controllers_load_can_be_read(tmp_path):
    """From the driver's robot_signals: the command by itself, other fields by a mapping."""
    one = recording(("link_position", "current", "reference_position"))
    formats.write(tmp_path / "bag", one)
    back = formats.read(tmp_path / "bag")
    np.testing.assert_array_equal(back["reference_position"], one["reference_position"])
    mapping = {"link_position": "link_states.position", "external_torque": "2*robot_signals.target_q"}
    mapped = formats.read(tmp_path / "bag", mapping=mapping)
    np.testing.assert_array_equal(mapped["external_torque"], 2.0 * one["reference_position"])
    with pytest.raises(JointIdError, match="no message carries reference_position"):
        formats.write(tmp_path / "other", recording(("link_acceleration", "reference_position")))


def test_stamps_of_a_clock_keep_their_nanoseconds(tmp_path):
    """As seconds since 1970 in doubles, they would be rounded to 0.24 us."""
    time = 0.25 + np.arange(5) * 0.002 + 1e-9 * np.array([0, 1, 2, 3, 4])
    original = Recording(time, {"link_position": np.arange(5.0)}, origin=1_700_000_000)
    formats.write_bag(tmp_path / "bag", {"j": original}, "mcap")
    back = formats.read(tmp_path / "bag")
    assert back.origin == original.origin
    np.testing.assert_allclose(back.time, time, rtol=0, atol=1e-15)


def test_bag_is_read_by_the_mcap_package(tmp_path):
    original = recording(seed=4)
    formats.write_bag(tmp_path / "bag", {"j": original}, "mcap")
    store = typestore()
    position, torque, stamps = [], [], []
    with data_file(tmp_path / "bag").open("rb") as file:
        for schema, channel, message in mcap.reader.make_reader(file, validate_crcs=True).iter_messages():
            assert (schema.encoding, channel.message_encoding) == ("ros2msg", "cdr")
            if schema.name.startswith("joint_id_msgs"):  # self-contained: everything but ROS's own is in the file
                assert b"MSG: std_msgs/Header" in schema.data
            decoded = store.deserialize_cdr(message.data, schema.name)
            if channel.topic == "/link_states":
                position.extend(decoded.position)
                stamps.append(message.log_time)
                assert decoded.header.stamp.sec * 10**9 + decoded.header.stamp.nanosec == message.log_time
            if channel.topic == "/motor_torques":
                torque.extend(decoded.torque)
    np.testing.assert_array_equal(position, original["link_position"])
    np.testing.assert_array_equal(torque, original["torque"])
    np.testing.assert_array_equal(stamps, np.rint(original.time * 1e9))


@pytest.mark.parametrize("storage", STORAGES)
def test_bag_is_self_contained_for_plain_rosbags(tmp_path, storage):
    original = recording(("voltage",), seed=5)
    formats.write_bag(tmp_path / "bag", {"j": original}, storage)
    voltage = []
    with Reader(tmp_path / "bag") as reader:
        store = get_typestore(Stores.EMPTY)
        for connection in reader.connections:
            store.register(get_types_from_msg(connection.msgdef.data, connection.msgtype))
        for connection, _, data in reader.messages():
            message = store.deserialize_cdr(data, connection.msgtype)
            assert message.name == ["j"]
            voltage.extend(message.voltage)
    np.testing.assert_array_equal(voltage, original["voltage"])


@pytest.mark.parametrize("storage", STORAGES)
def test_metadata_is_that_of_jazzy(tmp_path, storage):
    original = recording(("link_position",))
    formats.write_bag(tmp_path / "bag", {"j": original}, storage)
    info = yaml.safe_load((tmp_path / "bag" / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert (info["version"], info["storage_identifier"], info["message_count"]) == (9, storage, 20)
    topic = info["topics_with_message_count"][0]["topic_metadata"]
    assert topic["type_description_hash"].startswith("RIHS01_")
    assert info["starting_time"]["nanoseconds_since_epoch"] == round(original.time[0] * 1e9)


@pytest.mark.skipif(not MESSAGES.exists(), reason="joint_id_msgs is not beside this package")
@pytest.mark.parametrize("name", list(DEFINITIONS))
def test_definitions_agree_with_the_interface_package(name):
    file = MESSAGES / (name.rsplit("/", 1)[-1] + ".msg")
    assert get_types_from_msg(file.read_text(), name) == get_types_from_msg(DEFINITIONS[name], name)


def test_mask_bits_are_those_of_the_message():
    constants, _ = get_types_from_msg(DEFINITIONS["joint_id_msgs/msg/JointSamples"], "joint_id_msgs/msg/JointSamples")[
        "joint_id_msgs/msg/JointSamples"
    ]
    assert {name.lower(): value for name, _, value in constants} == MEASURED_BITS


@pytest.mark.parametrize(
    ("robot", "storage", "message"),
    [
        ({}, "mcap", r"no sample to write"),
        ({"j": Recording(np.array([]), {"current": np.array([])})}, "mcap", r"no sample to write"),
        ({"j": recording()}, "rosbag", r"storage 'rosbag': choose one of mcap, sqlite3"),
        ({"j": recording(start=-5.0)}, "mcap", r"joint j runs from -4.99\d* to .* a stamp holds 0 to 2147483648 s"),
        ({"j": recording(start=1e12)}, "mcap", r"a stamp holds 0 to"),
        (
            {"j": Recording(np.array([0, 1e-10]), {"current": np.zeros(2)})},
            "mcap",
            r"joint j, sample 1 comes within 1 ns of the one before",
        ),
    ],
)
def test_what_cannot_be_written(tmp_path, robot, storage, message):
    with pytest.raises(JointIdError, match=message):
        formats.write_bag(tmp_path / "bag", robot, storage)
    assert not (tmp_path / "bag").exists()


def test_nothing_is_overwritten(tmp_path):
    formats.write_bag(tmp_path / "bag", {"j": recording()})
    before = data_file(tmp_path / "bag").read_bytes()
    with pytest.raises(JointIdError, match="bag exists already: remove it or choose another name"):
        formats.write_bag(tmp_path / "bag", {"j": recording()})
    assert data_file(tmp_path / "bag").read_bytes() == before


def test_several_joints_are_read_in_one_pass_as_each_by_itself(tmp_path, monkeypatch):
    """A bag of an arm was read once for each of its joints."""
    formats.write_bag(tmp_path / "bag", {name: recording(seed=seed) for seed, name in enumerate("abc")})
    part, names = Part({}, 0.03, None), ("c", "a")
    alone = {name: part.read(tmp_path / "bag", name) for name in names}
    passes, opened = [], bag_reader.opened
    monkeypatch.setattr(bag_reader, "opened", lambda path: (passes.append(path), opened(path))[1])
    together = part.read_joints(tmp_path / "bag", names)
    assert len(passes) == 1 and tuple(together) == names
    for name in names:
        assert_same(together[name], alone[name])
