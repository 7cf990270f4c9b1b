"""`make demo` ends with everything that it started, whatever ends it."""

import signal
import time
from pathlib import Path

import pytest
from conftest import DEMO_S


def children(pid):
    """Process ids of the children of a process."""
    return [int(child) for task in Path(f"/proc/{pid}/task").glob("*/children") for child in task.read_text().split()]


def at_work(demo):
    """A demo with its nodes, by process id."""
    process = demo("--duration", "600")
    end = time.monotonic() + DEMO_S
    while len(nodes := children(process.pid)) < 4:
        assert process.poll() is None, process.communicate()[0]
        assert time.monotonic() < end
        time.sleep(0.05)
    return process, nodes


@pytest.mark.parametrize("number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.long)])
def test_a_signal_ends_every_node(demo, number):
    process, nodes = at_work(demo)
    process.send_signal(number)
    text, _ = process.communicate(timeout=DEMO_S)
    assert process.returncode == 130, text
    assert "stopped" in text
    assert not [pid for pid in nodes if Path(f"/proc/{pid}").exists()]


@pytest.mark.long
def test_nodes_end_even_when_the_demo_is_killed(demo):
    process, nodes = at_work(demo)
    process.kill()
    end = time.monotonic() + DEMO_S
    while left := [pid for pid in nodes if running(pid)]:
        assert time.monotonic() < end, left
        time.sleep(0.05)


def running(pid):
    """Whether a process is there and not a zombie whose parent has not asked for it yet."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_too_short_a_demo_is_refused(demo):
    process = demo("--duration", "1")
    text, _ = process.communicate(timeout=DEMO_S)
    assert process.returncode == 2
    assert "--duration 1: give 6 s to 3600 s" in text
