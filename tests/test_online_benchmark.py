"""The benchmark of the online engine: what its records and verdicts mean, its scripts, three minutes of six joints."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from measured_blocks import BLOCK, DOCS, written
from online.cases import CASES, Case
from online.joints import JOINTS, joint
from online.long_run import LongRun, honesty
from online.records import records, steady
from online.watching import Hop, Outcome, outcome, watch

ROOT = Path(__file__).resolve().parent.parent


def hops(*rows) -> list[Hop]:
    return [Hop(end, status, False, False, named, (), off) for end, status, named, off in rows]


def summed_up(monkeypatch, rows, faulty=False, since=10.0) -> Outcome:
    """What comes out where an identifier says this."""
    record = steady(JOINTS["rigid_joint"], "excited", 0, 0.1)
    object.__setattr__(record, "since", since)
    monkeypatch.setattr("online.watching.watch", lambda *_: iter(hops(*rows)))
    return outcome(JOINTS["rigid_joint"], "a", "excited", 0, record, faulty)


def test_said_right_and_wrong_are_times_since_the_change(monkeypatch):
    found = summed_up(monkeypatch, [
        (9.5, "converged", (), {"J": 9.0}), (10.5, "converged", (), {"J": 9.0}), (11.0, "poor_fit", (), {}),
        (11.5, "converged", (10.2,), {"J": 1.0}), (12.0, "converged", (10.2,), {"J": 3.0}),
    ])  # fmt: skip
    assert (found.said, found.right, found.wrong_s) == (1.0, 1.5, 0.5)
    assert (found.largest, found.worst, found.early) == (9.0, "J", False)


def test_a_change_that_is_named_before_it_happens_is_early_and_not_said(monkeypatch):
    found = summed_up(monkeypatch, [(9.5, "converged", (5.0,), {"J": 1.0}), (10.5, "converged", (5.0,), {"J": 5.0})])
    assert found.early and found.said == found.right == np.inf


@pytest.mark.parametrize("name", sorted(JOINTS))
def test_what_a_joint_shows_obeys_its_model_before_and_after_a_change(name):
    """Truth and signals of every model fit together: the torque constant and the offset of the current too."""
    it = joint(name)
    values = it.values(3)
    assert all(abs(values[n] / v - 1.0) < 0.16 for n, v in it.plant.values(it.nominal).items() if v)
    warm = {**values, **{n: 0.95 * values[n] for n in it.parts["drive"]}}
    truth, before = it.truth(warm, offset=0.05), it.truth(values)
    if it.plant.drive == "voltage":
        assert truth == warm
    else:
        inertia = "J" if name == "rigid_joint" else "J_m"
        assert truth[inertia] == pytest.approx(before[inertia] / 0.95)
        if "tau_0" in truth:
            assert truth["tau_0"] == pytest.approx(0.05 * 0.1 * (101.0 if name == "rigid_joint" else 1.0))
    assert set(truth) <= set(it.model.parameter_names) | set(it.plant.parameter_names)
    assert {c.part for c in CASES} - {""} <= set(it.parts) | set(it.lacks)


def test_records_share_what_was_before_and_differ_after(monkeypatch):
    monkeypatch.setattr("online.records.BEFORE_S", {"excited": 0.5})
    monkeypatch.setattr(Case, "after_s", {"excited": 0.5})
    it = joint("rigid_joint")
    cases = [Case("nothing"), Case("load", "load", 2.0), Case("frozen", fault="frozen"), Case("late", fault="late")]
    same, heavy, frozen, late = (record for _, record in records(it, "excited", 1, cases))
    before = same.recording.time < same.since - 1e-9
    q = {id(r): r.recording["link_position"] for r in (same, heavy, frozen, late)}
    for record in (heavy, frozen, late):
        np.testing.assert_array_equal(q[id(record)][before], q[id(same)][before])
    assert heavy.truth(0.4)["J"] * 2.0 == heavy.truth(0.6)["J"]
    assert np.ptp(q[id(frozen)][~before]) == 0.0
    k = np.flatnonzero(~before)[5:]  # 5 ms are two and a half samples
    was = 0.5 * (q[id(same)][k - 2] + q[id(same)][k - 3])
    np.testing.assert_allclose(q[id(late)][k], was, atol=1e-4)
    assert np.abs(q[id(late)] - q[id(same)])[k].max() > 1e-3
    assert np.abs(q[id(heavy)] - q[id(same)])[~before].max() > 1e-3


@pytest.mark.long
def test_noise_of_the_link_encoder_does_not_bias_a_model_that_takes_the_link_for_known():
    """Without the correction for noise of inputs these errors are 4.6 standard deviations (rms)."""
    it, off = joint("motor_side"), []
    for seed in (20, 21, 22):
        last = [h for h in watch(it, steady(it, "ordinary", seed, 30.0)) if h.converged][-1]
        off += [last.off[n] for n in ("J_m", "c_m", "k_1")]
    assert np.sqrt(np.mean(np.square(off))) < 2.5


def test_honesty_counts_each_parameter_by_itself():
    runs = [
        LongRun("a", "excited", k, 20.0, {20.0: {"J": z, "c": 3.0}}, (), 0.0, 3.0, "c")
        for k, z in enumerate((1.0, -1.0))
    ]
    found = honesty(runs, 20.0)
    assert found is not None and (found.ratio, found.worst) == ((1.0, 3.0), "c")
    assert (found.coverage, found.mean) == ((0.0, 1.0), 0.5)
    assert honesty(runs, 600.0) is None


def test_measured_blocks_are_written_and_the_rest_is_left():
    page = "a\n<!-- measured: x -->\nold\n<!-- end -->\nb\n<!-- measured: y -->\n<!-- end -->\n"
    assert written(page, {"x": "new"}) == page.replace("old", "new")
    names = {name for path in DOCS.rglob("*.md") for _, name, _ in BLOCK.findall(path.read_text())}
    parts = ("targets", "joints", "links", "stiffness", "arm", "payload", "arm-followed", "arm-peers", "live")
    parts = (*parts, "wrong-model")
    fleet = {f"fleet-{part}" for part in ("robots", "emulator", "page", "participants")}
    others = {"changes", "loads", "steady", "peers", "soak", "robots", "batch", "batched", "batched-gpu", "bootstrap"}
    others |= {
        "design-arm",
        "design-bound",
        "design-waypoints",
        "design-joint",
        "arm-stats",
        "other-arms",
        "other-panda",
        "other-tx40",
    }
    assert names == others | {f"robots-{part}" for part in parts} | fleet


def script(name: str, *arguments: str) -> str:
    command = [sys.executable, str(ROOT / "benchmarks" / name), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=900.0)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.long
def test_the_scripts_run(tmp_path):
    text = script("online.py", "--quick", "--json", str(tmp_path / "online.json"))
    assert "| load + 10 % |" in text and "| `harmonic_drive` | excited | 600 s |" in text
    assert "| `harmonic_drive` | 8 s | 1 |" in text
    report = json.loads((tmp_path / "online_quick.json").read_text())
    assert {row["case"] for row in report["changes"]} == {"nothing", "load + 10 %", "encoder frozen"}
    file = tmp_path / "peers.json"
    script("online_peers.py", "--seeds", "1", "--seconds", "4", "--json", str(file))
    runs = {run["method"]: run for run in json.loads(file.read_text())["runs"]}
    assert runs["joint_id"]["failed"] == "" and len(runs["joint_id"]["errors"]) == 9


@pytest.mark.long
def test_three_minutes_of_six_joints_do_not_grow(tmp_path):
    file = tmp_path / "soak.json"
    script("soak.py", "--minutes", "3", "--warm-up", "240", "--json", str(file))
    found = json.loads(file.read_text())
    for name, use in found["processes"].items():
        assert use["growth"] < 0.03, name
        for what in ("files", "threads"):
            assert use[what][0] == use[what][1], (name, what)
    assert found["estimates"] > 0 and found["largest"] < 5.0
