"""The speed benchmark: its peers simulate our model, its table says what happened, and the script runs."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from peers.model2 import FREE, MODEL, SMOOTHING, SUBSTEPS, Data, Ops, parameters, rk4, unknowns, values
from peers.results import Run, table

from joint_id_core.cell.kernel import compile_model
from joint_id_core.cell.rollout import rollout
from joint_id_core.data.recording import Recording

pytestmark = pytest.mark.long

ROOT = Path(__file__).resolve().parent.parent
X0 = np.array([3.0, 0.0297, 40.0, 0.39])
SIGMA = np.array([1e-3, 1e-5, 0.1, 1e-3])


def run(folder: Path, *arguments: str, path: str = "") -> tuple[str, list[dict]]:
    """What the script prints, and the runs in its file."""
    command = [sys.executable, str(ROOT / "benchmarks/speed_peers.py"), "--json", str(folder / "runs.json"), *arguments]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, [path, os.environ.get("PYTHONPATH", "")]))}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=180.0)
    assert done.returncode == 0, done.stderr
    return done.stdout, json.loads((folder / "runs.json").read_text())["runs"]


def simulate(substeps: int) -> Data:
    """Forty samples of our own RK4 cell, through a reversal of the motor, as if they were measured."""
    time = np.arange(40) / 500
    u = np.column_stack([0.3 * np.cos(40.0 * time) - 0.6, np.zeros(40)])
    p = np.array([MODEL.values(SMOOTHING)[name] for name in MODEL.parameter_names])
    x = rollout(compile_model(MODEL, "tanh"), X0, time, u, p, substeps)
    assert np.ptp(np.sign(x[:, 2])) == 2.0
    channels = dict(zip(MODEL.state_names + MODEL.input_names, np.hstack([x, u]).T, strict=True))
    return Data(Recording(time, channels), SIGMA, 0.0)


@pytest.fixture(scope="module")
def simulated() -> Data:
    """With the steps that the peers take."""
    return simulate(SUBSTEPS)


def test_the_cell_of_the_peers_is_ours(simulated):
    p, ops = parameters([MODEL.values()[name] for name in FREE]), Ops(np)
    x = X0
    for k, dt in enumerate(np.diff(simulated.recording.time)):
        u = tuple(simulated.u[k])
        for _ in range(SUBSTEPS):
            x = rk4(lambda x, u=u: np.array(MODEL.derivative(tuple(x), u, p, ops)), x, dt / SUBSTEPS)
        np.testing.assert_allclose(x, simulated.y[k + 1], rtol=1e-9, atol=1e-9)


def test_scipy_simulates_our_model(monkeypatch):
    """Its own integration, here a fine one, beside fine steps of ours."""
    from peers import scipy_least_squares

    monkeypatch.setattr(scipy_least_squares, "LOCAL_ERROR", 1e-8)
    simulation = scipy_least_squares._Simulation(simulate(64), unknowns(MODEL.values()), np.inf)
    assert np.max(np.abs(simulation.residuals(np.zeros(13)))) < 0.01


def test_jax_simulates_our_model(simulated):
    jnp = pytest.importorskip("jax.numpy", reason="benchmarks/requirements.txt is not installed")
    pytest.importorskip("optimistix", reason="benchmarks/requirements.txt is not installed")
    from peers.jax_optimistix import residuals

    arrays = (simulated.u, simulated.y, np.diff(simulated.recording.time), simulated.sigma)
    z = jnp.asarray(unknowns(MODEL.values()))
    np.testing.assert_allclose(residuals(z, tuple(map(jnp.asarray, arrays))), 0.0, atol=1e-4)


def test_the_cell_of_casadi_is_ours(simulated):
    pytest.importorskip("casadi", reason="benchmarks/requirements.txt is not installed")
    from peers.casadi_nlp import cell

    logarithms = unknowns(MODEL.values())[: len(FREE)]
    later = cell().map(39)(simulated.y[:-1].T, simulated.u[:-1].T, np.diff(simulated.recording.time), logarithms)
    np.testing.assert_allclose(np.array(later).T, simulated.y[1:], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("torque_noise", [0.0, 0.003])
def test_casadi_finds_the_truth_where_nothing_is_noisy(simulated, monkeypatch, torque_noise):
    """Also with the torque's noise as unknowns, which then come out zero. Not compiled, to save time."""
    pytest.importorskip("casadi", reason="benchmarks/requirements.txt is not installed")
    from peers import casadi_disturbance, casadi_nlp

    monkeypatch.setattr(casadi_nlp, "COMPILER", {})
    start = {name: MODEL.values()[name] * factor for name, factor in zip(FREE, np.linspace(0.8, 1.25, 9), strict=True)}
    found = casadi_disturbance.fit(replace(simulated, torque_noise=torque_noise), start, 60.0)
    assert found.finished
    assert found.values == pytest.approx({name: MODEL.values()[name] for name in FREE}, rel=0.01)


def test_the_unknowns_are_the_parameters_and_back():
    assert values(unknowns(MODEL.values())) == pytest.approx({name: MODEL.values()[name] for name in FREE}, rel=1e-12)


def test_a_run_converges_by_its_errors_alone():
    near = dict.fromkeys(FREE, 0.009)
    assert Run("a", 0.0, 0, errors=near).converged
    assert Run("a", 0.0, 0, errors={**near, "c_m": -0.049}).converged
    assert not Run("a", 0.0, 0, errors={**near, "c_m": -0.051}).converged
    assert not Run("a", 0.0, 0, errors={**near, "J_q": -0.011}).converged
    assert not Run("a", 0.0, 0, errors=dict.fromkeys(FREE, float("nan"))).converged
    assert not Run("a", 0.0, 0, note="killed").converged


def test_the_table_hides_nothing():
    """Times of the converged runs and of all, the ratio to ours, and peers that failed or are not there."""
    good, bad = dict.fromkeys(FREE, 0.002), dict.fromkeys(FREE, 0.3)
    runs = [
        Run("joint_id", 0.0, 0, 0.05, 9.0, 20, True, good),
        Run("slow", 0.0, 0, 2.0, 3.0, 50, True, good),
        Run("slow", 0.0, 1, 4.0, 0.0, 70, False, bad, "no minimum"),
        Run("stuck", 0.0, 0, note="killed after 240 s"),
        Run("absent", 0.0, 0, note="not installed: casadi"),
        Run("joint_id", 0.003, 0, 0.02, 0.0, 10, True, bad),
    ]
    _, first, second = table(runs, {"joint_id": 1.0, "slow": 0.5}).split("torque noise ")
    rows = {line.split()[0]: " ".join(line.split()[1:]) for line in first.splitlines()[1:] if line}
    assert first.startswith("0 Nm")
    assert rows["joint_id"] == "1 of 1 0.05 s 1 0.05 s 10 s 20 0.20 % 0.2 %"
    assert rows["slow"] == "1 of 2 2 s 40 3 s 3.5 s 60 15.10 % 15.1 % no minimum (1)"
    assert rows["stuck"] == "- killed after 240 s (1)"
    assert rows["absent"] == "- not installed: casadi (1)"
    assert "0 of 1         -       -     0.02 s" in second


def test_the_script_runs_with_what_the_project_has(tmp_path):
    peers = ("scipy_least_squares", "torch_rmsprop")
    short = ("--samples", "100", "--starts", "1", "--noise", "0", "--limit", "4")
    text, runs = run(tmp_path, "--peers", *peers, *short)
    assert [r["peer"] for r in runs] == list(peers)
    assert all(line in text for line in peers)
    scipy, torch = runs
    assert scipy["finished"]
    assert max(abs(scipy["errors"][name]) for name in ("k_1", "J_m", "J_q")) < 0.01
    assert (torch["finished"], torch["note"]) == (False, "stopped at the time limit")
    assert torch["iterations"] > 0
    assert "stopped at the time limit (1)" in text


def test_a_peer_that_is_not_installed_is_shown(tmp_path):
    (tmp_path / "casadi.py").write_text('raise ModuleNotFoundError("No module named casadi", name="casadi")\n')
    text, runs = run(tmp_path, "--peers", "casadi_nlp", "--samples", "60", path=str(tmp_path))
    assert [(r["note"], r["errors"]) for r in runs] == [("not installed: casadi", None)] * 2
    assert text.count("not installed: casadi") == 2
