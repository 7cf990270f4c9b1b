"""`joint-id record` that is killed, or whose disk is full, leaves a bag that can be read."""

import random
import resource
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from sensor_msgs.msg import JointState

from joint_id_core import formats
from joint_id_ros.recorder import Recorder, drain

PATIENCE_S = 180.0  # a limit for tests that hang, not a measure of speed
JOINT_ID = "from joint_id_core.cli import main; main()"
PERIOD_S = 0.002
LOSS_S = 2.0  # what a kill may cost


@pytest.fixture
def source(domain):
    """A publisher of link_states at 500 Hz; position and stamp tell the number of the message."""
    rclpy.init()
    node = rclpy.create_node("source")
    source = Source(node.create_publisher(JointState, "link_states", 2000))
    yield source
    source.stop()
    node.destroy_node()
    rclpy.try_shutdown()


class Source:
    """Publishes from a thread until it is stopped.

    Attributes:
        count: number of messages published.
    """

    def __init__(self, publisher):
        self.count = 0
        self._publisher, self._ended = publisher, threading.Event()
        self._thread = threading.Thread(target=self._run)

    def start(self, subscribers):
        """Publish as soon as all have subscribed."""
        until(lambda: self._publisher.get_subscription_count() >= subscribers, "subscribers")
        self._thread.start()

    def _run(self):
        begin = time.monotonic()
        while not self._ended.wait(max(0.0, begin + self.count * PERIOD_S - time.monotonic())):
            self._publisher.publish(numbered(self.count))
            self.count += 1

    def stop(self):
        self._ended.set()
        if self._thread.is_alive():
            self._thread.join()


def numbered(number):
    """Return the message of this number."""
    message = JointState(name=["elbow"], position=[float(number)])
    message.header.stamp.sec, part = divmod(500 + number, 500)
    message.header.stamp.nanosec = part * 2_000_000
    return message


def until(condition, what):
    end = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end, f"waited for {what}"
        time.sleep(0.01)


def start(*arguments, before="", **options):
    command = [sys.executable, "-c", before + JOINT_ID, *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options)


def joint_id(*arguments):
    return subprocess.run(
        [sys.executable, "-c", JOINT_ID, *map(str, arguments)], capture_output=True, text=True, timeout=PATIENCE_S
    )


def beginning(bag):
    """Return the number of messages in the bag, after a check that they are the first ones, each with its value."""
    found = formats.read(bag)
    numbers = np.arange(len(found))
    np.testing.assert_array_equal(found["link_position"], numbers)
    np.testing.assert_allclose(found.time + found.origin, 1.0 + numbers * PERIOD_S, rtol=0, atol=1e-9)
    return len(found)


def kill_at_random(source, folder, moments):
    """Kill one recorder at each of the moments, in s; return what each lost, in s."""
    bags = [folder / f"bag{k}" for k in range(len(moments))]
    processes = [start("record", bag, "link_states") for bag in bags]
    lost = []
    try:
        source.start(len(processes))
        for moment, process, bag in sorted(zip(moments, processes, bags, strict=True), key=lambda row: row[0]):
            until(lambda: source.count >= moment / PERIOD_S, "the moment")  # noqa: B023
            process.send_signal(signal.SIGKILL)
            process.wait()
            published = source.count
            saved = beginning(bag) if list(bag.glob("*.mcap")) and has_messages(bag) else 0
            lost.append((published - saved) * PERIOD_S)
    finally:
        for process in processes:
            process.kill()
            process.communicate()
    return lost


def has_messages(bag):
    """Return whether the bag has a complete chunk; without one, it must be refused in one line."""
    found = joint_id("info", bag)
    assert "Traceback" not in found.stderr and len(found.stderr.splitlines()) == 1
    assert "not closed" in found.stderr if found.returncode == 0 else "not a readable bag" in found.stderr
    return found.returncode == 0


@pytest.mark.long
@pytest.mark.parametrize("batch", [pytest.param(k, marks=pytest.mark.long if k else []) for k in range(10)])
def test_a_kill_at_any_moment_costs_at_most_two_seconds(source, tmp_path, batch):
    chance = random.Random(batch)
    count = 5 if batch else 3
    lost = kill_at_random(source, tmp_path, [chance.uniform(0.1, 6.0) for _ in range(count)])
    # The median: on a busy computer a recorder may come late once.
    assert sorted(lost)[count // 2] <= LOSS_S, lost


def test_a_killed_recording_is_shown_and_fitted(source, tmp_path):
    bag = tmp_path / "bag"
    process = start("record", bag)
    source.start(1)
    file = bag / "bag.mcap"
    until(lambda: file.exists() and file.stat().st_size > 100_000, "two seconds of data on the disk")
    process.send_signal(signal.SIGKILL)
    process.communicate()
    assert not (bag / "metadata.yaml").exists()
    count = beginning(bag)
    told = f"{bag}: not closed: {count:,} messages recovered"
    for command in (["info"], ["fit", "--model", "rigid_joint"]):
        result = joint_id(command[0], bag, *command[1:])
        assert result.stderr.splitlines()[0] == told
        assert "Traceback" not in result.stderr
    assert f"{count} samples" in joint_id("info", bag).stdout


def test_what_arrives_after_the_end_is_not_written(domain, tmp_path):
    """A publisher that goes on does not keep the recorder from its end."""
    rclpy.init()
    node, recorder = rclpy.create_node("source"), Recorder(tmp_path / "bag", ["link_states"])
    try:
        publisher = node.create_publisher(JointState, "link_states", 2000)
        executor = Flooded(publisher, context=recorder.context)
        executor.add_node(recorder)
        end = time.monotonic() + PATIENCE_S
        while recorder.count < 10:
            assert time.monotonic() < end, "nothing arrived"
            executor.spin_once(timeout_sec=0.1)
        count = executor.count
        drain(recorder, executor)
        recorder.close()
        assert 10 <= recorder.count <= count
        assert beginning(tmp_path / "bag") == recorder.count
    finally:
        recorder.destroy_node()
        node.destroy_node()
        rclpy.try_shutdown()


class Flooded(SingleThreadedExecutor):
    """Publishes a message before each callback, as a robot would meanwhile."""

    def __init__(self, publisher, **options):
        super().__init__(**options)
        self.count, self._publisher = 0, publisher

    def spin_once(self, timeout_sec=None):
        if self._publisher.get_subscription_count():
            self._publisher.publish(numbered(self.count))
            self.count += 1
        super().spin_once(timeout_sec)


@pytest.mark.long
def test_a_disk_that_is_full(source, tmp_path):
    """A file system of 300 kB, mounted for this process alone; without the right to mount, see the next test."""
    disk, out = tmp_path / "disk", tmp_path / "out"
    disk.mkdir()
    mount = f"mount -t tmpfs -o size=300k none {disk}"
    if subprocess.run(["unshare", "-rm", "sh", "-c", mount], capture_output=True).returncode:
        pytest.skip("mounting is not permitted here")
    script = (
        f'{mount} && {sys.executable} -c "{JOINT_ID}" record {disk}/bag; code=$?; cp -r {disk}/bag {out}; exit $code'
    )
    process = subprocess.Popen(
        ["unshare", "-rm", "sh", "-c", script], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    source.start(1)
    out_text, err = process.communicate(timeout=PATIENCE_S)
    assert (process.returncode, out_text) == (2, "")
    (line,) = err.splitlines()
    assert "recording ended (No space left on device): the bag is not closed, but" in line
    assert beginning(out) >= int(line.split("but ")[1].split()[0].replace(",", "")) > 0


def test_a_file_that_may_not_grow(source, tmp_path):
    """A quota, here of the process: the system refuses to write as on a full disk."""
    bag = tmp_path / "bag"
    limit = (250_000, resource.RLIM_INFINITY)
    process = start("record", bag, preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, limit))
    source.start(1)
    _, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 2
    (line,) = err.splitlines()
    assert "recording ended (File too large): the bag is not closed, but" in line
    assert beginning(bag) >= int(line.split("but ")[1].split()[0].replace(",", "")) > 0
