"""`make demo`: estimates with their uncertainty appear beside the truth, a picture is made, nothing is left running."""

import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from matplotlib.image import imread

ROOT = Path(__file__).resolve().parent.parent
PATIENCE_S = 300.0  # a limit for a demo that hangs, not a measure of speed
ROW = re.compile(r"^  (\w+) +(\S.*?) +(\S+) ± (\S+) +(\S+) +([+-]\S+) σ   (\w[\w ]*)$", re.MULTILINE)


@pytest.fixture
def demo(tmp_path):
    """Start the demo with everything that it writes in a temporary folder; ended at the latest with the test."""
    started = []

    def begin(*arguments):
        command = [sys.executable, ROOT / "demo/demo.py", "--out", tmp_path / "out", "--picture", tmp_path / "demo.png"]
        pipe = subprocess.PIPE
        started.append(subprocess.Popen([*command, *arguments], stdout=pipe, stderr=subprocess.STDOUT, text=True))
        return started[-1]

    yield begin
    for process in started:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
            process.communicate(timeout=PATIENCE_S)


def children(pid):
    """Process ids of the children of a process."""
    return [int(child) for task in Path(f"/proc/{pid}/task").glob("*/children") for child in task.read_text().split()]


def test_every_act_shows_estimates_beside_the_truth_and_the_picture_is_made(demo, tmp_path):
    process = demo("--duration", "6")
    text, _ = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0, text
    acts = re.split(r"^Act \d, ", text, flags=re.MULTILINE)[1:]
    assert re.findall(r"^Act (\d), ", text, re.MULTILINE) == ["1", "2", "3", "4", "5"]
    found = {"R", "k_b", "k_t", "c_m", "tau_fm", "c_1", "k_1"}
    robot = {"J_m", "tau_fm", "c_1", "k_1", "k_2", "J_q", "c_q", "tau_fq"}
    # The robot sticks and slips exactly, which the smoothed friction of the fit follows to some percent only.
    for act, names, share in zip(acts, (found, robot, robot, found), (0.01, 0.01, 0.03, 0.01), strict=False):
        rows = {row[0]: row for row in ROW.findall(act)}  # the last table of the act
        assert names <= set(rows)
        for name, unit, value, std_dev, truth, sigma, verdict in rows.values():
            assert unit and verdict == "estimated"
            error, std = float(value) - float(truth), float(std_dev)
            assert std > 0.0
            # What is shown fits together; the shown truth has four digits.
            assert abs(error / std - float(sigma)) < 0.2 + 1e-3 * float(truth) / std, name
            assert abs(error) < max(5.0 * std, share * float(truth)), (name, value, std_dev, truth)
    # The load was followed within two windows of 2 s, and its inertia was named, and nothing else. Estimates are
    # counted, half a second of motion each, because a busy computer publishes fewer of them.
    assert re.search(r"J_q changed after \S+ s of motion; \S+ s later the estimate was within 1%", acts[1]), acts[1]
    found_out = re.findall(r"load: \S+ s of motion, estimate \d+, ([\w ]+),", acts[1])
    assert len(found_out) > 9 and sum(status != "converged" for status in found_out) <= 8, acts[1]
    assert re.search(r"The identifier says: Changed: J_q from 0\.7\d+ ± \S+ to 1\.5\d+ ± \S+$", acts[1], re.MULTILINE)
    # The connection was cut once, and all six joints were identified, or called what they are. A computer that stands
    # still for seconds may cut it again and lose samples; test_driver*.py test that a driver with time does neither.
    assert re.search(r"the driver says: .*, lost \d+, reconnects [1-9];", acts[2])
    assert len(re.findall(r"^  \w+_joint +(?:converged|poor fit) ", acts[2], re.MULTILINE)) == 6
    picture = imread(tmp_path / "demo.png")
    assert picture.shape[0] > 500 and picture.shape[1] > 1000
    assert picture.std() > 0.05  # something is drawn on it
    assert (tmp_path / "out/recording/metadata.yaml").is_file()
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["logs", "recording"]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_every_node(demo, number):
    process = demo("--duration", "600")
    end = time.monotonic() + PATIENCE_S
    while len(nodes := children(process.pid)) < 4:
        assert process.poll() is None, process.communicate()[0]
        assert time.monotonic() < end
        time.sleep(0.05)
    process.send_signal(number)
    text, _ = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 130, text
    assert "stopped" in text
    assert not [pid for pid in nodes if Path(f"/proc/{pid}").exists()]


def test_nodes_end_even_when_the_demo_is_killed(demo):
    process = demo("--duration", "600")
    end = time.monotonic() + PATIENCE_S
    while len(nodes := children(process.pid)) < 4:
        assert process.poll() is None, process.communicate()[0]
        assert time.monotonic() < end
        time.sleep(0.05)
    process.kill()
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
    text, _ = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 2
    assert "--duration 1: give 6 s to 3600 s" in text
