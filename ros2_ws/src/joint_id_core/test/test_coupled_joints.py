"""Flexible joints whose links act on each other, against other integrators and another library's links."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from joint_id_core.data.recording import Array
from joint_id_core.errors import JointIdError
from joint_id_core.models import HarmonicDrive
from joint_id_core.simulation import coupled_joints
from joint_id_core.simulation.coupled_friction import with_friction
from joint_id_core.simulation.coupled_joints import CoupledJoints
from joint_id_core.simulation.simulator import JointSimulator

from .moving_arm import MUJOCO, URDF

mujoco = pytest.importorskip("mujoco", reason="the links of these tests are those of MuJoCo")

COUNT, DT = 6, 0.002
MODEL = HarmonicDrive(actuation="current")
START = np.array([0.0, -1.5, 1.5, -1.5, -1.5, 0.0])


class Links:
    """The links of an arm, by MuJoCo."""

    def __init__(self, gravity: float = 9.81) -> None:
        self.model = mujoco.MjModel.from_xml_string(URDF.replace('<robot name="arm">', MUJOCO))
        self.model.opt.gravity[:] = (0.0, 0.0, -gravity)
        self.data = mujoco.MjData(self.model)

    def dynamics(self, q: Array, dq: Array) -> tuple[Array, Array]:
        self.data.qpos[:], self.data.qvel[:] = q, dq
        mujoco.mj_forward(self.model, self.data)
        inertia = np.empty((COUNT, COUNT))
        mujoco.mj_fullM(self.model, self.data, inertia)
        return inertia, self.data.qfrc_bias.copy()


def values(**changes: float) -> list[dict[str, float]]:
    """Parameters of the joints: larger at the base."""
    nominal = MODEL.values({"k_t": 0.1})
    scaled = ("J_m", "c_m", "tau_fm", "c_1", "k_1", "k_2", "c_q", "tau_fq")
    rows = [
        {n: v * (size if n in scaled else 1.0) for n, v in nominal.items()} for size in (2.0, 2.0, 1.4, 1.0, 0.8, 0.6)
    ]
    return [{**row, **changes} for row in rows]


def drive(k: int) -> Array:
    """Currents of a motion that excites the gears."""
    holding = np.array([0.0, -1.5, -1.2, 0.4, 0.0, 0.0])
    return holding + np.array([2.0, 2.0, 1.0, 0.7, 0.6, 0.5]) * np.sin(
        2.0 * np.pi * np.array([2, 3, 4, 5, 6, 7]) * DT * k
    )


def moved(rows: list[dict[str, float]], count: int) -> Array:
    """States after each of `count` ticks, shape (count, 4, 6)."""
    arm, found = CoupledJoints(rows, Links(), START), []
    for k in range(count):
        arm.advance(DT, drive(k))
        found.append([arm.motor_position, arm.link_position, arm.motor_velocity, arm.link_velocity])
    return np.array(found)


def integrated(rows: list[dict[str, float]], count: int) -> Array:
    """The same without Coulomb friction, by an adaptive integrator of order 8 and the equations of the paper."""
    links, p = Links(), {n: np.array([row[n] for row in rows]) for n in rows[0]}
    arm = CoupledJoints(rows, links, START)
    state = np.concatenate([arm.motor_position, arm.link_position, np.zeros(2 * COUNT)])

    def rates(_: float, x: Array, current: Array) -> Array:
        theta, q, w, dq = x.reshape(4, COUNT)
        twist = theta / p["N"] - q
        spring = p["c_1"] * (w / p["N"] - dq) + p["k_1"] * twist + p["k_2"] * twist**3
        inertia, bias = links.dynamics(q, dq)
        pushed = np.linalg.solve(inertia, spring - p["c_q"] * dq - bias)
        return np.concatenate([w, dq, (p["k_t"] * current - p["c_m"] * w - spring / p["N"]) / p["J_m"], pushed])

    found = []
    for k in range(count):
        done = solve_ivp(rates, (0.0, DT), state, "DOP853", args=(drive(k),), rtol=1e-8, atol=1e-10)
        state = done.y[:, -1]
        found.append(state.reshape(4, COUNT))
    return np.array(found)


def test_the_motion_is_that_of_a_finer_integrator(monkeypatch):
    rows = values(tau_fm=0.0, tau_fq=0.0)
    exact, errors = integrated(rows, 60), []
    assert np.ptp(exact[:, 1], axis=0).min() > 0.01
    for step in (1e-3, 5e-4, 2.5e-4):
        monkeypatch.setattr(coupled_joints, "STEP_S", step)
        errors.append(np.abs(moved(rows, 60) - exact).max(axis=(0, 2)))
    coarse, usual, fine = errors
    np.testing.assert_array_less(usual, [2e-3, 2e-5, 0.2, 2e-3])
    # Of order 2: half the step, a quarter of the error.
    for one, half in ((coarse, usual), (usual, fine)):
        assert np.all((one / half > 3.0) & (one / half < 5.5)), one / half


def beside_one_alone() -> tuple[Array, Array]:
    """Errors of motor position, link position and link velocity against the simulation of one joint, and who sticks.

    The other joints are held by friction, so that the last one is a joint with a constant inertia.
    """
    rows, links = values(), Links(gravity=0.0)
    for row in rows[:-1]:
        row |= {"tau_fm": 1e3, "tau_fq": 1e3}
    inertia = links.dynamics(START, np.zeros(COUNT))[0][-1, -1]
    arm = CoupledJoints(rows, links, START)
    alone = JointSimulator(MODEL, {**rows[-1], "J_q": inertia})
    errors, stuck = [], []
    for k in range(500):
        current = 0.6 * np.sin(2.0 * np.pi * 1.5 * DT * k)
        arm.advance(DT, [0.0] * 5 + [current])
        alone.advance(DT, {"current": current})
        x = alone.state
        shown = arm.motor_position[-1] / 101.0, arm.link_position[-1], arm.link_velocity[-1]
        truth = x["motor_position"] / 101.0, x["link_position"], x["link_velocity"]
        errors.append(np.subtract(shown, truth))
        stuck.append([shown[2] == 0.0, truth[2] == 0.0])
    np.testing.assert_array_equal(arm.link_velocity[:-1], 0.0)
    np.testing.assert_array_equal(arm.link_position[:-1], START[:-1])
    return abs(np.array(errors)).max(axis=0), np.array(stuck)


@pytest.mark.long
def test_a_joint_alone_sticks_and_slips_as_in_the_exact_simulation(monkeypatch):
    usual, stuck = beside_one_alone()
    np.testing.assert_array_less(usual, [5e-5, 5e-5, 1e-2])
    assert 20 < stuck[:, 1].sum() < 400
    assert np.mean(stuck[:, 0] == stuck[:, 1]) > 0.98
    monkeypatch.setattr(coupled_joints, "STEP_S", 5e-5)
    np.testing.assert_array_less(beside_one_alone()[0], 0.2 * usual)


def test_stiff_gears_and_light_links_stay_calm():
    rows = values(k_1=1e6, k_2=0.0, c_1=0.0, tau_fm=0.0, tau_fq=0.0)
    swing = np.abs(np.diff(moved(rows, 200)[:, 3], axis=0)).max()
    assert swing < 1.0
    rows = values(c_1=1e4)
    assert np.abs(moved(rows, 200)[:, 3]).max() < 5.0


def test_an_arm_that_is_held_rests_exactly():
    rows, links = values(), Links()
    arm = CoupledJoints(rows, links, START)
    gravity = links.dynamics(START, np.zeros(COUNT))[1]
    before = arm.motor_position
    assert np.abs(before / 101.0 - START).max() > 1e-3  # twisted
    for _ in range(100):
        arm.advance(DT, gravity / 101.0 / 0.1)
    for now, expected in ((arm.motor_position, before), (arm.link_position, START), (arm.link_velocity, 0.0)):
        np.testing.assert_array_equal(now, expected)
    for _ in range(200):
        arm.advance(DT, np.zeros(COUNT))  # without current it falls
    assert np.abs(arm.link_position - START).max() > 0.05
    arm.rest()
    np.testing.assert_array_equal(arm.link_velocity, 0.0)


def test_a_motion_that_is_not_finite_is_told():
    arm = CoupledJoints(values(), Links(), START)
    with pytest.raises(JointIdError, match="not finite"):
        arm.advance(DT, [float("nan")] * COUNT)


# --- which elements stick


@pytest.mark.parametrize("seed", range(40))
def test_friction_is_that_of_the_only_consistent_modes(seed):
    """All 3^4 combinations of modes are tried: one is consistent, whatever modes the search begins with."""
    rng, n = np.random.default_rng(seed), 4
    root = rng.standard_normal((n, n))
    matrix = root @ root.T + 0.01 * np.eye(n)
    impulse, limit = 2.0 * rng.standard_normal(n), rng.uniform(0.1, 2.0, n)
    consistent = []
    for modes in itertools.product((-1.0, 0.0, 1.0), repeat=n):
        m = np.array(modes)
        some, velocity = np.flatnonzero(m), np.zeros(n)
        velocity[some] = np.linalg.solve(matrix[np.ix_(some, some)], (impulse - limit * m)[some])
        friction = impulse - matrix @ velocity
        if np.all(velocity * m >= 0.0) and np.all(np.abs(friction) <= limit * (1.0 + 1e-9)):
            consistent.append(velocity)
    assert len(consistent) == 1
    for begin in itertools.product((-1.0, 0.0, 1.0), repeat=n):
        velocity, _ = with_friction(matrix, impulse, limit, np.array(begin))
        np.testing.assert_allclose(velocity, consistent[0], rtol=1e-8, atol=1e-10)


def test_many_elements_that_act_strongly_on_each_other_find_their_modes():
    for seed in range(20):
        rng, n = np.random.default_rng(seed), 30
        root = rng.standard_normal((n, 5))
        matrix = root @ root.T + 1e-3 * np.eye(n)
        impulse, limit = 5.0 * rng.standard_normal(n), rng.uniform(0.0, 2.0, n)
        velocity, modes = with_friction(matrix, impulse, limit, np.zeros(n))
        friction = impulse - matrix @ velocity
        assert np.all(np.abs(friction) <= limit * (1.0 + 1e-9) + 1e-6)
        sliding = modes != 0.0
        np.testing.assert_allclose(friction[sliding], (limit * modes)[sliding], atol=1e-6)
        assert np.all(velocity * modes >= 0.0) and np.all(velocity[~sliding] == 0.0)
