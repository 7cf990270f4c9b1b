"""Many starts, bootstrap, fleets: they end where the engine ends, and say what they find."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest
from typer.testing import CliRunner

import joint_id_core as jid
from joint_id_core.cli import app
from joint_id_core.estimators.innovations.gauss_newton import minimise
from joint_id_core.estimators.many.minimising import Start, minimised
from joint_id_core.estimators.many.passes import passes_on
from joint_id_core.estimators.many.problem import searched

MODEL = jid.build("rigid_joint")
MOTION = jid.simulate_motion(MODEL, 2.0, 250.0, seed=1)
SHORT = jid.simulate_motion(MODEL, 0.8, 250.0, seed=1)  # for what torch does: its time on a CPU grows with the samples


@pytest.fixture(scope="module")
def outcome():
    return searched(MODEL, SHORT, None, jid.Innovations(), lambda _: None)


@pytest.fixture(autouse=True)
def one_thread():
    torch = pytest.importorskip("torch", reason="the batched network needs torch, which is not installed")
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.mark.parametrize(
    "device",
    ["cpu", pytest.param("torch", marks=pytest.mark.long)],  # test_batched.py has the passes of torch
)
def test_a_batch_ends_where_the_engine_ends_from_the_same_start(outcome, device):
    stages, found = outcome.stages, outcome.minimum
    rng = np.random.default_rng(2)
    z = [stages.cost.belief.mean + 0.3 * stages.coordinates.spread * rng.uniform(-1, 1, 4) for _ in range(2)]
    levels = stages.noise.clip(stages.noise.rough * np.array([1.0, 1e4, 1.0]))
    passes = passes_on(device, [stages.recursion], [found.last.steps])
    starts = [Start(0, stages.cost, stages.scoring, one, levels) for one in z]
    ends = minimised(passes, starts, [found.substeps], 0.01, 50)
    sigma = np.sqrt(np.diag(found.inverse))
    for one, end in zip(z, ends, strict=True):
        engine = minimise(
            stages.cost, stages.cost.at(one, levels, found.last.steps, found.substeps), 0.01, 50, stages.scoring
        )
        assert end is not None and engine is not None and end.settled and engine.iterations == end.iterations
        assert np.all(np.abs(end.z - engine.z) < 1e-3 * sigma)
        assert np.all(np.abs(end.z - found.z) < 0.2 * sigma)  # the fit ended with a looser tolerance


def test_no_start_is_better_than_the_fit():
    found = jid.many_starts(MODEL, MOTION, starts=30, seed=4)
    assert found.engine_is_best and found.gain < 2.0 and found.starts == 30
    best = found.ends[0]
    assert best.share > 0.4 and best.away < 0.5
    fitted = jid.fit(MODEL, MOTION)
    assert abs(best.values["J"] - fitted["J"].value) < fitted["J"].std_dev
    assert sum(end.share for end in found.ends) <= 1.0 + 1e-12
    assert "30 starts of" in str(found) and found.to_dict()["engine_is_best"] is True


def test_a_better_point_than_the_fit_is_said(outcome):
    """The engine's minimum is replaced by a worse point: the starts must notice."""
    from dataclasses import replace

    from joint_id_core.estimators.many.starts import _counted

    engine = outcome.minimum
    worse = replace(engine, z=engine.z + 0.1, cost=engine.cost + 50.0)
    found = _counted(replace(outcome, minimum=worse), [worse, engine, None], "a record", "cpu", 1.0)
    assert not found.engine_is_best and abs(found.gain - 50.0) < 1e-6 and found.diverged == 1
    assert "a better point than the fit exists: its cost is lower by 50" in str(found)


@pytest.mark.long
def test_the_scatter_of_a_bootstrap_is_that_of_the_noise():
    found = jid.bootstrap(MODEL, SHORT, draws=60, block_s=0.02)
    assert found.failed == 0 and found.draws.shape == (60, 4)
    ratios = np.array([i.scatter / i.noise for i in found.intervals])
    assert np.all((ratios > 0.6) & (ratios < 1.6)), ratios  # 60 draws of 40 blocks tell it to 15 %
    assert all(i.lower < i.value + 3 * i.std_dev and i.upper > i.value - 3 * i.std_dev for i in found.intervals)
    assert "95 % of the draws" in str(found)


def test_a_fleet_gets_the_estimates_of_its_joints():
    truths = (0.8, 1.3)
    motions = [jid.simulate_motion(MODEL, 2.0, 250.0, seed=k, values={"J": J}) for k, J in enumerate(truths)]
    still = MOTION.with_channels({name: np.zeros(len(MOTION)) for name in MOTION.channels})
    found = jid.fit_fleet(MODEL, [motions[0], still, motions[1]], starts=2)
    assert found[1].status is jid.Status.NO_MOTION
    for estimate, motion, J in zip((found[0], found[2]), motions, truths, strict=True):
        alone = jid.Innovations().fit(MODEL, motion)
        assert estimate.converged and abs(estimate["J"].value - J) < 4.0 * estimate["J"].std_dev
        for row in alone.parameters:
            if row.name in alone.free:
                assert abs(estimate[row.name].value - row.value) < 0.3 * row.std_dev
                assert abs(estimate[row.name].std_dev / row.std_dev - 1.0) < 0.1


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: jid.many_starts(MODEL, MOTION, starts=0), "starts = 0: give 1 or more"),
        (lambda: jid.many_starts(MODEL, MOTION, starts=1, device="tpu"), "unknown device 'tpu'"),
        (lambda: jid.bootstrap(MODEL, MOTION, draws=5), "draws = 5: an interval needs 20 or more"),
        (
            lambda: jid.bootstrap(MODEL, MOTION, block_s=1.0),
            "block_s = 1: give a time above 0, for this record at most",
        ),
        (lambda: jid.bootstrap(MODEL, MOTION, block_s=0.0), "block_s = 0: give a time above 0"),
        (lambda: jid.fit_fleet(MODEL, []), "0 recordings and 4 starts"),
        (
            lambda: jid.many_starts(
                MODEL, MOTION, starts=1, device="torch", estimator=jid.Innovations(cell="implicit")
            ),
            "torch has no implicit cell",
        ),
    ],
)
def test_misuse_is_said(call, said):
    with pytest.raises(jid.JointIdError, match=said):
        call()


@pytest.mark.long
def test_many_starts_on_the_cpu_do_not_load_torch():
    code = (
        "import sys, joint_id_core as jid; m = jid.build('rigid_joint'); "
        "jid.many_starts(m, jid.simulate_motion(m, 2.0, 250.0, seed=1), starts=2); print('torch' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=True)
    assert done.stdout.strip() == "False"


def test_the_commands_say_what_they_found(tmp_path):
    jid.write(tmp_path / "motion.csv", SHORT)
    file = str(tmp_path / "motion.csv")
    done = CliRunner().invoke(app, ["many-starts", file, "--model", "rigid_joint", "--starts", "3", "--json"])
    assert done.exit_code == 0 and json.loads(done.stdout)["starts"] == 3
    done = CliRunner().invoke(app, ["many-starts", file])
    assert done.exit_code == 2 and "name the model (--model)" in done.output
    done = CliRunner().invoke(app, ["bootstrap", file, "--model", "rigid_joint", "--device", "tpu"])
    assert done.exit_code == 2 and "unknown device 'tpu'" in done.output


def test_a_gpu_that_is_not_there_is_said_before_the_fit():
    import torch

    if torch.cuda.is_available():
        pytest.skip("there is a GPU here")
    for call in (jid.many_starts, jid.bootstrap):
        with pytest.raises(jid.JointIdError, match="device cuda: PyTorch finds no GPU here: choose cpu"):
            call(MODEL, MOTION, device="cuda")
