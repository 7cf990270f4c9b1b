"""Help of the nodes, and words that are no arguments of ROS: a node starts with neither."""

from __future__ import annotations

import signal
import sys

import pytest

from joint_id_ros import running
from joint_id_ros.own_arguments import beside_ros


@pytest.mark.parametrize(
    ("words", "beside"),
    [
        ([], []),
        (["--ros-args", "-p", "rate:=100.0", "--log-level", "info"], []),
        (["--ros-args", "-r", "a:=b", "--", "--help"], ["--help"]),
        (["-p", "rate:=100.0", "--ros-args", "-r", "a:=b"], ["-p", "rate:=100.0"]),
        (["--ros-args", "-r", "a:=b", "--ros-args", "-p", "c:=d"], []),
    ],
)
def test_what_is_beside_the_arguments_of_ros(words, beside):
    assert beside_ros(words) == beside


@pytest.fixture(autouse=True)
def handlers():
    """Put the handlers of signals back that a node installs."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize(("name", "about"), [("sim", "a simulated joint"), ("driver", "nothing here can move a robot")])
def test_help_is_printed_and_nothing_starts(monkeypatch, capsys, name, about):
    monkeypatch.setattr(sys, "argv", [name, "--help"])
    assert running.run(name) == 0
    out = capsys.readouterr().out
    assert out.startswith(f"usage: {name} [--ros-args -p PARAMETER:=VALUE") and about in out


def test_a_parameter_that_ros_would_overlook_is_refused(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["sim", "-p", "model:=harmonic_drive"])
    assert running.run("sim") == running.BAD_INPUT
    assert capsys.readouterr().err.startswith("sim: -p is no argument of this node: parameters follow --ros-args")
