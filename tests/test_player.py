"""Node `player`: every recorded message arrives, whatever the speed; bad bags end it with one clear line."""

import numpy as np
import pytest
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from joint_id_core.data.recording import Recording
from joint_id_core.formats import read, write_bag
from joint_id_msgs.msg import JointSamples
from joint_id_ros.qos import CLOCK

NANO = 10**9
BEGIN_S = 1000.0
COUNT = 6000  # more than the middleware holds for a reader
FEW = 2000


@pytest.fixture(params=["mcap", pytest.param("sqlite3", marks=pytest.mark.long)])
def storage(request):
    return request.param


@pytest.fixture
def bag(tmp_path):
    return write(tmp_path / "bag", count=FEW)


def write(path, storage="mcap", count=COUNT):
    t = BEGIN_S + np.arange(count) * 0.002
    q = 0.3 * np.sin(2 * np.pi * t)
    channels = {"link_position": q, "current": 2 * q, "motor_position": 101 * q, "motor_velocity": np.cos(t)}
    write_bag(path, {"joint": Recording(t, channels)}, storage)
    return path


def stamps(messages):
    return [m.header.stamp.sec * NANO + m.header.stamp.nanosec for m in messages]


def recorded(count=COUNT):
    return [round(BEGIN_S * NANO) + k * 2_000_000 for k in range(count)]


@pytest.mark.long
def test_a_slow_reader_gets_every_message_and_the_player_waits_for_it(start, probe, tmp_path, storage):
    bag = write(tmp_path / "slow", storage)
    got = probe.collect(JointState, "link_states", delay_s=0.0005)
    motors = probe.collect(JointState, "motor_states")
    player = start("player", bag=bag, rate=0.0)
    probe.until(lambda: len(got) == COUNT and len(motors) == COUNT, "all messages")
    assert stamps(got) == stamps(motors) == recorded()
    assert [m.position[0] for m in got] == list(0.3 * np.sin(2 * np.pi * (BEGIN_S + np.arange(COUNT) * 0.002)))
    assert player.wait() == 0
    assert f"played {2 * COUNT} messages" in player.text


@pytest.mark.long
def test_a_bag_that_was_not_closed_is_played_to_its_last_complete_chunk(start, probe, tmp_path):
    bag = write(tmp_path / "bag")
    file = bag / "bag.mcap"
    data = file.read_bytes()
    file.write_bytes(data[: len(data) * 3 // 4])
    (bag / "metadata.yaml").unlink()
    found = read(bag)
    links, motions = (int(np.isfinite(found[name]).sum()) for name in ("link_position", "motor_position"))
    assert COUNT / 3 < motions <= links < COUNT
    got = probe.collect(JointState, "link_states")
    motors = probe.collect(JointState, "motor_states")
    player = start("player", bag=bag, rate=0.0)
    probe.until(lambda: len(got) == links and len(motors) == motions, "all messages")
    assert stamps(got) == recorded()[:links]
    assert player.wait() == 0
    assert f"bag: not closed: {links + motions:,} messages recovered" in player.text


def test_the_clock_runs_through_the_time_of_the_bag(start, probe, bag):
    links = probe.collect(JointState, "link_states")
    motors = probe.collect(JointState, "motor_states")
    clock = probe.collect(Clock, "/clock", CLOCK)
    player = start("player", bag=bag, rate=4.0)
    probe.until(lambda: len(links) == len(motors) == FEW, "all messages")
    end = recorded(FEW)[-1]
    probe.until(lambda: clock and clock[-1].clock.sec * NANO + clock[-1].clock.nanosec == end, "the end of the bag")
    assert player.wait() == 0
    times = [c.clock.sec * NANO + c.clock.nanosec for c in clock]
    assert recorded(FEW)[0] <= times[0] < end
    assert times == sorted(times)


def test_a_node_on_simulated_time_lives_in_the_time_of_the_bag(start, probe, bag):
    samples = probe.collect(JointSamples, "joint_samples")
    start("filter", use_sim_time=True)
    probe.until(lambda: probe.count_publishers("joint_samples"), "the filter")
    arrays = probe.collect_headers()
    start("player", bag=bag, rate=2.0)
    probe.until(lambda: len(samples) > FEW - 200, "samples")
    assert stamps(samples) == recorded(FEW)[: len(samples)]
    inside = [t for name, t in arrays if name == "/filter" and t > 0.0]
    assert inside and all(BEGIN_S <= t <= BEGIN_S + FEW * 0.002 for t in inside)
    assert probe.told("filter", "another clock") is None


def test_a_namespace_and_a_choice_of_topics(start, probe, bag):
    links = probe.collect(JointState, "/arm/link_states")
    motors = probe.collect(JointState, "/arm/motor_states")
    player = start("player", "-r", "__ns:=/arm", bag=bag, rate=0.0, topics=["/link_states"])
    probe.until(lambda: len(links) == FEW, "all messages")
    assert player.wait() == 0
    assert not motors


def truncated(tmp_path):
    path = write(tmp_path / "cut", count=FEW)
    file = next(path.glob("*.mcap"))
    file.write_bytes(file.read_bytes()[:20_000])
    return path


def empty_file(tmp_path):
    (tmp_path / "none.mcap").write_bytes(b"")
    return tmp_path / "none.mcap"


def no_bag(tmp_path):
    (tmp_path / "folder").mkdir()
    return tmp_path / "folder"


def missing(tmp_path):
    return tmp_path / "nowhere"


@pytest.mark.parametrize("make", [truncated, empty_file, no_bag, missing])
def test_a_bad_bag_ends_the_player_with_one_line_and_exit_code_2(start, tmp_path, make):
    path = make(tmp_path)
    player = start("player", bag=path, wait_s=0.0)
    assert player.wait() == 2
    lines = player.text.strip().splitlines()
    assert len(lines) == 1
    assert lines[0].startswith("player: ") and str(path) in lines[0]


@pytest.mark.parametrize(
    ("parameters", "text"),
    [({}, "parameter bag is empty"), ({"topics": ["joint_states"]}, "no topic joint_states: it has link_states"),
     ({"rate": -1.0}, "rate out of range"), ({"rate": "fast"}, "rate")],
)  # fmt: skip
def test_bad_parameters_end_the_player_with_one_line_and_exit_code_2(start, bag, parameters, text):
    player = start("player", **({"bag": bag, **parameters} if parameters else {}))
    assert player.wait() == 2
    assert text in player.text
    assert len(player.text.strip().splitlines()) == 1
