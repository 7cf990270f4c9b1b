"""The peers of the whole arm: how they are judged, that each finds a simulated arm, and what a missing one says."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict, replace
from importlib import import_module

import numpy as np
import pytest
from robots.arm_peers import process
from robots.arm_peers.found import Found, Method, of_json
from robots.arm_peers.logs import Log, without_meshes
from robots.arm_peers.pages import HEAD, least, pairs_by_joint, peers_table, relative_sigma
from robots.arm_peers.runs import METHODS, arm_log
from robots.fitted import Value
from robots.judging import Pairs
from robots.recordings import DATA, UR10E_ALL

from joint_id_core.arm.description import Description
from joint_id_core.arm.fit import fit_arm

LINK = """<link name="{0}"><inertial><mass value="{1}"/><origin xyz="0.1 0.02 0.2"/>
<inertia ixx="0.08" iyy="0.09" izz="0.05" ixy="0" ixz="0" iyz="0"/></inertial>
<visual><geometry><mesh filename="package://nowhere/{0}.stl"/></geometry></visual></link>"""
JOINT = """<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/><origin xyz="0 0 0.4"/>
<axis xyz="{3}"/><limit lower="-6" upper="6" effort="900" velocity="9"/></joint>"""
URDF = without_meshes(
    f"""<robot name="two"><link name="base"/>{LINK.format("upper", 4.0)}{LINK.format("lower", 2.0)}
{JOINT.format("first", "base", "upper", "0 1 0")}{JOINT.format("second", "upper", "lower", "0 1 0")}</robot>"""
)
DAMPING, FRICTION, ROTORS = np.array([12.0, 5.0]), np.array([8.0, 3.0]), np.array([2.0, 0.7])


def simulated(seed: int, seconds: float = 40.0) -> Log:
    """A log of an arm with friction, rotors and offsets."""
    pinocchio = pytest.importorskip("pinocchio")
    model, rng = pinocchio.buildModelFromXML(URDF), np.random.default_rng(seed)
    time = 0.01 * np.arange(round(100.0 * seconds))
    q, dq, ddq = np.zeros((3, len(time), 2))
    for k in range(1, 8):
        w, phase, size = 0.5 * k, rng.uniform(0.0, 6.0, 2), rng.uniform(0.2, 0.5, 2) / k**0.5
        q += size * np.sin(w * time[:, None] + phase)
        dq += size * w * np.cos(w * time[:, None] + phase)
        ddq -= size * w**2 * np.sin(w * time[:, None] + phase)
    data = model.createData()
    rigid = np.array([pinocchio.rnea(model, data, *state) for state in zip(q, dq, ddq, strict=True)])
    torque = rigid + ROTORS * ddq + DAMPING * dq + FRICTION * np.sign(dq) + [0.5, -0.3]
    return Log(f"log {seed}", ("first", "second"), time, q, torque + rng.normal(0.0, 0.2, torque.shape))


@pytest.fixture(scope="module")
def logs() -> list[Log]:
    return [simulated(1), simulated(2)]


@pytest.mark.parametrize("name", METHODS)
def test_each_method_finds_a_simulated_arm_and_predicts_another_log(name, logs):
    try:
        method = import_module(f"robots.arm_peers.{METHODS[name]}")
    except ImportError as error:
        pytest.skip(f"benchmarks/requirements-arm.txt is not installed: {error.name}")
    found = method.fit(URDF, logs[0], logs[1:])
    for quantity, truth in (("damping", DAMPING), ("friction", FRICTION)):
        assert [v.value for v in found.friction[quantity]] == pytest.approx(truth, rel=0.1)
        assert all(0.0 < v.sigma < 0.05 * v.value for v in found.friction[quantity])
    assert min(found.whole["log 2"]) > 0.995 and min(found.moving["log 2"]) > 0.995
    assert found.cpu_s > 0.0
    if found.masses:
        assert len(found.masses) == len(found.rotors) == 2


@pytest.mark.skipif(not DATA.is_dir(), reason=f"measured data are not there: {DATA}")
def test_ours_is_judged_by_the_friction_that_it_has():
    """What the benchmark predicts with an estimate is not behind what the fit itself says of a held-out recording."""
    ours = import_module("robots.arm_peers.ours")
    description = Description.read(DATA / "ur10e/ur10e.urdf")
    one, other = (arm_log(name, description.joints) for name in UR10E_ALL[:2])
    gains = {name: {"torque": 1.0} for name in description.joints}
    estimate = fit_arm(description, [ours.recordings(one)], gains, ours.recordings(other))
    judged = other.r_squared(ours.torque(estimate, description, other), in_motion=True)
    assert all(r > j.held_out - 0.002 for r, j in zip(judged, estimate.joints, strict=True))


def test_r_squared_is_about_the_means_and_in_motion_without_rests():
    time = 0.01 * np.arange(4000)
    moves = np.where(time < 20.0, 1.0, 0.0)
    q = np.column_stack([moves * np.sin(2.0 * time), np.sin(2.0 * time), np.zeros(4000)])
    torque = np.column_stack([10.0 * np.cos(2.0 * time)] * 3)
    log = Log("log", ("a", "b", "c"), time, q, torque)
    assert log.r_squared(torque + 3.0) == pytest.approx((1.0, 1.0, 1.0))
    assert log.r_squared(0.5 * torque) == pytest.approx((0.75, 0.75, 0.75), abs=0.01)
    wrong_at_rest = np.where(time[:, None] < 20.0, torque, 0.0)
    assert log.r_squared(wrong_at_rest)[0] == pytest.approx(0.5, abs=0.02)
    assert log.r_squared(wrong_at_rest, in_motion=True)[0] > 0.99
    assert np.isnan(log.r_squared(torque, in_motion=True)[2])  # it never moves
    fast = torque + 5.0 * np.sin(2.0 * np.pi * 25.0 * time)[:, None]  # above the band
    assert min(replace(log, torque=fast).r_squared(torque)) > 0.999


def found(first: float, second: float, sigma: float = 0.1, **changes) -> Found:
    friction = {"damping": [Value(first, sigma), Value(second, sigma)], "friction": [Value(2.0, 0.1)] * 2}
    return replace(Found(friction, {"log": [0.99, 0.98]}, {"log": [0.995, -0.5]}, cpu_s=0.5), **changes)


def test_pairs_are_counted_by_joint_and_only_of_what_is_known():
    fits = [found(1.0, 1.0), found(1.2, 1.3), found(9.0, 1.0, np.nan)]
    assert pairs_by_joint(fits) == [Pairs(1 + 3, 1 + 3), Pairs(0 + 3, 1 + 3)]
    assert relative_sigma([found(1.0, 0.5), found(1.0, 0.5, np.nan)]) == pytest.approx(0.05)
    assert least([f.whole for f in (*fits, found(1.0, 1.0, whole={"a": [0.7, 1.0], "b": [1.0, 0.6]}))]) == [0.7, 0.6]


def test_a_table_tells_what_is_missing_what_failed_and_what_is_known():
    fits = (found(1.0, 1.0), found(1.1, 1.1, masses=(0.5, 12.0), rotors=(-3.0, 1.0), infinite=4, cpu_s=1.5))
    rows = [
        Method("joint_id", (found(1.0, 1.0),) * 2), Method("a (a 1.0)", fits, "log 3: ValueError: no"),
        Method("b", (), "not installed: b"),
    ]  # fmt: skip
    lines = peers_table([of_json(json.loads(json.dumps(asdict(row)))) for row in rows]).splitlines()
    assert len(lines) == 5 and {line.count("|") for line in lines} == {len(HEAD) + 1}
    ours, peer, absent = ([cell.strip() for cell in line.split("|")[1:-1]] for line in lines[2:])
    assert ours[2:4] == [".990 .980", ".995 -.500"] and ours[-1] == "1"
    assert peer[1] == "2; 0 to 4 of its intervals infinite; log 3: ValueError: no"
    assert peer[-4:] == ["0.5 to 12", "-3", "1 s", "2"]
    assert absent[:2] == ["b", "not installed: b"] and set(absent[2:]) == {"-"}
    assert peers_table([]).count("\n") == 1


class Sent(list):
    """A connection that keeps what is sent."""

    send = list.append


@pytest.mark.parametrize(("module", "library"), [("figaroh_wls", "figaroh"), ("mujoco_sysid", "mujoco")])
def test_a_method_whose_library_is_missing_says_so(module, library, monkeypatch):
    monkeypatch.setattr("os.sched_setaffinity", lambda *_: None)
    monkeypatch.delitem(sys.modules, f"robots.arm_peers.{module}", raising=False)
    for loaded in [name for name in sys.modules if name.startswith(f"{library}.")]:
        monkeypatch.delitem(sys.modules, loaded)
    monkeypatch.setitem(sys.modules, library, None)
    process.serve(sent := Sent(), f"robots.arm_peers.{module}", URDF, [])
    assert len(sent) == 1 and sent[0].startswith(f"not installed: {library}")


def test_a_method_that_takes_too_long_or_fails_is_told(monkeypatch, tmp_path):
    code = "PACKAGE = 'numpy'\ndef fit(urdf, log, others):\n    {}\n"
    for name, does in (("slow", "while True: pass"), ("bad", "raise ValueError('no  luck')"), ("dead", "exit(3)")):
        (tmp_path / f"a_{name}_peer.py").write_text(code.format(does))
    monkeypatch.syspath_prepend(tmp_path)
    log = Log("log", ("a",), np.zeros(2), np.zeros((2, 1)), np.zeros((2, 1)))
    slow, bad, dead, absent = (
        process.fitted("peer", f"a_{name}_peer", URDF, [log], 0.3) for name in ("slow", "bad", "dead", "missing")
    )
    assert slow.name == f"peer (numpy {np.__version__})" and slow.failed == "stopped after 0.3 s of a fit"
    assert bad.failed == "log: ValueError: no luck" and bad.fits == ()
    assert dead.failed == "ended with exit code 3"
    assert absent == Method("peer", (), "not installed: a_missing_peer")
