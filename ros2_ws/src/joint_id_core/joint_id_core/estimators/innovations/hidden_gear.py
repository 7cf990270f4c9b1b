"""Whether the recorded motion of the link, an input of the model, shows what the gear passes on.

A model that takes the motion of the link as it was recorded (`motor_side`) does not know that the motor moves the link.
Where the gear twists little against the noise of the encoders, motor and link move as one. Then a motor as heavy as
both, with a spring that carries nearly nothing, explains the motor's motion, and better than the true values do, with
which noise of the encoder would push the motor. Nothing near that minimum tells that it is wrong.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.estimators.innovations.belief import Coordinates
from joint_id_core.estimators.innovations.gauss_newton import Minimum
from joint_id_core.estimators.innovations.recursion import Pass, Recursion
from joint_id_core.models.operations import ArrayOps

# Least part of the drive that a spring must carry, as far as the noise of the encoder does not make it. Of 200 random
# joints, fits within four standard deviations of the truth have 0.2 to 0.8; of those that are not, nine in ten less.
LEAST = 0.25
UNSURE = 0.5  # standard deviation of the spring's torque over its own from which it is unknown


def hidden_gear(
    recursion: Recursion,
    coordinates: Coordinates,
    found: Minimum,
    last: Pass,
    noisy: Sequence[tuple[Recursion, Pass]],
) -> str:
    """Return why what a fit says of motor and gear cannot be used; empty if nothing speaks against it.

    Args:
        recursion, coordinates, found, last: of the fit, with its latest pass.
        noisy: passes with the noise of the recorded motion once more, see `input_noise.with_motion_noise`.
    """
    free, model = recursion.data.free, recursion.data.model
    known = model.torque_drive is not None and bool(model.motor_inertias) and "motor_velocity" in model.state_names
    if not noisy or model.stiffness not in free or not known:
        return ""
    carried, unsure = _carried(recursion, found, last)
    of_noise = _information_of_noise(coordinates, found, last, noisy, free.index(model.stiffness))
    if carried * (1.0 - of_noise) >= LEAST and unsure < UNSURE:
        return ""
    return (
        f"the spring of the gear carries {100.0 * carried:.0f} % of the torque, known to {100.0 * unsure:.0f} %, and "
        f"{100.0 * of_noise:.0f} % of what tells its stiffness is noise of the encoders: motor and link may have moved "
        "as one, and what is said of the motor may be of both. Take harmonic_drive (--drifting-load if other joints "
        "move), or a motion that loads the gear more"
    )


def _carried(recursion: Recursion, found: Minimum, last: Pass) -> tuple[float, float]:
    """Return what the spring passes on to the motor, over the drive, and its uncertainty over itself.

    All three are standard deviations over time.
    """
    data, model, p = recursion.data, recursion.data.model, recursion.values(last.free)
    assert model.torque_drive is not None
    named = dict(zip(model.parameter_names, p.tolist(), strict=True))
    drive = data.u[:, model.input_names.index(model.torque_drive)] * model.torque_constant(named)
    x, u, at = list(last.states.T), list(data.u.T), model.state_names.index("motor_velocity")
    inertia = named[model.motor_inertias[-1]]

    def torque(without: Sequence[str]) -> Array:
        """Return what these parameters of the spring make, around its mean."""
        values = (named, named | dict.fromkeys(without, 0.0))
        full, rest = (model.derivative(x, u, SimpleNamespace(**v), ArrayOps())[at] for v in values)
        return np.asarray(inertia * (rest - full - np.mean(rest - full)))

    spring = [n for n in (model.stiffness, model.cubic_stiffness, model.gear_damping) if n is not None]
    own = float(np.std(torque(spring)))
    free = [n for n in spring if n in data.free]
    each, of = np.column_stack([torque([n]) for n in free]), [data.free.index(n) for n in free]
    uncertain = np.einsum("ti,ij,tj->", each, found.covariance[np.ix_(of, of)], each) / len(each)
    return own / (float(np.std(drive)) or 1.0), float(np.sqrt(uncertain)) / (own or 1.0)


def _information_of_noise(
    coordinates: Coordinates, found: Minimum, last: Pass, noisy: Sequence[tuple[Recursion, Pass]], at: int
) -> float:  # fmt: skip
    """Return the part of the information on a coordinate, beside all others, that the noise of inputs makes.

    As much noise once more adds as much information that is none (simulation extrapolation, see `input_noise`).
    """
    slope = coordinates.slope_at(last.free)
    outer = np.outer(slope, slope)
    prior = found.hessian - last.hessian * outer
    noisier = prior + outer * np.mean([passed.hessian for _, passed in noisy], axis=0)
    own, more = (1.0 / np.linalg.inv(H)[at, at] - prior[at, at] for H in (found.hessian, noisier))
    return float(np.clip((more - own) / own, 0.0, 1.0)) if own > 0.0 else 1.0
