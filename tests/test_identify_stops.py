"""The action `identify` that is stopped: by a cancel, a full disk, a robot that is gone, a signal."""

from __future__ import annotations

import resource
import signal
from pathlib import Path

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from identify_bench import Bench, aborted, positions_in, travel

from joint_id_msgs.action import Identify


@pytest.fixture
def bench(start, probe, robot, tmp_path):
    return Bench(start, probe, robot, tmp_path)


@pytest.mark.parametrize("times", [1, pytest.param(3, marks=pytest.mark.long)])
def test_a_cancel_stops_the_motion_and_leaves_a_readable_bag(bench, times):
    for _ in range(times):  # the node lives on
        bench.orders.clear()
        handle = bench.send()
        bench.go()
        bench.moves()
        assert [bool(order.points) for order in bench.orders] == [True]
        before = len(bench.links)
        cancel = handle.cancel_goal_async()
        bench.probe.until(lambda: len(bench.orders) > 1, "the stop")
        bench.probe.until(cancel.done, "an answer to the cancel")
        assert not bench.orders[1].points
        status, result = bench.result(handle)
        assert (status, result.message, result.joints) == (GoalStatus.STATUS_CANCELED, "cancelled", [])
        bench.machine.wait_for("stop: the joints come to rest", len(bench.machine.lines) - 1)
        positions = [m.position[2] for m in bench.links[before:]]
        rest = positions[-1]
        bench.probe.spin(1.0)
        assert abs(bench.links[-1].position[2] - rest) < 1e-3
        assert (Path(result.bag) / "metadata.yaml").exists()
        recorded = positions_in(result.bag)
        assert np.ptp(recorded) > 0.015
        assert recorded[-1] == pytest.approx(rest, abs=2e-3), "the braking is in the recording"
    # Before the go, and while nothing moves, a cancel ends the goal without a recording.
    handle = bench.send()
    bench.phase(Identify.Feedback.WAITING_FOR_GO)
    handle.cancel_goal_async()
    status, result = bench.result(handle)
    assert (status, result.bag, result.page) == (GoalStatus.STATUS_CANCELED, "", "")


@pytest.mark.long
def test_a_full_disk_and_a_robot_that_is_killed_end_the_goal_and_lose_nothing(bench):
    unlimited = resource.prlimit(bench.identify.pid, resource.RLIMIT_FSIZE, (1_000_000, resource.RLIM_INFINITY))
    handle = bench.send()
    bench.go()
    status, result = bench.result(handle)
    assert status == GoalStatus.STATUS_ABORTED
    assert "recording ended (File too large)" in result.message
    bench.probe.until(lambda: not bench.orders[-1].points, "the stop")
    assert len(positions_in(result.bag)) > 100
    resource.prlimit(bench.identify.pid, resource.RLIMIT_FSIZE, unlimited)
    # The next goal is as good as the first one, until the robot is killed.
    handle = bench.send()
    bench.go()
    bench.moves()
    bench.machine.process.kill()
    status, result = bench.result(handle)
    assert status == GoalStatus.STATUS_ABORTED
    assert "no samples on link_states for 8 s: is the driver running" in result.message
    bench.probe.until(lambda: not bench.orders[-1].points, "a stop, whoever hears it")
    assert travel(result.bag) > 0.015
    aborted(bench, "no positions on link_states: is the driver running?")
    assert bench.identify.running and bench.mover.running
    bench.mover.signal(signal.SIGTERM)
    assert bench.mover.wait() == 0


@pytest.mark.long
def test_a_node_that_is_stopped_in_motion_stops_the_robot_and_closes_the_bag(bench):
    handle = bench.send()
    bench.go()
    bench.moves()
    bench.identify.signal(signal.SIGTERM)
    bench.probe.until(lambda: not bench.orders[-1].points, "the stop")
    assert bench.identify.wait() == 0
    (bag,) = bench.results.glob("identify_*/")
    assert (bag / "metadata.yaml").exists() and travel(bag) > 0.015
    assert handle.accepted
