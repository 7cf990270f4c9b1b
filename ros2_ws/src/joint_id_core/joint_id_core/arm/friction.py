"""Friction of the gears of an arm beyond viscous and Coulomb friction: it bends, and it grows with the load.

    tau = c v + (tau_c + s b(v) + mu (|load| - usual)) tanh(v / SLOW)

b is what a Stribeck curve in Tustin's form, exp(-|v| / v_s), has beside its nearest straight line (Armstrong-Helouvry,
Dupont & Canudas de Wit, Automatica 30, 1994). So c and tau_c stay those of the straight line that is nearest to the
friction, as without it. Teeth of a gear are pressed by the torque that they pass on, the load: mu, of all joints, is by
how much friction grows with it (Bittencourt & Gunnarsson, ASME Journal of Dynamic Systems, Measurement and Control 134,
2012). tau_c is Coulomb friction at a usual load: that of gravity by the description, the mean over poses.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from joint_id_core.arm import gear
from joint_id_core.arm.equations import KEPT, PAYLOAD, RATE, SLOW, Equations, below_band
from joint_id_core.arm.regressor import Regressor
from joint_id_core.data.recording import Array

STRIBECK = 0.3  # rad/s, v_s: where friction of gears bends
FASTEST = 1.0  # rad/s, to which a straight line shall be near
STRAIGHT = 2.0 * STRIBECK  # rad/s, from where a bend has hardly a slope of its own: slower, it looks like damping
POSES = 200  # random ones
GROWS = 0.3  # Nm/Nm, standard deviation of the growth with the load that is known beforehand: of gears it is below 0.2
# Share of the growth, as a standard deviation, by which a gear may lose more torque when it drives than when it is
# driven: that part goes with the load itself and not with the direction, so that it looks like a larger load.
UNEVEN = 0.5
ROUNDED = 9  # decimals of a load that are no rounding

_GRID = np.linspace(0.0, FASTEST, 101)
SLOPE, AT_REST = (float(v) for v in np.polyfit(_GRID, np.exp(-_GRID / STRIBECK), 1))


@dataclass(frozen=True)
class Friction:
    """Columns of friction that need to know the arm.

    Attributes:
        rigid: values of the inertial parameters of the arm without rotors, and of its payload, (base + PAYLOAD,).
        usual: load of each joint in Nm at which its Coulomb friction is told, (n,).
    """

    rigid: Array
    usual: Array

    @property
    def bends_and_growth(self) -> NDArray[np.intp]:
        """Places of the parameters of bends, and at the end of the growth with the load, from damping on."""
        count = len(self.usual)
        return np.append(np.arange(2 * count, 3 * count), 5 * count)

    @property
    def gears(self) -> NDArray[np.intp]:
        """Places of those of gears that yield: see `gear`."""
        return np.arange(3 * len(self.usual), 5 * len(self.usual))

    @classmethod
    def from_values(cls, regressor: Regressor, values: Array) -> Friction:
        """Return it from values of the inertial parameters of an arm and its payload, (base + PAYLOAD,) or more."""
        rigid = values[: len(regressor.reference) + PAYLOAD].copy()
        count = len(regressor.joints)
        rigid[:count] = regressor.reference[:count]  # a gear does not pass on what turns the rotor
        return cls(rigid, usual_load(regressor))

    def of(self, part: Equations) -> Array:
        """Return the inertial parameters whose torque is the load in a recording."""
        rigid = self.rigid.copy()
        rigid[part.base :] *= part.loaded
        return rigid

    def added(self, part: Equations) -> Equations:
        """Return equations away from reversals, with columns for bends, gears that yield, and growth with the load."""
        whole = part.unfiltered
        assert whole is not None, "a part of a recording"
        load, count = whole.inertial @ self.of(part), len(self.usual)
        own = bend(whole.dq)[:, :, None] * np.eye(count)
        growth = ((np.abs(load) - self.usual) * np.tanh(whole.dq / SLOW))[:, :, None]
        columns = np.concatenate([own, gear.rates(load, whole.known, RATE), growth], axis=2)
        more = below_band(columns, whole.known)[::KEPT]
        precision = np.concatenate([part.precision, np.zeros(count), gear.precision(count), [GROWS**-2]])
        return replace(part.steady, columns=np.concatenate([part.columns, more], axis=2), precision=precision)

    def as_load(self, growth: float) -> Array:
        """Return what of the load may be friction of gears that grows with it, one sigma, (base + PAYLOAD,)."""
        return UNEVEN * max(0.0, growth) * self.rigid

    def breakaway(self, values: Array, load: Array) -> Array:
        """Return friction at standstill in Nm, (..., n), from all parameters from damping on, and a load (..., n).

        What sticks does not hold less where the load is less than usual: of ten logs of a UR10e, the lift held 14 to
        17 Nm in six that stop with no load on it, as with the usual one.
        """
        count = len(self.usual)
        coulomb, bend = values[count : 3 * count].reshape(2, -1)
        more = np.maximum(0.0, load - self.usual)
        return np.maximum(0.0, coulomb + (1.0 - AT_REST) * bend + values[-1] * more)


def bend(dq: Array) -> Array:
    """Return the bend of friction at velocities in rad/s, for a unit parameter."""
    speed = np.abs(dq)
    return np.asarray((np.exp(-speed / STRIBECK) - AT_REST - SLOPE * speed) * np.tanh(dq / SLOW))


def shows_bend(part: Equations) -> NDArray[np.bool_]:
    """Return whether each joint is fast enough in some equations to tell a bend from a straight line, (n,)."""
    return np.asarray(np.any(part.used & (np.abs(part.dq) > STRAIGHT), axis=0))


def usual_load(regressor: Regressor) -> Array:
    """Return the mean size of the torque of gravity by the description, over random poses, in Nm, (n,)."""
    count = len(regressor.joints)
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (POSES, count))
    still = np.zeros_like(q)
    return np.asarray(np.abs(regressor.rows(q, still, still)[0] @ regressor.reference).mean(axis=0).round(ROUNDED))
