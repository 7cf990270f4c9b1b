"""Every node ends cleanly on SIGINT and SIGTERM, in the middle of its work as well."""

import signal

import numpy as np
import pytest

from joint_id_core.formats import write_bag
from joint_id_core.recording import Recording

NODES = ("sim", "filter", "identifier", "player")


@pytest.fixture
def parameters(tmp_path):
    """What each node needs to start."""
    t = 1.0 + np.arange(5000) * 0.002
    write_bag(tmp_path / "bag", {"joint": Recording(t, {"link_position": np.sin(t)})})
    return {"player": {"bag": tmp_path / "bag", "wait_s": 0.0}}


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("name", NODES)
def test_a_signal_ends_the_node_with_exit_code_0(start, probe, parameters, name, number):
    process = start(name, **parameters.get(name, {}))
    probe.until(lambda: probe.told(name, ""), "the node's diagnostics")
    process.signal(number)
    assert process.wait() == 0
    assert "Traceback" not in process.text
    assert "rror" not in process.text


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_during_start_leaves_no_traceback(start, probe, number):
    process = start("filter")
    process.signal(number)
    process.wait()
    assert "Traceback" not in process.text
