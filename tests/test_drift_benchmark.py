"""The study of the drift monitor: its chart counts what the monitor reports, and the script writes its page."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from run_length import chart, joint

from joint_id_core.online.drift import DriftMonitor, DriftOptions
from joint_id_core.results.estimate import Estimate, ParameterEstimate, Status, Verdict

pytestmark = pytest.mark.long

ROOT = Path(__file__).resolve().parent.parent
SIGMA = 0.01


def estimate(end: float, error: float) -> Estimate:
    row = ParameterEstimate("J", "kg m^2", 1.0 + SIGMA * error, SIGMA, Verdict.ESTIMATED)
    return Estimate("rigid_joint", "innovations", Status.CONVERGED, "", (row,), ("J",), end=end)


@pytest.mark.parametrize(
    ("threshold", "tolerance", "shift", "confirm_s"),
    [(2.0, 0.0, 0.0, 0.0), (1.5, 2.0, 2.0, 0.0), (1.0, 0.0, 0.0, 20.0)],
)
def test_the_chart_counts_what_the_monitor_reports(threshold, tolerance, shift, confirm_s):
    joints, hours, count = 60, 0.5, 0
    rng = np.random.default_rng(4)
    options = DriftOptions(SIGMA * tolerance, threshold, confirm_s)
    for _ in range(joints):
        error, told = rng.standard_normal(), False
        monitor = DriftMonitor(estimate(0.0, error), options)
        for k in range(1, round(hours * chart.HOUR / chart.HOP_S)):
            error = chart.KEPT * error + math.sqrt(1.0 - chart.KEPT**2) * rng.standard_normal()
            now = bool(monitor.update(estimate(k * chart.HOP_S, shift + error)))
            count, told = count + (now and not told), now
    (expected,) = chart.false_alarms(np.array([threshold]), tolerance, shift, 4000, hours, confirm_s, 1)
    assert count > 40
    assert count / (joints * hours) == pytest.approx(expected.count / expected.hours, rel=0.4)


def test_a_slow_change_grows_and_stays():
    course = joint.Course(("k_1",), 0.2, at_s=10.0, rise_s=100.0)
    assert course.values(9.9) == {}
    assert course.values(60.0)["k_1"] == pytest.approx(1.1 * joint.TRUTH["k_1"])
    assert course.values(500.0)["k_1"] == pytest.approx(1.2 * joint.TRUTH["k_1"])


def test_the_script_writes_its_block_of_a_page(tmp_path):
    page, file = tmp_path / "page.md", tmp_path / "drift.json"
    page.write_text((ROOT / "docs/reliability.md").read_text())
    command = [sys.executable, str(ROOT / "benchmarks/drift.py"), "--hours", "100", "--runs", "1", "--length", "65"]
    command += ["--longest", "32", "--json", str(file), "--write", str(page)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600.0)
    assert done.returncode == 0, done.stderr
    before, after = (ROOT / "docs/reliability.md").read_text(), page.read_text()
    marks = ("<!-- made by: make bench-drift -->", "<!-- end of bench-drift -->")
    for mark, side in zip(marks, (0, 2), strict=True):
        assert before.partition(mark)[side] == after.partition(mark)[side]
    assert after.count("| 5 (default) | 30 s |") == 1
    delays = json.loads(file.read_text())["changed"]
    assert len(delays) == 8 and all(len(runs) == 1 for runs in delays.values())
