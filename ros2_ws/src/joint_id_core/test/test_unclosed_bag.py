"""rosbag2 in: mcap files without an end, as a kill, a full disk or a broken copy leaves them."""

import logging
import shutil

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType, Writer
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from joint_id_core import formats
from joint_id_core.errors import JointIdError

from .bag_parts import JOINT_STATE, joint_state, recording
from .examples import TIMES
from .quick import first_quick

STORE = get_typestore(Stores.ROS2_JAZZY)
CHUNK = 40  # messages
COUNT = 200  # messages a topic
TOPICS = ("/link_states", "/motor_states")
STAMPS = [(5 + k) * 2_000_000 for k in range(COUNT)]


def whole_file(path, compression=CompressionType.NONE, chunks=True, crcs=True):
    """Write a bag of two topics, message by message; return the size of the file at the end of each chunk."""
    sizes = []
    with path.open("wb") as file:
        writer = Writer(file, compression=compression, use_chunking=chunks, enable_crcs=crcs)
        writer.start(profile="ros2")
        definition, _ = STORE.generate_msgdef(JOINT_STATE, ros_version=2)
        schema = writer.register_schema(JOINT_STATE, "ros2msg", definition.encode())
        topics = [writer.register_channel(topic, "cdr", schema) for topic in TOPICS]
        for k, stamp in enumerate(STAMPS):
            for n, topic in enumerate(topics):
                message = joint_state(STORE, stamp, ["elbow"], position=[k + 0.25 * n])
                # The second topic is received late, so that the order of the file is not that of time.
                writer.add_message(topic, stamp + n, STORE.serialize_cdr(message, JOINT_STATE), stamp)
            if (k + 1) % CHUNK == 0:
                writer.flush()
                sizes.append(file.tell())
        writer.finish()
    return sizes


def assert_beginning(found, at_least=0):
    """The recording is the beginning of what was written, with the right values."""
    link = found["link_position"][np.isfinite(found["link_position"])]
    assert len(link) >= at_least
    np.testing.assert_array_equal(link, np.arange(len(link)))
    np.testing.assert_allclose(found.time + found.origin, np.array(STAMPS[: len(found)]) / 1e9, rtol=0, atol=1e-12)
    if "motor_position" in found:
        motor = found["motor_position"][np.isfinite(found["motor_position"])]
        np.testing.assert_array_equal(motor, np.arange(len(motor)) + 0.25)


KINDS = {
    "plain": {},
    "zstd": {"compression": CompressionType.ZSTD},
    "lz4": {"compression": CompressionType.LZ4},
    "without checksums": {"crcs": False},
    "without chunks": {"chunks": False},  # as `ros2 bag record --storage-preset-profile fastwrite` writes it
}


@pytest.fixture(scope="module", params=KINDS)
def written(request, tmp_path_factory):
    path = tmp_path_factory.mktemp("written") / "whole.mcap"
    return whole_file(path, **KINDS[request.param]), path.read_bytes()


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    """The bytes of all chunks, without the index."""
    path = tmp_path_factory.mktemp("plain") / "whole.mcap"
    sizes = whole_file(path)
    return path.read_bytes()[: sizes[-1]]


@pytest.mark.parametrize("chunks", first_quick([3, 1]))
def test_what_is_complete_is_read_and_said(tmp_path, written, chunks, caplog):
    sizes, data = written
    bag = tmp_path / "bag"
    bag.mkdir()
    (bag / "bag_0.mcap").write_bytes(data[: sizes[chunks - 1] + 30])
    with caplog.at_level(logging.WARNING):
        found = formats.read(bag, "elbow")
        assert formats.joints(bag) == ("elbow",)
        assert formats.contents(bag) == tuple(f"{topic} ({JOINT_STATE})" for topic in TOPICS)
    assert_beginning(found, chunks * CHUNK)
    count = sum(np.isfinite(found[name]).sum() for name in found.channels)
    assert [r.getMessage() for r in caplog.records] == [f"{bag}: not closed: {count} messages recovered"]
    assert_beginning(formats.read(bag / "bag_0.mcap"), chunks * CHUNK)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=15 * TIMES, deadline=None)
@given(share=st.floats(0, 1))
def test_a_file_cut_anywhere_gives_its_beginning_or_one_clear_line(tmp_path, written, share):
    sizes, data = written
    cut = int(share * (len(data) - 1))
    path = tmp_path / "cut.mcap"
    path.write_bytes(data[:cut])
    complete = sum(size <= cut for size in sizes) * CHUNK
    try:
        found = formats.read(path, "elbow")
    except JointIdError as error:
        assert complete == 0
        assert str(error).startswith(str(path)) and "\n" not in str(error)
    else:
        assert_beginning(found, complete)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=40 * TIMES, deadline=None)
@given(place=st.floats(0, 1), bit=st.integers(0, 7), tail=st.binary(max_size=40))
def test_a_damaged_byte_never_becomes_a_wrong_number(tmp_path, plain, place, bit, tail):
    """Power may fail while the file is written, so that bytes are wrong; the checksums of the chunks show it."""
    path = tmp_path / "damaged.mcap"
    data = bytearray(plain)
    data[min(int(place * len(data)), len(data) - 1)] ^= 1 << bit
    path.write_bytes(bytes(data) + tail)
    try:
        found = formats.read(path, "elbow")
    except JointIdError as error:
        assert "\n" not in str(error)
        return
    for n, name in enumerate(("link_position", "motor_position")):
        rows = np.rint((found.time + found.origin) * 500 - 5)
        measured = np.isfinite(found[name])
        np.testing.assert_array_equal(found[name][measured], rows[measured] + 0.25 * n)


def test_topics_are_in_the_order_of_time_across_chunks(tmp_path):
    from joint_id_core.formats.opened_bag import opened

    path = tmp_path / "late.mcap"
    times = [30, 50, 20, 10, 55, 5, 40, 70, 60]
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2")
        schema = writer.register_schema(
            JOINT_STATE, "ros2msg", STORE.generate_msgdef(JOINT_STATE, ros_version=2)[0].encode()
        )
        topic = writer.register_channel("/link_states", "cdr", schema)
        for time in times:
            message = joint_state(STORE, time, ["elbow"], position=[time])
            writer.add_message(topic, time, STORE.serialize_cdr(message, JOINT_STATE), time)
            if time % 20 == 0:
                writer.flush()
    with opened(path) as reader:
        assert [time for _, time, _ in reader.messages(reader.connections)] == sorted(times)
        assert (reader.start_time, reader.message_count) == (5, 9)


def test_a_long_bag_of_another_writer_is_read_without_its_end(tmp_path):
    """rosbags writes chunks of 1 MiB without checksums."""
    original = recording(("link_position", "current", "motor_position"), n=12_000)
    formats.write_bag(tmp_path / "bag", {"elbow": original})
    file = tmp_path / "bag" / "bag.mcap"
    data = file.read_bytes()
    file.write_bytes(data[: len(data) * 3 // 4])
    found = formats.read(tmp_path / "bag")
    assert 0.4 * len(original) < len(found) < len(original)
    np.testing.assert_allclose(found.time, original.time[: len(found)], rtol=0, atol=1e-9)
    for name in original.channels:
        last = np.flatnonzero(np.isfinite(found[name]))[-1] + 1
        np.testing.assert_array_equal(found[name][:last], original[name][:last])


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_a_directory_whose_index_is_lost(tmp_path, storage, caplog):
    original = recording(("link_position",))
    formats.write_bag(tmp_path / "bag", {"elbow": original}, storage)
    (tmp_path / "bag" / "metadata.yaml").unlink()
    np.testing.assert_array_equal(formats.read(tmp_path / "bag")["link_position"], original["link_position"])
    assert not caplog.records  # it was closed
    file = next((tmp_path / "bag").iterdir())
    shutil.copy(file, file.with_stem("second"))
    with pytest.raises(JointIdError, match=r"no metadata.yaml in it and several files \(bag\.\w+, second"):
        formats.read(tmp_path / "bag")


def test_files_of_others_and_files_without_a_message(tmp_path):
    path = tmp_path / "other.mcap"
    for profile, says in (
        ("x-drone", "profile 'x-drone': give one of ROS 2"),
        ("ros2", "no complete message is in it"),
    ):
        with path.open("wb") as file:
            Writer(file).start(profile=profile)
        with pytest.raises(JointIdError, match=says):
            formats.read(path)


def test_closed_bags_are_left_to_the_ordinary_reader(tmp_path):
    from joint_id_core.formats.opened_bag import opened

    formats.write_bag(tmp_path / "bag", {"elbow": recording()})
    with opened(tmp_path / "bag") as reader:
        assert isinstance(reader, Reader)
