"""The motion of an arm that tells the most within its limits: a Fourier series for each joint, by quasi-Newton steps.

Limits are penalties while the motion is looked for. What is beyond them in the end is taken off by a smaller motion, so
that every limit holds between samples, too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy  # whose parts load when used

from joint_id_core.data.recording import Array
from joint_id_core.design.arm_information import ArmColumns, Chosen
from joint_id_core.design.fourier import FourierMotion, basis
from joint_id_core.design.limits import JointLimits, violations
from joint_id_core.design.trajectory import Trajectory
from joint_id_core.errors import JointIdError

TONES = 10  # frequencies, and a constant
SLOWEST, FASTEST = 2.0, 2.0  # turns in the whole motion of the slowest; Hz of the fastest
RAMP = 0.1  # share of the motion of the soft start, and of the end
INSTANTS = 8.0  # in a second, at which information is computed
FINER = 6  # times as many at which limits are held while the motion is looked for
STARTS = 8  # random motions, of which the best is improved
ROUNDS = ((30.0, 40), (1e3, 40), (1e4, 20))  # weight of what is beyond limits, and steps
ROOM = 0.98  # share of the limits that is used
FLOOR_HZ = 100.0  # instants in a second at which heights are checked: a lowest point between them is 0.1 mm lower
LEAST, STEP = 0.05, 0.01  # least share of the found motion that is worth a design; the first step towards it

Depth = Callable[[Array], tuple[Array, Array]]  # of poses (T, n), see `Floor`


@dataclass(frozen=True, eq=False)
class Task:
    """What is asked.

    Attributes:
        columns: of the arm.
        chosen: parameters that shall be known.
        limits: of its joints, all of them finite but perhaps the torque.
        possible: values of the parameters of arms that must keep the limits of torque, shape (arms, P).
        home: pose at the start and end in rad, shape (n,).
        duration, rate: in s and samples a second.
        floor: what is too low; None without a floor.
    """

    columns: ArmColumns
    chosen: Chosen
    limits: JointLimits
    possible: Array
    home: Array
    duration: float
    rate: float
    floor: Depth | None = None

    def torque(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Return the greatest torque of each joint of the possible arms in Nm, shape (T, n)."""
        return np.abs(self.columns.at(q, dq, ddq) @ self.possible.T).max(axis=2)


def found_motion(task: Task, seed: int = 0) -> Trajectory:
    """Return the motion that tells the most.

    Raises:
        JointIdError: the limits do not let the arm stand at home, or hardly let it move.
    """
    _require_home(task)
    search = _Search(task)
    rng = np.random.default_rng(seed)
    starts = [search.feasible(rng.standard_normal(search.size)) for _ in range(STARTS)]
    best = min(starts, key=lambda z: search.cost(z, ROUNDS[0][0])[0])
    for weight, steps in ROUNDS:
        best = scipy.optimize.minimize(
            search.cost, best, (weight,), jac=True, method="L-BFGS-B", options={"maxiter": steps, "maxcor": 20}
        ).x
    return _within(search.motion(best), task)


def _require_home(task: Task) -> None:
    """Check that the arm may stand at home."""
    limits, still = task.limits, np.zeros((1, len(task.home)))
    torque = task.torque(task.home[None], still, still)[0]
    if (weak := torque > limits.torque).any():
        k = int(np.argmax(weak))
        raise JointIdError(
            f"{limits.names[k]} needs up to {torque[k]:.3g} Nm to stand at home, its limit is {limits.torque[k]:g} Nm: "
            "choose another home (--home), or correct limits and description"
        )
    if task.floor is not None and (low := task.floor(task.home[None])[0]).max() > 0.0:
        raise JointIdError(
            f"at home the arm is {low.max():.3g} m too low: choose another home (--home) or floor (--floor)"
        )


def _within(motion: FourierMotion, task: Task) -> Trajectory:
    """Return the motion, made smaller until it keeps all limits."""
    share, step, trajectory = 1.0, STEP, motion.sampled(task.rate)
    while found := broken(trajectory, task):
        share, step = share - step, 1.5 * step
        if share < LEAST:
            raise JointIdError(f"no motion from this home keeps the limits ({found}): choose another home or limits")
        smaller = replace(motion, cosines=share * motion.cosines, sines=share * motion.sines)
        trajectory = smaller.sampled(task.rate)
    return trajectory


def broken(trajectory: Trajectory, task: Task) -> str:
    """Return the first limit that a trajectory breaks, "" if it keeps them."""
    if found := violations(trajectory, task.limits):
        return found[0]
    if task.floor is not None:
        time = np.linspace(0.0, task.duration, round(FLOOR_HZ * task.duration) + 1)
        if (low := task.floor(trajectory.at(time).position)[0]).max() > 0.0:
            return f"a joint is {low.max():.3g} m below the floor"
    found = violations(trajectory, task.limits, task.torque)
    return found[0] if found else ""


class _Search:
    """Cost of motions and its gradient."""

    def __init__(self, task: Task) -> None:
        self._task, limits = task, task.limits
        self._joints = len(task.home)
        slowest = SLOWEST / task.duration
        self._tones = np.concatenate([[0.0], np.geomspace(slowest, max(FASTEST, 2.0 * slowest), TONES)])
        self._ramp = RAMP * task.duration
        count = round(INSTANTS * FINER * task.duration) + 1
        time = np.linspace(0.0, task.duration, count)
        waves = basis(time, self._tones, task.duration, self._ramp)
        self._waves, self._some = waves, slice(None, None, FINER)
        # sizes of coefficients of 1: what a tone alone may have
        omega = 2.0 * np.pi * self._tones[:, None]
        half = (limits.upper - limits.lower) / 2.0
        with np.errstate(divide="ignore"):
            sizes = np.minimum.reduce(
                [
                    np.tile(half, (len(omega), 1)),
                    limits.velocity / omega,
                    limits.acceleration / omega**2,
                    limits.jerk / omega**3,
                ]
            )
        self._sizes = np.tile(sizes, (2, 1)) / np.sqrt(TONES)
        self.size = self._sizes.size
        self._bounds = np.array(
            [np.ones(self._joints), *(getattr(limits, kind) for kind in ("velocity", "acceleration", "jerk"))]
        )
        self._middle, self._half = (limits.upper + limits.lower) / 2.0, half

    def motion(self, z: Array) -> FourierMotion:
        """Return the motion of coordinates (size,)."""
        task, tones = self._task, len(self._tones)
        c = (z.reshape(self._sizes.shape) * self._sizes).T
        return FourierMotion(
            task.limits.names, task.home, c[:, :tones], c[:, tones:], self._tones, task.duration, self._ramp
        )

    def feasible(self, z: Array) -> Array:
        """Return coordinates of a smaller motion that keeps the limits of every joint by itself."""
        c = z.reshape(self._sizes.shape) * self._sizes
        peaks = np.abs(self._waves @ c).max(axis=1)
        room = np.minimum(self._task.limits.upper - self._task.home, self._task.home - self._task.limits.lower)
        peaks[0] /= room
        share = ROOM / np.max(peaks / self._bounds, axis=0)
        return np.asarray(z.reshape(self._sizes.shape) * share).ravel()

    def cost(self, z: Array, weight: float) -> tuple[float, Array]:
        """Return minus the information and what is beyond limits, and the derivative by the coordinates."""
        task, waves = self._task, self._waves
        c = z.reshape(self._sizes.shape) * self._sizes
        state = waves @ c
        state[0] += task.home
        cost, slopes = self._beyond(state, weight)
        some = state[:, self._some]
        columns = task.columns.at(some[0], some[1], some[2])
        information, weighed = task.columns.information(columns)
        told, by_information = task.chosen.told(information)
        weights = -2.0 * weighed @ by_information
        over, by_torque = self._too_strong(columns, weight)
        inner = task.columns.slopes((some[0], some[1], some[2]), columns, weights + by_torque)
        for order, slope in enumerate(inner):
            slopes[order, self._some] += slope
        gradient = np.einsum("otk,otn->kn", waves, slopes) * self._sizes
        return cost + over - told, gradient.ravel()

    def _beyond(self, state: Array, weight: float) -> tuple[float, Array]:
        """Return the penalty of what is beyond the limits of single joints and the floor, and its derivative."""
        weight, slopes = weight / FINER, np.zeros_like(state)
        shares = state / self._bounds[:, None]
        shares[0] = (state[0] - self._middle) / self._half
        over = np.maximum(0.0, np.abs(shares) - ROOM)
        slopes = 2.0 * weight * over * np.sign(shares) / self._bounds[:, None]
        slopes[0] /= self._half
        cost = weight * float(np.sum(over**2))
        if self._task.floor is not None:
            low, by_position = self._task.floor(state[0, self._some])
            deep = np.maximum(0.0, low + FLOOR_ROOM) / FLOOR_SCALE
            cost += weight * FINER * float(np.sum(deep**2))
            slopes[0, self._some] += 2.0 * weight * FINER * np.einsum("tk,tkn->tn", deep / FLOOR_SCALE, by_position)
        return cost, slopes

    def _too_strong(self, columns: Array, weight: float) -> tuple[float, Array]:
        """Return the penalty of torques beyond their limits, and its derivative by the columns."""
        possible, limit = self._task.possible, self._task.limits.torque[:, None]
        torque = columns @ possible.T / limit
        over = np.maximum(0.0, np.abs(torque) - ROOM)
        return weight * float(np.sum(over**2)), 2.0 * weight * (over * np.sign(torque) / limit) @ possible


FLOOR_ROOM, FLOOR_SCALE = 0.01, 0.1  # m: kept above the floor while the motion is looked for; that counts as a limit
