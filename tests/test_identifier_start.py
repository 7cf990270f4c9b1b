"""Node `identifier` at its start: kernels are there before the node is active, and a start can be broken off."""

import signal
import time

import pytest
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from robot_messages import NANO, stamp
from running_graph import RATE, WINDOW_S, Motion, instant

from joint_id_msgs.msg import JointParams, JointSamples
from joint_id_ros.qos import LATEST

COMPILING = "compiling model rigid_joint (only the first start of a model does that; others load it)"
OPTIONS = {"model": "rigid_joint", "actuation": "torque"}


@pytest.fixture
def cold(monkeypatch, tmp_path):
    """An empty cache of kernels, for the processes that start from now on."""
    monkeypatch.setenv("JOINT_ID_CACHE_DIR", str(tmp_path / "cache"))
    return tmp_path / "cache"


def kernels(cache):
    """Compiled files with the time of their last change."""
    return {path: path.stat().st_mtime_ns for path in cache.rglob("*.nbi")}


def test_kernels_are_compiled_before_the_node_is_active_and_no_fit_compiles(cold, start, probe):
    found = probe.collect(JointParams, "joint_params", LATEST)
    process = start("identifier", **OPTIONS)
    probe.until(lambda: probe.told("identifier", COMPILING), "word of the compilation")
    assert probe.told("identifier", COMPILING).level == b"\x01"
    samples = probe.source(JointSamples, "joint_samples")  # there as soon as the node is active
    compiled = kernels(cold)
    assert compiled
    motion = Motion()
    for k in range(round((WINDOW_S + 1.3) * RATE)):
        q, tau = motion.at(k)
        message = JointSamples(name=["joint"], link_position=[q], torque=[tau])
        message.measured = JointSamples.LINK_POSITION | JointSamples.TORQUE
        message.header.stamp = stamp(100 * NANO + k * NANO // RATE)
        samples.publish(message)
        if k % 25 == 24:  # slower than the fits, so that no hop is missed
            before = time.monotonic()
            ends = 1 + max(0, (k * 2 - round(WINDOW_S * 1000)) // 500)
            due = k >= WINDOW_S * RATE - 1
            probe.until(lambda n=ends, due=due: not due or len(found) >= n, f"an estimate, after {before}")
    ends = [instant(m.joints[0].window_end) / NANO - 100.0 for m in found]
    assert ends[0] == pytest.approx(WINDOW_S, abs=0.06)  # a window after the first sample
    assert [b - a for a, b in zip(ends, ends[1:], strict=False)] == pytest.approx([0.5] * (len(ends) - 1), abs=0.06)
    assert len(ends) >= 3
    assert kernels(cold) == compiled
    assert "compiling" not in process.text.split("identifying rigid_joint")[1]


def test_a_second_start_says_that_it_loads(start, probe):
    process = start("identifier", **OPTIONS)
    probe.until(lambda: "identifying rigid_joint" in process.text, "an active node")
    process.stop()
    again = start("identifier", **OPTIONS)
    probe.until(lambda: "identifying rigid_joint" in again.text, "an active node")
    assert "loading the kernels of model rigid_joint" in again.text and "compiling" not in again.text


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("managed", [False, True])
def test_a_signal_ends_the_node_while_it_compiles(cold, start, probe, number, managed):
    process = start("identifier", model="electromechanical", autostart=not managed)
    if managed:
        service = probe.create_client(ChangeState, "/identifier/change_state")
        probe.until(service.service_is_ready, "the node")
        probe.spin(0.5)
        service.call_async(ChangeState.Request(transition=Transition(label="configure")))
    probe.until(lambda: probe.told("identifier", "compiling") if not managed else "compiling" in process.text, "it")
    begun = time.monotonic()
    process.signal(number)
    assert process.wait() == 0
    assert "identifying" not in process.text
    assert time.monotonic() - begun < 60.0  # it does not wait for the compilation of every kernel


def test_a_cache_that_cannot_be_written_is_told(start, probe, monkeypatch, tmp_path):
    (tmp_path / "file").write_text("no folder")
    monkeypatch.setenv("JOINT_ID_CACHE_DIR", str(tmp_path / "file" / "cache"))
    start("identifier", **OPTIONS)
    probe.until(
        lambda: probe.told("identifier", "set JOINT_ID_CACHE_DIR to a folder that can be written"), "the reason"
    )
