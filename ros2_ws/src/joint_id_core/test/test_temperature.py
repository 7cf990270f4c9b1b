"""The temperature of a joint travels with its samples and stands in the estimate."""

import math

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from joint_id_core import formats
from joint_id_core.alignment.aligner import CONDITION_S, Aligner, Columns
from joint_id_core.alignment.inputs import InputOptions
from joint_id_core.data.recording import Recording
from joint_id_core.estimators import fit
from joint_id_core.formats.definitions import DEFINITIONS
from joint_id_core.models import build
from joint_id_core.online import OnlineIdentifier, OnlineOptions
from joint_id_core.results.estimate import Estimate

from .bag_parts import STORAGES, data_file, joint_state

N = 1000
PERIOD_NS = 2_000_000


@pytest.fixture(scope="module")
def warming():
    """A rigid joint that warms up while it moves."""
    time = 0.002 * np.arange(N)
    position = 0.3 * np.sin(8.0 * time)
    torque = -0.2 * 0.3 * 64.0 * np.sin(8.0 * time) + 0.5 * 0.3 * 8.0 * np.cos(8.0 * time)
    noise = 1e-5 * np.random.default_rng(3).normal(size=N)
    temperature = 30.0 + 0.5 * time
    return Recording(time, {"link_position": position + noise, "torque": torque, "temperature": temperature})


@pytest.mark.parametrize("name", ["motion.csv", "bag"])
def test_a_file_carries_it_to_the_estimate(tmp_path, warming, name):
    formats.write(tmp_path / name, warming)
    back = formats.read(tmp_path / name)
    np.testing.assert_array_equal(back["temperature"], warming["temperature"])
    estimate = fit(build("rigid_joint"), back)
    assert estimate.temperature == pytest.approx(30.4995, abs=1e-9)
    assert "at 30.5 deg C" in str(estimate)
    assert estimate.to_dict()["temperature_deg_c"] == estimate.temperature
    assert Estimate.from_dict(estimate.to_dict()).temperature == estimate.temperature


def test_it_changes_no_other_figure_of_the_estimate(warming):
    without = Recording(warming.time, {n: v for n, v in warming.channels.items() if n != "temperature"})
    one, other = (fit(build("rigid_joint"), r) for r in (warming, without))
    assert math.isnan(other.temperature)
    assert other.to_dict()["temperature_deg_c"] is None
    assert "deg C" not in str(other)
    assert one.values == other.values and (one.covariance == other.covariance).all()


def test_estimates_of_older_files_have_none(warming):
    content = fit(build("rigid_joint"), warming).to_dict()
    del content["temperature_deg_c"]
    assert math.isnan(Estimate.from_dict(content).temperature)


def test_a_window_has_its_own_mean(warming):
    """Also where the samples only pass the filter; the node passes samples in small batches."""
    identifier = OnlineIdentifier(build("rigid_joint"), options=OnlineOptions(window_s=1.0, hop_s=0.1))
    updates = [identifier.update(warming.slice(k, k + 7)) for k in range(0, N, 7)]
    found = [estimate for estimate in updates if estimate is not None]
    assert len(found) > 8 and any(estimate.iterations == 0 for estimate in found)
    for estimate in found:
        assert estimate.temperature == pytest.approx(30.0 + 0.25 * (estimate.start + estimate.end), abs=0.003)


@pytest.mark.parametrize("storage", STORAGES)
def test_a_bag_of_raw_topics_has_it_on_robot_signals(tmp_path, storage):
    time = 0.002 * np.arange(8)
    rows = {"link_position": np.arange(8.0), "temperature": np.where(np.arange(8) % 4, np.nan, 30.0)}
    formats.write_bag(tmp_path / "bag", {"a": Recording(time, rows), "b": Recording(time, rows)}, storage)
    assert any("robot_signals" in topic for topic in formats.contents(tmp_path / "bag"))
    assert formats.joints(tmp_path / "bag") == ("a", "b")
    for name, values in formats.read(tmp_path / "bag", "b").channels.items():
        np.testing.assert_array_equal(values, rows[name])


def test_derived_channels_go_with_it_on_joint_samples(tmp_path):
    original = Recording(
        0.002 * np.arange(5.0), {"link_velocity": np.arange(5.0), "temperature": np.full(5, 31.25)},
        frozenset({"link_velocity"}),
    )  # fmt: skip
    formats.write_bag(tmp_path / "bag", {"a": original})
    back = formats.read(tmp_path / "bag")
    assert back["temperature"].tolist() == [31.25] * 5
    assert back.derived == {"link_velocity"}


def test_samples_recorded_before_there_were_temperatures_are_read(tmp_path):
    name = "joint_id_msgs/msg/JointSamples"
    text = DEFINITIONS[name].replace("float64[] temperature\n", "").replace("uint16 TEMPERATURE=512\n", "")
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg(text, name))
    fields = [field for field, _ in store.fielddefs[name][1] if field not in ("header", "name", "measured")]
    arrays = {field: np.array([2.5]) for field in fields}
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/joint_samples", name, typestore=store)
        message = store.types[name](header=joint_state(store, 5, []).header, name=["a"], measured=511, **arrays)
        writer.write(connection, 1, store.serialize_cdr(message, name))
    (tmp_path / "unclosed.mcap").write_bytes(data_file(tmp_path / "bag").read_bytes()[:-1])
    for target in (tmp_path / "bag", data_file(tmp_path / "bag"), tmp_path / "unclosed.mcap"):
        back = formats.read(target)
        assert back["torque"].tolist() == [2.5]
        assert "temperature" not in back


def feed(aligner, first, count, temperature=None):
    """Samples of the joints a and b; a message with the temperature of b comes before each, if there is one."""
    found = []
    for k in range(first, first + count):
        stamp = 10**9 + k * PERIOD_NS
        if temperature is not None:
            aligner.join("robot_signals", stamp, Columns(("b",), {"temperature": np.array([temperature])}))
            assert not aligner.align()
        aligner.join("link_states", stamp, Columns(("a", "b"), {"link_position": np.array([0.1, 0.2])}))
        found += aligner.align()
    return found


def test_the_newest_value_holds_until_it_is_too_old():
    aligner = Aligner(InputOptions(effort_source="current", join_wait_s=0.0))
    samples = feed(aligner, 0, 200)
    assert samples and all("temperature" not in s.channels for s in samples)
    feed(aligner, 200, 1, temperature=33.0)
    last = feed(aligner, 201, 400)[-1]
    np.testing.assert_array_equal(last.channels["temperature"][-1], [np.nan, 33.0])
    assert "temperature" not in last.derived
    later = int(CONDITION_S * 1e9 / PERIOD_NS)
    ages = {
        (instant_ns - 10**9) / 1e9 - 0.4: temperatures[1]
        for s in feed(aligner, 601, later)
        for instant_ns, temperatures in zip(s.instants_ns, s.channels["temperature"], strict=True)
    }
    assert all((value == 33.0) == (age <= CONDITION_S + 1e-9) for age, value in ages.items())
    assert any(math.isnan(value) for value in ages.values())
