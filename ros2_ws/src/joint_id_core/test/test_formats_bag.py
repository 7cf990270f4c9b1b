"""rosbag2 in and out: our bags against other readers, other writers' bags against ours, damaged bags."""

from pathlib import Path

import mcap.reader
import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from joint_id_core import formats
from joint_id_core.errors import JointIdError
from joint_id_core.formats.definitions import DEFINITIONS, typestore
from joint_id_core.formats.topics import MEASURED_BITS
from joint_id_core.recording import Recording

MESSAGES = Path(__file__).resolve().parents[2] / "joint_id_msgs" / "msg"
STORAGES = ("mcap", "sqlite3")
JOINT_STATE = "sensor_msgs/msg/JointState"
RAW = ("link_position", "link_velocity", "current", "motor_position", "motor_velocity", "voltage", "torque")


def recording(channels=RAW, n=20, seed=0, start=0.0):
    rng = np.random.default_rng(seed)
    time = start + (np.cumsum(rng.integers(1, 9, n)) * 1_234_567) / 1e9
    values = {name: rng.normal(size=n) for name in channels}
    for column in values.values():
        column[3] = np.nan
    return Recording(time, values)


def assert_same(back, original):
    np.testing.assert_array_equal(back.time, original.time)
    assert set(back.channels) == set(original.channels)
    assert back.derived == original.derived
    for name in original.channels:
        np.testing.assert_array_equal(back[name], original[name], strict=True)


def joint_state(store, stamp, names, position=(), velocity=(), effort=()):
    types = store.types
    time = types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
    arrays = [np.array(values, dtype=float) for values in (position, velocity, effort)]
    return types[JOINT_STATE](types["std_msgs/msg/Header"](time, ""), list(names), *arrays)


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


def data_file(path):
    return next(p for p in path.iterdir() if p.suffix in (".mcap", ".db3"))


# Writing and reading back


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
    stamps = [int(start) * 10**9 + k for k in np.cumsum(steps).tolist()]
    values = st.one_of(st.floats(allow_nan=False, allow_infinity=False), st.just(np.nan))
    columns = {
        name: np.array(data.draw(st.lists(values, min_size=len(stamps), max_size=len(stamps))))
        for name in data.draw(st.sets(st.sampled_from(RAW), min_size=1))
    }
    columns = {name: column for name, column in columns.items() if not np.isnan(column).all()}
    if not columns:
        return
    original = Recording(np.array([k / 10**9 for k in stamps]), columns)
    path = tmp_path_factory.mktemp("round") / "bag"
    formats.write_bag(path, {"j": original}, data.draw(st.sampled_from(STORAGES)))
    assert_same(formats.read(path), original)


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
        ({"j": recording(("external_torque",))}, "mcap", r"no message carries external_torque \(joint j\)"),
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


# Bad bags


@pytest.mark.parametrize("storage", STORAGES)
@pytest.mark.parametrize("share", [0.0, 0.001, 0.3, 0.7, 0.99])
@pytest.mark.parametrize("bare", [False, True])
def test_truncated_bags(tmp_path, storage, share, bare):
    formats.write_bag(tmp_path / "bag", {"j": recording(n=2000)}, storage)
    file = data_file(tmp_path / "bag")
    whole = file.read_bytes()
    file.write_bytes(whole[: int(share * len(whole))])
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
            "/joint_states",
            r"no known topic: it has /joint_states \(sensor_msgs/msg/JointState\); understood are link_states, .*"
            r"; name the fields of others, e.g. --map link_position=joint_states.position --map current=joint_st",
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
