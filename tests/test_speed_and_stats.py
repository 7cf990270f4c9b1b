"""The benchmarks of speed and of statistics: what they are made of, and the scripts run."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from engine.kernel import CASES
from engine.timing import Times, in_turn
from engine.yardstick import Yardstick, at_steps
from montecarlo.cases import CASES as NOISE
from montecarlo.draws import Draw, recorded
from montecarlo.methods import deviations
from montecarlo.tables import block, methods_table, summary, table
from peers.model2 import SMOOTHING, Data
from simulated import MODEL_2, RATE, SENSORS, ClosedLoop, Torque, motion, start

from joint_id_core.cell.kernel import compile_model
from joint_id_core.cell.rollout import rollout, rollout_sensitivities
from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.models import build
from joint_id_core.simulation.excitation import position_reference
from joint_id_core.simulation.position_control import PositionController, simulate_closed_loop

pytestmark = pytest.mark.long

ROOT = Path(__file__).resolve().parent.parent
BY_NAME = {case.name: case for case in NOISE}


def script(name: str, *arguments: str) -> str:
    """What a benchmark prints."""
    done = subprocess.run(
        [sys.executable, str(ROOT / "benchmarks" / name), *arguments], capture_output=True, text=True, timeout=300.0
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def cache(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("motions")


@pytest.fixture(scope="module")
def yardstick() -> Yardstick:
    return Yardstick()


def test_the_yardstick_refuses_what_it_does_not_compute(yardstick):
    x0, u = np.zeros(4), np.zeros(10)
    with pytest.raises(JointIdError, match="has no RigidJoint"):
        yardstick.rollout(build("rigid_joint"), x0, u, {}, 2e-3, 1)
    with pytest.raises(JointIdError, match=r"has no HarmonicDrive\(.*gravity=True"):
        yardstick.rollout(build("harmonic_drive", gravity=True), x0, u, {}, 2e-3, 1)
    with pytest.raises(JointIdError, match=r"N = 50.0: .* has 101.0"):
        yardstick.rollout(MODEL_2, x0, u, MODEL_2.values({"N": 50.0}), 2e-3, 1)


def test_calls_take_turns_and_steps_are_interpolated():
    order: list[str] = []
    times = in_turn({"a": lambda: order.append("a"), "b": lambda: order.append("b")}, 3)
    assert "".join(order) == "abababab"
    assert all(t.wall_s > 0.0 for t in times.values())
    between = at_steps({"kernel below": Times(1.0, 2.0), "kernel above": Times(2.0, 4.0)}, 3.25)
    assert (between.wall_s, between.cpu_s) == (1.25, 2.5)


def test_motions_are_those_of_the_library_and_come_from_the_cache(cache):
    what = ClosedLoop(60, Torque(white=0.02))
    found = motion(what, 7, cache)
    same = simulate_closed_loop(
        MODEL_2, PositionController(), position_reference(), np.arange(60) / RATE, torque_noise=0.02, seed=7
    )
    for name, values in found.channels.items():
        np.testing.assert_array_equal(values, same[name])
    (file,) = cache.glob("*-7.npz")
    begun = file.stat().st_mtime_ns
    again = motion(what, 7, cache)
    assert file.stat().st_mtime_ns == begun
    np.testing.assert_array_equal(again["link_velocity"], found["link_velocity"])
    other = motion(ClosedLoop(60, Torque(white=0.02, ripple=0.01)), 7, cache)
    assert np.max(np.abs(other["link_position"] - found["link_position"])) > 0.0


def test_coloured_torque_is_what_it_says():
    noise = Torque(coloured=0.5).noise(40000, 3)
    assert np.std(noise) == pytest.approx(0.5, rel=0.1)
    # time constant of 20 ms: a tenth of that is one sample
    assert noise[1:] @ noise[:-1] / (noise @ noise) == pytest.approx(np.exp(-0.1), abs=0.02)


def test_starts_are_off_by_up_to_the_factor():
    values = np.array([list(start(MODEL_2, seed, 3.0).values()) for seed in range(50)])
    off = np.abs(np.log(values / [MODEL_2.values()[name] for name in start(MODEL_2, 0, 3.0)]))
    assert np.log(2.5) < off.max() <= np.log(3.0)


def test_cases_measure_what_they_say(cache):
    for case in NOISE:
        assert set(recorded(case, 1000, cache).channels) == {*case.labels, *case.motion.inputs}, case.name
    rounded = recorded(BY_NAME["encoders that round"], 1000, cache)["link_position"]
    steps = rounded / (2.0 * np.pi / 2**19)
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)
    law = BY_NAME["Stribeck friction, 10%"].motion
    assert isinstance(law, ClosedLoop)
    assert law.values == pytest.approx({"dtau_sm": 0.1 * 2.291e-2, "dtau_sq": 0.1 * 2.296})
    assert len(BY_NAME) == len(NOISE)


def test_the_summary_counts_and_averages():
    """Errors of two parameters in sigmas: draws within noise, one far off, one that gave up, one without a result."""
    sigmas = {"a": 0.01, "b": 0.1}

    def draw(status: str, a: float, b: float) -> Draw:
        return Draw(0, status, status == "poor_fit", b == 9.0, 0.02, {"a": 0.01 * a, "b": 0.1 * b}, sigmas)

    draws = [draw("converged", 1.0, -3.0), draw("converged", 1.0, 1.0), draw("converged", 0.0, 9.0)]
    draws += [draw("poor_fit", 5.0, 0.5), Draw(0, "diverged", False, False, 0.02, {}, {})]
    found = summary(draws)
    assert (found.draws, found.converged, found.far, found.coloured, found.misfit) == (5, 3, 1, 1, 1)
    np.testing.assert_allclose(found.ratio, [1.0, np.sqrt(5.0)])
    np.testing.assert_allclose(found.bias, [1.0, -1.0])
    np.testing.assert_allclose(found.error, [0.01, 0.1 * np.sqrt(5.0)])
    np.testing.assert_allclose(found.sigma, [0.01, 0.1])
    np.testing.assert_allclose(found.coverage, [1.0, 1.0 / 3.0])
    np.testing.assert_allclose(found.coverage_all, [3.0 / 4.0, 2.0 / 4.0])
    assert "3 of 5 converged, 1 of them far off, 1 not white, 1 with a misfit" in block("x", found)
    (_, row) = table({"x": found}).splitlines()
    assert row.split()[:6] == ["x", "5", "3", "1", "1", "1"]
    (_, row) = methods_table({"x": draws}).splitlines()
    assert row.split()[:3] == ["x", "5", "3"]
    nothing = summary(draws[-1:])
    assert (nothing.converged, nothing.names) == (0, ())
    assert "1" in table({"nothing": nothing})


def test_deviations_of_nlgr_are_those_of_the_simulation_error():
    """Beside the exact sensitivities of our cell with the friction of the peers, the noise being as large as told."""
    time = np.arange(150) / RATE
    u = np.column_stack([0.3 * np.cos(40.0 * time) - 0.6, np.zeros(len(time))])
    p = np.array([MODEL_2.values(SMOOTHING)[name] for name in MODEL_2.parameter_names])
    x0, sigma = np.array([3.0, 0.0297, 40.0, 0.39]), np.array([SENSORS.noise[name] for name in MODEL_2.state_names])
    kernel = compile_model(MODEL_2)
    x, by_p = rollout_sensitivities(kernel, x0, time, u, p, 32)
    moved = [rollout(kernel, x0 + s * np.eye(4)[k], time, u, p, 32) for k, s in enumerate(sigma)]
    by_log = by_p * [MODEL_2.values()[name] for name in kernel.sensitive]
    J = np.concatenate([by_log, np.stack(moved, axis=2) - x[:, :, None]], axis=2) / sigma[:, None]
    J = J.reshape(-1, J.shape[2])
    expected = dict(zip(kernel.sensitive, np.sqrt(np.diag(np.linalg.inv(J.T @ J))), strict=False))
    channels = dict(zip(MODEL_2.state_names + MODEL_2.input_names, np.hstack([x, u]).T, strict=True))
    data = Data(SENSORS.measure(Recording(time, channels), 1), sigma, 0.0)
    assert deviations(data, MODEL_2.values()) == pytest.approx(expected, rel=0.1)
    # they come from the residuals, so that a wrong level of the noise changes nothing
    assert deviations(replace(data, sigma=2.0 * sigma), MODEL_2.values()) == pytest.approx(expected, rel=0.1)


def test_the_scripts_run(tmp_path, cache):
    file = tmp_path / "speed.json"
    text = script(
        "speed.py", "--sections", "kernel", "shares", "windows", "--rounds", "1", "--cache", str(cache),
        "--json", str(file),
    )  # fmt: skip
    assert text.count("Model 3") == 2
    report = json.loads(file.read_text())
    assert [row["case"] for row in report["kernel"]] == [case.name for case in CASES]
    assert sum(report["shares"].values()) == pytest.approx(1.0)
    assert len(report["windows"]) == 2 * 30 and {row["status"] for row in report["windows"]} == {"converged"}
    file = tmp_path / "stats.json"
    script(
        "stats.py", "--sections", "cases", "--draws", "1", "--workers", "1", "--cache", str(cache), "--json", str(file)
    )
    draws = json.loads(file.read_text())["cases"]
    assert list(draws) == [case.name for case in NOISE]
    assert all(len(rows) == 1 and rows[0]["seed"] == 1000 for rows in draws.values())
    assert os.path.getsize(file) > 1000
