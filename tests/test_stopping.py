"""Every node ends cleanly on SIGINT and SIGTERM, in the middle of its work as well."""

import signal
import socket

import numpy as np
import pytest
from node_process import Program

from joint_id_core.data.recording import Recording
from joint_id_core.formats import write_bag

NODES = ("sim", "filter", "identifier", "player", "driver", "identify", "emulated_motion")
QUICK = ("filter", "identifier", "player", "driver")


@pytest.fixture
def kind():
    return Program


@pytest.fixture
def parameters(tmp_path, request, robot):
    """What each node needs to start."""
    t = 1.0 + np.arange(5000) * 0.002
    write_bag(tmp_path / "bag", {"joint": Recording(t, {"link_position": np.sin(t)})})
    given = {"player": {"bag": tmp_path / "bag", "wait_s": 0.0}, "emulated_motion": {"socket": tmp_path / "robot"}}
    if request.node.callspec.params["name"] == "driver":
        given["driver"] = {"robot_ip": "127.0.0.1", "port": robot("--moving", "none").port}
    return given


@pytest.mark.parametrize(
    ("name", "number"),
    [  # both signals of one node take the same way
        pytest.param(name, number, marks=pytest.mark.long if (j + k) % 2 or name not in QUICK else ())
        for j, name in enumerate(NODES)
        for k, number in enumerate((signal.SIGINT, signal.SIGTERM))
    ],
)
def test_a_signal_ends_the_node_with_exit_code_0(start, probe, parameters, name, number):
    process = start(name, **parameters.get(name, {}))
    probe.until(lambda: probe.told(name, ""), "the node's diagnostics")
    process.signal(number)
    assert process.wait() == 0
    assert "Traceback" not in process.text
    assert "rror" not in process.text


@pytest.mark.parametrize("number", [signal.SIGTERM, pytest.param(signal.SIGINT, marks=pytest.mark.long)])
def test_a_signal_ends_a_driver_that_waits_for_the_answer_of_a_mute_host(start, probe, number):
    with socket.create_server(("127.0.0.1", 0)) as host:
        # No try ends by itself before the signal comes.
        process = start("driver", robot_ip="127.0.0.1", port=host.getsockname()[1], timeout=10.0)
        probe.until(lambda: probe.told("driver", "not configured yet"), "the node's diagnostics")
        process.signal(number)
        assert process.wait() == 0
    assert "Traceback" not in process.text
    assert "not configured: " not in process.text


@pytest.mark.parametrize("number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.long)])
def test_a_signal_during_start_leaves_no_traceback(start, probe, number):
    process = start("filter")
    # before that it is the interpreter that starts, and says in its own way that it was interrupted
    probe.until(lambda: process.loaded("numpy") or process.loaded("rclpy"), "the imports of the node")
    process.signal(number)
    process.wait()
    assert "Traceback" not in process.text


def test_many_signals_end_the_node_as_one_does(start, probe):
    # The handler of one can be interrupted by the next.
    process = start("filter")
    probe.until(lambda: probe.told("filter", ""), "the node's diagnostics")
    for _ in range(2000):
        for number in (signal.SIGTERM, signal.SIGINT):
            if process.running:
                process.signal(number)
    # The interpreter gives the signals back to the system in its last moment.
    assert process.wait() in (0, -signal.SIGTERM, -signal.SIGINT)
    assert "Traceback" not in process.text
