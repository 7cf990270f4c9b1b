"""Node `identifier` at its start: kernels are there before the node is active, and a start can be broken off."""

import signal

import numpy as np
import pytest
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from node_process import Program
from robot_messages import NANO, stamp
from running_graph import RATE, WINDOW_S, Motion, instant

from joint_id_msgs.msg import JointParams, JointSamples
from joint_id_ros.qos import LATEST

HOP_S = 0.5  # the default
BEGIN_S = 100  # stamp of the first sample
COMPILING = "compiling model rigid_joint (only the first start of a model does that; others load it)"
OPTIONS = {"model": "rigid_joint", "actuation": "torque"}


@pytest.fixture
def kind():
    """Nothing is loaded before it starts."""
    return Program


@pytest.fixture
def cold(monkeypatch, tmp_path):
    """An empty cache of kernels, for the processes that start from now on."""
    monkeypatch.setenv("JOINT_ID_CACHE_DIR", str(tmp_path / "cache"))
    return tmp_path / "cache"


def kernels(cache):
    """Compiled files with the time of their last change."""
    return {path: path.stat().st_mtime_ns for path in cache.rglob("*.nbi")}


@pytest.mark.long
def test_kernels_are_compiled_once_and_before_the_node_is_active(cold, start, probe):
    found = probe.collect(JointParams, "joint_params", LATEST)
    process = start("identifier", **OPTIONS)
    probe.until(lambda: probe.told("identifier", COMPILING), "word of the compilation")
    assert probe.told("identifier", COMPILING).level == b"\x01"
    samples = probe.source(JointSamples, "joint_samples")  # there as soon as the node is active
    compiled = kernels(cold)
    assert compiled
    motion, k = Motion(), 0

    def estimates():
        return [joint for m in found for joint in m.joints]  # none where a loaded computer left it without samples

    def up_to(estimate):
        return instant(estimate.window_end) / NANO - BEGIN_S

    def send(seconds):
        nonlocal k
        for _ in range(round(seconds * RATE)):
            q, tau = motion.at(k)
            message = JointSamples(name=["joint"], link_position=[q], torque=[tau])
            message.measured = JointSamples.LINK_POSITION | JointSamples.TORQUE
            message.header.stamp = stamp(BEGIN_S * NANO + k * NANO // RATE)
            samples.publish(message)
            k += 1
        probe.spin(0.5)

    send(WINDOW_S)
    while not estimates() and k < 3.0 * WINDOW_S * RATE:  # the first samples may be lost: the reader knows us later
        send(HOP_S)
    probe.until(lambda: estimates() and up_to(estimates()[-1]) > k / RATE - 1.2 * HOP_S, "that it has taken them all")
    first = len(estimates())
    for count in (1, 2, 3):
        send(HOP_S)
        probe.until(lambda count=count: len(estimates()) >= first + count, f"{count} more estimates")
    found_in = estimates()
    # One window after the first sample, then every hop; a batch of samples may end a little later.
    window_ns = instant(found_in[0].window_end) - instant(found_in[0].window_start)
    assert window_ns / NANO == pytest.approx(WINDOW_S, abs=0.06)
    assert np.diff([up_to(e) for e in found_in[first - 1 :]]) == pytest.approx(HOP_S, abs=0.06)
    assert kernels(cold) == compiled
    assert "compiling" not in process.text.split("identifying rigid_joint")[1]
    process.stop()
    again = start("identifier", **OPTIONS)
    probe.until(lambda: "identifying rigid_joint" in again.text, "an active node")
    assert "loading the kernels of model rigid_joint" in again.text and "compiling" not in again.text


@pytest.mark.parametrize(
    ("managed", "number"), [(False, signal.SIGTERM), pytest.param(True, signal.SIGINT, marks=pytest.mark.long)]
)
def test_a_signal_ends_the_node_while_it_compiles(cold, start, probe, number, managed):
    process = start("identifier", model="electromechanical", autostart=not managed)
    if managed:
        request = ChangeState.Request(transition=Transition(label="configure"))
        probe.ask_until(ChangeState, "/identifier/change_state", request, lambda: "compiling" in process.text)
    else:
        probe.until(lambda: probe.told("identifier", "compiling"), "word of the compilation")
    process.signal(number)
    assert process.wait() == 0
    assert "identifying" not in process.text


@pytest.fixture
def no_cache(monkeypatch, tmp_path):
    """A cache that cannot be written, for the processes that start from now on."""
    (tmp_path / "file").write_text("no folder")
    monkeypatch.setenv("JOINT_ID_CACHE_DIR", str(tmp_path / "file" / "cache"))


def test_a_cache_that_cannot_be_written_is_told(no_cache, start, probe):
    start("identifier", **OPTIONS)
    text = "set JOINT_ID_CACHE_DIR to a folder that can be written"
    probe.until(lambda: probe.told("identifier", text), "the reason")
    assert probe.told("identifier", text).level == b"\x02"
