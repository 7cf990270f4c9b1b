"""Arms like those of the e-Series: descriptions, the arms that they describe not quite, and what these show.

Lengths, masses, limits of velocity and torque are of the sizes that the manufacturer publishes; the bodies are made up.
The dynamics of the links are those of MuJoCo.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from scipy.signal import lfilter

from joint_id_core.arm.description import Description
from joint_id_core.arm.friction import bend, usual_load
from joint_id_core.arm.regressor import Regressor
from joint_id_core.data.recording import Array, Recording
from joint_id_core.design.arm_prior import COULOMB, DAMPING, MEMORY_S, NOISE, ROTOR
from joint_id_core.design.limit_files import published
from joint_id_core.design.limits import JointLimits
from joint_id_core.design.trajectory import Trajectory
from joint_id_core.rtde.fields import JOINT_NAMES

# d1, a2, a3, d4, d5, d6 in m and masses in kg, rounded.
SIZES = {
    "ur3e": ((0.15, 0.24, 0.21, 0.13, 0.09, 0.09), (2.0, 3.4, 1.3, 0.8, 0.8, 0.3)),
    "ur5e": ((0.16, 0.43, 0.39, 0.13, 0.10, 0.10), (3.8, 8.4, 2.3, 1.7, 1.7, 0.3)),
    "ur10e": ((0.18, 0.61, 0.57, 0.17, 0.12, 0.12), (7.8, 12.9, 3.9, 2.0, 2.0, 0.3)),
}
HOME = np.array([0.0, -1.4, 1.4, -1.5, -1.5, 0.0])
SCATTER = 0.2  # standard deviation of logarithms: true friction, rotors and noise over the typical ones, masses
RATE, STILL_S = 500.0, 0.5  # samples a second; recorded before and after the motion
ENCODER = 1e-5  # rad
BENDS = (-0.6, -0.3, -0.3, 0.0, 0.0, 0.0)  # of friction, shares of Coulomb friction, as of a UR10e


@dataclass(frozen=True)
class Described:
    """A description of an arm, and its limits."""

    size: str
    bodies: tuple[tuple[float, tuple[float, float, float], tuple[float, float, float]], ...]

    @classmethod
    def drawn(cls, size: str, seed: int) -> Described:
        """Draw the bodies of an arm of a size."""
        (_, a2, a3, *_), masses = SIZES[size]
        rng = np.random.default_rng([seed, 1])
        along = [(0.0, 0.0, 0.0), (a2 / 2, 0.0, 0.12), (a3 / 2, 0.0, 0.02), *[(0.0, 0.0, 0.0)] * 3]
        bodies = []
        for mass, middle in zip(masses, along, strict=True):
            m = float(mass * np.exp(0.1 * rng.standard_normal()))
            c = np.array(middle) + 0.02 * rng.standard_normal(3)
            radius = np.array([0.05, 0.05 + 0.4 * abs(middle[0]), 0.05 + 0.4 * abs(middle[0])])
            # of a solid with these radii of gyration squared about its axes
            parts = m * radius**2 * np.exp(0.2 * rng.standard_normal(3))
            inertia = parts.sum() - parts
            bodies.append((m, tuple(c.tolist()), tuple(inertia.tolist())))
        return cls(size, tuple(bodies))

    def urdf(self, factors: Array | None = None) -> str:
        """Return the URDF; with its links heavier by `factors`, shape (6,)."""
        (d1, a2, a3, d4, d5, d6), _ = SIZES[self.size]
        half = math.pi / 2.0
        places = [
            ((0, 0, d1), (0, 0, 0)), ((0, 0, 0), (half, 0, 0)), ((-a2, 0, 0), (0, 0, 0)), ((-a3, 0, d4), (0, 0, 0)),
            ((0, -d5, 0), (half, 0, 0)), ((0, d6, 0), (-half, 0, 0)),
        ]  # fmt: skip
        lines, before = ['<robot name="arm"><link name="base"/>'], "base"
        for k, (name, (m, c, i)) in enumerate(zip(JOINT_NAMES, self.bodies, strict=True)):
            f = 1.0 if factors is None else float(factors[k])
            sign = -1.0 if k in (1, 2) else 1.0  # the links of these lie along -x
            xyz, rpy = (" ".join(f"{v:.12g}" for v in vector) for vector in places[k])
            lines.append(
                f'<link name="link_{k}"><inertial><origin xyz="{sign * c[0]:.12g} {c[1]:.12g} {c[2]:.12g}"/>'
                f'<mass value="{f * m:.12g}"/><inertia ixx="{f * i[0]:.12g}" iyy="{f * i[1]:.12g}" '
                f'izz="{f * i[2]:.12g}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
                f'<joint name="{name}" type="continuous"><parent link="{before}"/><child link="link_{k}"/>'
                f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="0 0 1"/></joint>'
            )
            before = f"link_{k}"
        return "\n".join([*lines, "</robot>"])

    def description(self) -> Description:
        """Return the description."""
        return Description(self.urdf(), f"{self.size}.urdf")

    def limits(self) -> JointLimits:
        """Return the limits that are published, completed."""
        return published(self.size).completed()[0]


@dataclass(frozen=True, eq=False)
class TrueArm:
    """An arm that its description tells of not quite."""

    urdf: str
    values: Array  # base parameters, damping, Coulomb friction
    bends: Array
    growth: float
    noise: Array
    memory: float
    usual: Array
    rotor: Array

    @classmethod
    def drawn(cls, described: Described, regressor: Regressor, seed: int, bent: bool) -> TrueArm:
        """Draw an arm."""
        rng, greatest = np.random.default_rng([seed, 2]), described.limits().torque

        def spread() -> Array:
            return np.asarray(np.exp(SCATTER * rng.standard_normal(6)))

        factors, rotor = spread(), ROTOR * greatest * spread()
        base = regressor.composition[:, 6:] @ (regressor.bodies * factors[:, None]).ravel()
        base[:6] += rotor
        coulomb = COULOMB * greatest * spread()
        return cls(
            described.urdf(factors),
            np.concatenate([base, DAMPING * greatest * spread(), coulomb]),
            np.array(BENDS) * coulomb * bent,
            float(rng.uniform(0.04, 0.08)),
            NOISE * greatest * spread(),
            float(MEMORY_S * np.exp(SCATTER * rng.standard_normal())),
            usual_load(regressor),
            rotor,
        )

    def recorded(self, motion: Trajectory, seed: int) -> dict[str, Recording]:
        """Return what the arm shows of a motion: link positions, and torques as means over a sample."""
        count = round((motion.duration + 2.0 * STILL_S) * RATE)
        time = np.arange(count) / RATE
        middle = motion.at(time + 0.5 / RATE - STILL_S)
        links = inverse(self.urdf, middle.position, middle.velocity, middle.acceleration)
        damping, coulomb = self.values[-12:-6], self.values[-6:]
        friction = coulomb + self.growth * (np.abs(links) - self.usual)
        torque = links + self.rotor * middle.acceleration + damping * middle.velocity
        # the bend of friction is told for a gear that yields, which the sign does not
        torque += friction * np.sign(middle.velocity) + self.bends * bend(middle.velocity)
        rng = np.random.default_rng([seed, 3])
        torque += self.noise * coloured(rng, count, self.memory)
        q = motion.at(time - STILL_S).position + ENCODER * rng.standard_normal((count, 6))
        return {
            name: Recording(time, {"link_position": q[:, j], "torque": torque[:, j]}, source="arm", joint=name)
            for j, name in enumerate(JOINT_NAMES)
        }


def coloured(rng: np.random.Generator, count: int, memory: float) -> Array:
    """Return a noise that forgets as exp(-t / memory), with a variance of 1 below 8 Hz, shape (count, 6)."""
    forgets = math.exp(-1.0 / RATE / memory)
    white = rng.standard_normal((count + 1000, 6)) * math.sqrt(1.0 - forgets**2)
    found = lfilter([1.0], [1.0, -forgets], white, axis=0)[1000:]
    return np.asarray(found / math.sqrt(in_band(memory)))


def in_band(memory: float) -> float:
    """Return the share of the variance of such a noise that is below 8 Hz."""
    return 2.0 / math.pi * math.atan(2.0 * math.pi * 8.0 * memory)


def inverse(urdf: str, q: Array, dq: Array, ddq: Array) -> Array:
    """Return the torques of the links by MuJoCo, shape (T, 6)."""
    compiler = '<mujoco><compiler discardvisual="true" balanceinertia="false"/></mujoco>'
    model = mujoco.MjModel.from_xml_string(urdf.replace('<robot name="arm">', f'<robot name="arm">{compiler}'))
    data, torque = mujoco.MjData(model), np.empty_like(q)
    for k in range(len(q)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q[k], dq[k], ddq[k]
        mujoco.mj_inverse(model, data)
        torque[k] = data.qfrc_inverse
    return torque


def near(limits: JointLimits, reach: float) -> JointLimits:
    """Return limits within a reach of home."""
    return replace(limits, lower=np.maximum(limits.lower, HOME - reach), upper=np.minimum(limits.upper, HOME + reach))
