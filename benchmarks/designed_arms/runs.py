"""Design motions, let true arms make them, and fit what these show."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from designed_arms.arms import HOME, SIZES, Described, TrueArm, near
from joint_id_core.arm.arm_estimate import ArmEstimate
from joint_id_core.arm.description import Description
from joint_id_core.arm.fit import fit_arm
from joint_id_core.arm.regressor import Regressor
from joint_id_core.data.recording import Array
from joint_id_core.design.arm_design import REACH, ArmDesign, design_arm, foreseen
from joint_id_core.design.arm_prior import ArmPrior, from_dict, typical
from joint_id_core.design.fourier import FourierMotion
from joint_id_core.design.limits import JointLimits, violations
from joint_id_core.design.trajectory import Trajectory
from joint_id_core.results.verdict import Verdict
from joint_id_core.rtde.fields import JOINT_NAMES

SECONDS, RATE = 20.0, 125.0
TRIES = 200  # random motions, of which that with the least condition number is taken
GAINS = {name: {"torque": 1.0} for name in JOINT_NAMES}


@dataclass(frozen=True)
class Foreseen:
    """What a motion of one description will tell: mean logarithm of sigma, parameters shown, condition number."""

    size: str
    motion: str
    log_sigma: float
    log_friction: float
    shown: int
    parameters: int
    condition: float
    cpu_s: float


@dataclass(frozen=True)
class Found:
    """What a fit of one true arm found of the designed motion and of the multisine.

    Attributes:
        size, bent: of the arm.
        typical, fitted: errors of all parameters over the promise by typical values, and by a fit of a random motion.
        printed: standard deviations that the fit printed over the promise by typical values.
        errors, multisine: errors of the fit of the designed motion, and of the multisine.
        friction: how many of the last parameters are those of friction.
    """

    size: str
    bent: bool
    typical: tuple[float, ...]
    fitted: tuple[float, ...]
    printed: tuple[float, ...]
    errors: tuple[float, ...]
    multisine: tuple[float, ...]
    friction: int = 12


def run(numbers: Iterable[int], arms: int) -> Iterator[tuple[list[Foreseen], list[Found]]]:
    """Yield what becomes of descriptions, and of their true arms; half of these have friction that bends."""
    for number in numbers:
        size = tuple(SIZES)[number % len(SIZES)]
        described = Described.drawn(size, number)
        description, limits = described.description(), described.limits()
        regressor, prior = Regressor(description), typical(Regressor(description), limits)
        begin = time.process_time()
        designed = design_arm(description, limits, prior, HOME, SECONDS, RATE)
        cpu_s = time.process_time() - begin
        held = near(limits, REACH)
        others = {
            "multisine, 1 to 3 Hz": drawn(held, np.arange(1.0, 3.01, 0.2), number),
            "random, 0.1 to 2 Hz": drawn(held, TONES, number),
            f"least condition number of {TRIES} random": least_condition(regressor, held, number),
        }
        for motion in others.values():
            assert not violations(motion, held), "the motions beside it keep the limits, too"
        rows = [_foreseen(size, "designed", designed, cpu_s)]
        promises = {name: foreseen(regressor, motion, prior) for name, motion in others.items()}
        rows += [_foreseen(size, name, promise, 0.0) for name, promise in promises.items()]
        motions = others["multisine, 1 to 3 Hz"], others["random, 0.1 to 2 Hz"]
        found = [
            _found(described, description, regressor, designed, motions, 1000 * number + k, bool(k % 2))
            for k in range(arms)
        ]
        yield rows, found


TONES = np.geomspace(0.1, 2.0, 10)


def drawn(limits: JointLimits, tones: Array, seed: int) -> Trajectory:
    """Return a random motion with these tones, each joint as large as its limits allow."""
    rng = np.random.default_rng([seed, 4])
    cosines, sines = rng.standard_normal((2, 6, len(tones))) / tones**2
    motion = FourierMotion(JOINT_NAMES, HOME, cosines, sines, tones, SECONDS, 2.0)
    state = motion.at(np.linspace(0.0, SECONDS, 5001))
    room = np.minimum(limits.upper - HOME, HOME - limits.lower)
    peaks = [np.abs(state.position - HOME).max(axis=0) / room]
    peaks += [np.abs(getattr(state, k)).max(axis=0) / getattr(limits, k) for k in ("velocity", "acceleration", "jerk")]
    share = 0.98 / np.max(peaks, axis=0)[:, None]
    return replace(motion, cosines=share * cosines, sines=share * sines).sampled(RATE)


def least_condition(regressor: Regressor, limits: JointLimits, seed: int) -> Trajectory:
    """Return that of random motions whose base regressor has the least condition number, as other tools choose."""
    best, least = None, np.inf
    for k in range(TRIES):
        motion = drawn(limits, TONES, 10_000 * (seed + 1) + k)
        some = slice(None, None, round(RATE / 8.0))
        rows = regressor.rows(motion.position[some], motion.velocity[some], motion.acceleration[some])[0]
        condition = float(np.linalg.cond(rows.reshape(-1, rows.shape[2])))
        if condition < least:
            best, least = motion, condition
    assert best is not None
    return best


def _deviations(found: ArmDesign, regressor: Regressor) -> Array:
    """Return promised standard deviations: base parameters, damping, Coulomb friction."""
    rows = {(row.joint, row.name): row.std_dev for row in found.expected}
    base = [rows["", text] for text in regressor.combinations]
    return np.array(base + [rows[name, kind] for kind in ("damping", "friction") for name in JOINT_NAMES])


def _foreseen(size: str, motion: str, found: ArmDesign, cpu_s: float) -> Foreseen:
    sigma = np.array([row.std_dev for row in found.expected if row.name != "armature"])
    friction = np.array([row.std_dev for row in found.expected if row.name in ("damping", "friction")])
    shown = sum(row.verdict is Verdict.ESTIMATED for row in found.expected if row.name != "armature")
    logs = (float(np.nanmean(np.log(values))) for values in (sigma, friction))
    return Foreseen(size, motion, *logs, shown, len(sigma), found.condition, cpu_s)


def _fitted(found: ArmEstimate) -> tuple[Array, Array]:
    """Return values and standard deviations in the order of `_deviations`."""
    base = [(p.value, p.std_dev) for p in found.parameters]
    damping = [(j.damping.value, j.damping.std_dev) for j in found.joints]
    values, sigma = np.array(base + damping + [(j.friction.value, j.friction.std_dev) for j in found.joints]).T
    return values, sigma


def _found(
    described: Described,
    description: Description,
    regressor: Regressor,
    designed: ArmDesign,
    motions: tuple[Trajectory, Trajectory],
    seed: int,
    bent: bool,
) -> Found:
    """Let a true arm make the multisine, a random motion that tells of its friction, and the designed one; fit them."""
    arm = TrueArm.drawn(described, regressor, seed, bent)
    plain, before = (
        fit_arm(description, [arm.recorded(motion, seed + 200 * k)], GAINS) for k, motion in enumerate(motions)
    )
    after = fit_arm(description, [arm.recorded(designed.trajectory, seed + 500)], GAINS)
    known: ArmPrior = from_dict(before.to_dict(), JOINT_NAMES, "the fit of the random motion")
    second = _deviations(foreseen(regressor, designed.trajectory, known), regressor)
    values, sigma = _fitted(after)
    promised, errors = _deviations(designed, regressor), values - arm.values
    return Found(
        described.size,
        bent,
        tuple((errors / promised).tolist()),
        tuple((errors / second).tolist()),
        tuple((sigma / promised).tolist()),
        tuple(errors.tolist()),
        tuple((_fitted(plain)[0] - arm.values).tolist()),
    )
