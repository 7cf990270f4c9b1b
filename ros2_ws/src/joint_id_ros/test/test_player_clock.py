"""The player tells the time of the bag every 10 ms of real time, however many messages come in between."""

import numpy as np
import pytest
import rclpy

from joint_id_core.data.recording import Recording
from joint_id_core.formats import write_bag
from joint_id_ros.nodes.player import CLOCK_S, PlayerNode


class Published:
    """Stands in for a publisher."""

    def __init__(self):
        self.messages = []

    def publish(self, message):
        self.messages.append(message)


@pytest.fixture
def player(tmp_path, domain):
    t = 100.0 + np.arange(50) * 0.002
    write_bag(tmp_path / "bag", {"joint": Recording(t, {"link_position": np.sin(t)})})
    rclpy.init(args=["--ros-args", "-p", f"bag:={tmp_path / 'bag'}"])
    node = PlayerNode()
    yield node
    node.close()
    node.destroy_node()
    rclpy.try_shutdown()


def test_time_is_told_at_once_then_every_10_ms_and_at_the_end(player):
    told = player._time_output = Published()
    for k in range(101):
        player._tell_time(1000.0 + 0.3 * k * CLOCK_S, k)
    assert [m.clock.nanosec for m in told.messages] == list(range(0, 101, 4))


def test_the_last_time_told_is_that_of_the_last_message(player):
    told = player._time_output = Published()
    player._begun = 0.0  # long ago: everything is due
    while not player._play(1e9):
        pass
    last = told.messages[-1].clock
    assert last.sec * 10**9 + last.nanosec == 100_098_000_000
