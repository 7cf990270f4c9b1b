"""An arm of six joints that all move. The dynamics of its links are those of MuJoCo.

With rigid joints its motion is given in closed form, so that its recordings are exact.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest

from joint_id_core.data.recording import Array, Recording
from joint_id_core.simulation.minimum_jerk import minimum_jerk

JOINTS = ("turn", "lift", "bend", "roll", "tilt", "spin")
# For tests of single joints: one that bears a load in `make test`, the rest in `make test-long`.
ONE_QUICK = [name if name == "lift" else pytest.param(name, marks=pytest.mark.long) for name in JOINTS]
ROTOR = np.array([1.2, 0.9, 0.6, 0.3, 0.3, 0.2])  # kg m^2 at the link
VISCOUS = np.array([8.0, 6.0, 4.0, 2.0, 1.5, 1.0])  # Nm s/rad at the link
COULOMB = np.array([5.0, 4.0, 3.0, 2.0, 1.5, 1.0])  # Nm at the link
STIFFNESS = np.array([3e4, 3e4, 1.5e4, 6e3, 6e3, 6e3])  # Nm/rad
DAMPING_S = 2e-3  # of the spring over its stiffness
LINK_VISCOUS = 0.3  # share of the viscous friction that acts on the link
RATIO, RATE, FINER = 100.0, 500.0, 16  # samples/s, steps of the integrator in a sample
LOOP = 2.0 * np.pi * 4.0  # rad/s, of the controllers
SMOOTHING = 0.1  # rad/s at the motor, of Coulomb friction
ELECTRICAL = {"R": 0.5, "L": 5e-4, "k_b": 0.1, "k_t": 0.1}  # of every motor: Ohm, H, V s/rad, Nm/A


def link(name: str, mass: float, centre: tuple[float, float, float], size: float) -> str:
    """A link, with a mesh that does not exist."""
    place = " ".join(map(str, centre))
    return f"""
  <link name="{name}">
    <visual><geometry><mesh filename="package://nowhere/{name}.dae"/></geometry></visual>
    <inertial>
      <origin xyz="{place}" rpy="0 0 0.3"/><mass value="{mass}"/>
      <inertia ixx="{size}" iyy="{1.3 * size}" izz="{0.7 * size}" ixy="0" ixz="{0.1 * size}" iyz="0"/>
    </inertial>
  </link>"""


def joint(name: str, parent: str, child: str, origin: str, axis: str, kind: str = "revolute", more: str = "") -> str:
    """A joint without limits."""
    return f"""
  <joint name="{name}" type="{kind}">
    <parent link="{parent}"/><child link="{child}"/><origin {origin}/><axis xyz="{axis}"/>{more}
  </joint>"""


URDF = f"""<?xml version="1.0"?>
<robot name="arm">
  <link name="base"/>{link("column", 8.0, (0.0, 0.02, -0.03), 0.03)}{link("upper", 6.0, (0.22, 0.0, 0.05), 0.05)}
  {link("fore", 3.0, (0.18, 0.01, 0.0), 0.02)}{link("wrist", 1.2, (0.0, 0.02, 0.04), 0.003)}
  {link("hand", 1.0, (0.01, 0.0, 0.05), 0.002)}{link("plate", 0.5, (0.03, 0.0, 0.02), 0.001)}
  {link("tool", 0.8, (0.0, 0.02, 0.05), 0.002)}
  {joint("turn", "base", "column", 'xyz="0 0 0.2"', "0 0 1", "continuous")}
  {joint("lift", "column", "upper", 'xyz="0 0.1 0.05" rpy="0 0.2 0"', "0 1 0")}
  {joint("bend", "upper", "fore", 'xyz="0.4 0 0"', "0 1 0")}
  {joint("roll", "fore", "wrist", 'xyz="0.35 0 0"', "1 0 0")}
  {joint("tilt", "wrist", "hand", 'xyz="0 0 0.08" rpy="0 1.2 0"', "0 1 0")}
  {joint("spin", "hand", "plate", 'xyz="0.02 0 0.08"', "0 0 1", "continuous")}
  {joint("flange", "plate", "tool", 'xyz="0 0 0.04" rpy="0 0.4 0"', "1 0 0", "fixed")}
</robot>"""
DOWN = (0.0, 0.0, -9.81)  # m/s^2
MASS, CENTRE = 2.5, (0.02, -0.03, 0.12)  # of a payload: kg, and m in the frame of the plate
CARRYING = URDF.replace(
    "</robot>",
    link("load", MASS, (0.0, 0.0, 0.0), 0.004)
    + joint("grip", "plate", "load", f'xyz="{" ".join(map(str, CENTRE))}"', "1 0 0", "fixed")
    + "</robot>",
)
# MuJoCo reads no meshes, and joins fixed links.
MUJOCO = '<robot name="arm"><mujoco><compiler discardvisual="true" balanceinertia="false"/></mujoco>'


@dataclass(frozen=True)
class Motion:
    """Positions, velocities and accelerations of the joints, each of shape (T, 6)."""

    q: Array
    dq: Array
    ddq: Array


def at(time: Array, seed: int = 0, standing: tuple[str, ...] = (), share: float = 1.0) -> Motion:
    """A motion of sines at some instants, or a share of it, in which some joints stand."""
    rng = np.random.default_rng(seed)
    q, dq, ddq = (np.zeros((len(time), len(JOINTS))) for _ in range(3))
    for j in range(len(JOINTS)):
        for hz in rng.uniform(0.1, 0.9, 5):
            w, size, phase = 2.0 * np.pi * hz, rng.uniform(0.1, 0.35), rng.uniform(0.0, 2.0 * np.pi)
            if JOINTS[j] in standing:
                continue
            q[:, j] += size * np.sin(w * time + phase)
            dq[:, j] += size * w * np.cos(w * time + phase)
            ddq[:, j] -= size * w * w * np.sin(w * time + phase)
    return Motion(share * q, share * dq, share * ddq)


def inverse(motion: Motion, urdf: str = URDF, gravity: tuple[float, float, float] = DOWN) -> Array:
    """Torques that the rigid links need, shape (T, 6)."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(urdf.replace('<robot name="arm">', MUJOCO))
    model.opt.gravity[:] = gravity
    data, torque = mujoco.MjData(model), np.empty_like(motion.q)
    for k in range(len(motion.q)):
        data.qpos[:], data.qvel[:], data.qacc[:] = motion.q[k], motion.dq[k], motion.ddq[k]
        mujoco.mj_inverse(model, data)
        torque[k] = data.qfrc_inverse
    return torque


def rigid(
    seconds: float,
    seed: int = 0,
    urdf: str = URDF,
    growth: float = 0.0,
    falls: Array | float = 0.0,
    standing: tuple[str, ...] = (),
    noise: float = 1e-5,
    late: float = 0.0,
    gravity: tuple[float, float, float] = DOWN,
    share: float = 1.0,
) -> dict[str, Recording]:
    """What link encoders and torques of all joints show, by name; torques are means over a sample.

    Coulomb friction grows with the torque of the links by a share `growth` of it, and `falls` (Nm) from standstill as
    exp(-|v| / 0.3 rad/s). Encoders have a `noise` in rad, torques are `late` in s, and the motion is a `share` of `at`.
    """
    time = np.arange(round(seconds * RATE)) / RATE
    middle = at(time + 0.5 / RATE - late, seed, standing, share)
    links = inverse(middle, urdf, gravity)
    coulomb = COULOMB + growth * np.abs(links) + falls * np.exp(-np.abs(middle.dq) / 0.3)
    torque = links + ROTOR * middle.ddq + VISCOUS * middle.dq + coulomb * np.sign(middle.dq)
    rng = np.random.default_rng([seed, 1])
    shown = {"link_position": at(time, seed, standing, share).q + noise * rng.standard_normal(torque.shape)}
    shown["torque"] = torque + 0.05 * rng.standard_normal(torque.shape)
    return _by_joint(time, shown)


def with_rests(time: Array, seed: int = 0) -> Motion:
    """The same motion, which slows down, rests for a second, and goes on, every four seconds."""
    rest, ramp, period = 1.0, 0.5, 4.0
    phase = np.mod(time, period) - (period - rest)
    speed = np.clip(np.minimum(-phase, phase + period - rest) / ramp, 0.0, 1.0)
    smooth, _ = minimum_jerk(speed)
    moved = np.concatenate([[0.0], np.cumsum(0.5 * (smooth[1:] + smooth[:-1]) * np.diff(time))])
    there, rate = at(moved, seed), np.gradient(smooth, time)
    s = smooth[:, None]
    return Motion(there.q, there.dq * s, there.ddq * s**2 + there.dq * rate[:, None])


def point_to_point(moves: int, seed: int = 0) -> dict[str, Recording]:
    """What the same shows of an arm that MuJoCo moves to some poses, 1.2 s each, and that rests there for 1.5 s.

    Its friction holds it where it stops: MuJoCo's friction loss. The controllers have no integral, so torques at rest
    are anything that friction allows.
    """
    import mujoco

    model = mujoco.MjModel.from_xml_string(URDF.replace('<robot name="arm">', MUJOCO))
    model.opt.timestep, model.opt.iterations = 1.0 / RATE, 50
    model.dof_armature[:], model.dof_damping[:], model.dof_frictionloss[:] = ROTOR, VISCOUS, COULOMB
    model.dof_solimp[:, :2] = 0.9999  # joints that stick hardly creep
    data, rng = mujoco.MjData(model), np.random.default_rng([seed, 3])
    poses = np.concatenate([np.zeros((1, len(JOINTS))), rng.uniform(-1.2, 1.2, (moves, len(JOINTS)))])
    move, rest = round(1.2 * RATE), round(1.5 * RATE)
    share = np.concatenate([minimum_jerk(np.linspace(0.0, 1.0, move))[0], np.ones(rest)])
    reference = np.concatenate([a + share[:, None] * (b - a) for a, b in pairwise(poses)])
    speed = np.gradient(reference, 1.0 / RATE, axis=0)
    gain = 30.0 * COULOMB  # Nm/rad: the arm stops up to 2 degrees away
    q, torques = np.empty_like(reference), np.empty_like(reference)
    for k in range(len(reference)):
        mujoco.mj_forward(model, data)
        q[k] = data.qpos
        torques[k] = data.qfrc_bias + gain * (reference[k] - q[k]) + 0.3 * gain * (speed[k] - data.qvel)
        data.qfrc_applied[:] = torques[k]
        mujoco.mj_step(model, data)
    noise = np.random.default_rng([seed, 4]).standard_normal((2, *q.shape))
    shown = {"link_position": q + 1e-5 * noise[0], "torque": torques + 0.05 * noise[1]}
    return _by_joint(np.arange(len(q)) / RATE, shown)


def flexible(
    seconds: float, seed: int = 0, path: Callable[[Array, int], Motion] = at, electrical: bool = False
) -> dict[str, Recording]:
    """What both encoders and motor torques of all joints show, behind springs with dampers, by name.

    A controller of each motor holds its torque over a sample; if `electrical`, its voltage, and voltages
    and currents are shown. Motors, springs and links are integrated by Runge-Kutta.
    """
    resistance, inductance, back_emf, constant = ELECTRICAL.values()
    count, h = round(seconds * RATE), 1.0 / (RATE * FINER)
    links, reference = _Links(), path(np.arange(count) / RATE, seed)
    rotor, damping = ROTOR / RATIO**2, DAMPING_S * STIFFNESS
    whole = rotor + links.inertia / RATIO**2

    def rates(x: Array, held: Array) -> Array:
        theta, q, w, dq, current = x
        torque = constant * current if electrical else held
        spring = STIFFNESS * (theta / RATIO - q) + damping * (w / RATIO - dq)
        friction = (1.0 - LINK_VISCOUS) * VISCOUS / RATIO**2 * w + COULOMB / RATIO * np.tanh(w / SMOOTHING)
        pushed = links.accelerated(q, dq, spring - LINK_VISCOUS * VISCOUS * dq)
        changes = (held - resistance * current - back_emf * w) / inductance if electrical else np.zeros_like(w)
        return np.array([w, dq, (torque - friction - spring / RATIO) / rotor, pushed, changes])

    x = np.array(
        [RATIO * reference.q[0], reference.q[0], RATIO * reference.dq[0], reference.dq[0], np.zeros(len(JOINTS))]
    )
    states, inputs = np.empty((count, *x.shape)), np.empty((count, len(JOINTS)))
    for k in range(count):
        away, slower = RATIO * reference.q[k] - x[0], RATIO * reference.dq[k] - x[2]
        torque = whole * (RATIO * reference.ddq[k] + 2.0 * LOOP * slower + LOOP**2 * away)
        held = resistance / constant * torque + back_emf * x[2] if electrical else torque
        states[k], inputs[k] = x, held
        for _ in range(FINER):
            one = rates(x, held)
            two = rates(x + 0.5 * h * one, held)
            three = rates(x + 0.5 * h * two, held)
            x = x + h / 6.0 * (one + 2.0 * two + 2.0 * three + rates(x + h * three, held))
    noise = np.random.default_rng([seed, 2]).standard_normal((3, count, len(JOINTS)))
    shown = {"motor_position": states[:, 0] + 1e-3 * noise[0], "link_position": states[:, 1] + 1e-5 * noise[1]}
    if electrical:
        shown |= {"voltage": inputs, "current": states[:, 4] + 0.01 * noise[2]}
    else:
        shown["torque"] = inputs + 1e-3 * noise[2]
    return _by_joint(np.arange(count) / RATE, shown)


class _Links:
    """Forward dynamics of the links by MuJoCo."""

    def __init__(self) -> None:
        import mujoco

        self._step = mujoco.mj_forward
        self._model = mujoco.MjModel.from_xml_string(URDF.replace('<robot name="arm">', MUJOCO))
        self._data = mujoco.MjData(self._model)
        mujoco.mj_forward(self._model, self._data)
        full = np.empty((len(JOINTS), len(JOINTS)))
        mujoco.mj_fullM(self._model, self._data, full)
        self.inertia = np.diag(full)

    def accelerated(self, q: Array, dq: Array, torque: Array) -> Array:
        self._data.qpos[:], self._data.qvel[:], self._data.qfrc_applied[:] = q, dq, torque
        self._step(self._model, self._data)
        return self._data.qacc.copy()


def _by_joint(time: Array, shown: dict[str, Array]) -> dict[str, Recording]:
    return {
        name: Recording(time, {channel: values[:, j] for channel, values in shown.items()}, source="arm", joint=name)
        for j, name in enumerate(JOINTS)
    }
