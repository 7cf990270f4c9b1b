"""Intervals that contain what the equations lack: torques that the model has not, and a drive that is late.

The covariance of a regression reckons with residuals of chance. A torque that goes with the motion, and that the model
lacks, leaves the same residual in every period, so it moves the values far beyond such intervals: a spring of a cable
took 4 % off the inertia of a simulated joint, 12 standard deviations, and 99.9 % of the torque were explained. So each
torque that a model may lack is fitted beside its parameters (Breusch & Pagan, Rev. Econ. Stud. 47, 1980, test so), and
what its omission changes of them, which is its regression on their columns, is added to their intervals if the data
show it.

What the model has of the same kind is the part of such a torque that looks like it, and stays: Coulomb and viscous
friction are the straight line that is nearest to another law over the speeds of the recording, and a constant offset is
the mean of a load that goes with the angle.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from joint_id_core.checking.shift import Shift
from joint_id_core.data.recording import Array
from joint_id_core.estimators.regression.equations import Equation
from joint_id_core.estimators.regression.least_squares import Solution
from joint_id_core.estimators.regression.missing import COMPLIANCE, EYRING, GRAVITY, HELPS, STRIBECK, share_predicted

SHOWN = 4.0  # standard deviations from which a torque counts, though it may predict new samples no better
TOLD = 0.05  # what it changes of a value, over the value, from which the user is told
CONTAINED = "the standard deviations contain what that may do"
WORDS = {
    COMPLIANCE: COMPLIANCE,
    GRAVITY: f"a load that goes with the angle ({GRAVITY})",
    STRIBECK: f"friction that changes at low speed ({STRIBECK})",
    EYRING: f"friction that bends with speed ({EYRING})",
}


def with_lacking(
    found: Solution, equation: Equation, y: Array, columns: Array, lacked: Mapping[str, Array],
    ask: Callable[[Array, Array], Solution],
) -> Solution:  # fmt: skip
    """Return a solution whose intervals contain what torques that the model lacks change, if the data show them.

    Args:
        found: of the equation.
        equation: whose parameters these are.
        y, columns: of it in the band, shapes (T,) and (T, k).
        lacked: columns (T, m) of torques, by the option that adds them.
        ask: solves an equation y = columns with more columns.
    """
    count = len(equation.names)
    inertia = np.array([n == equation.inertia for n in equation.names])
    same = {STRIBECK: ~inertia & ~equation.static, EYRING: ~inertia & ~equation.static, GRAVITY: equation.static}
    before, free = np.sqrt(np.diag(found.covariance)), ~found.unseen & ~found.held
    total, told = np.zeros(count), list[str]()
    for option, more in lacked.items():
        if not more.any(axis=0).all():
            continue
        other = ask(y, np.column_stack([columns, more]))
        with np.errstate(divide="ignore", invalid="ignore"):
            size = np.abs(other.values[count:]) / np.sqrt(np.diag(other.covariance)[count:])
        better = share_predicted(y, columns[:, ~found.unseen], more) > HELPS
        if not better and not (size > SHOWN).any():
            continue
        bias = np.zeros(count)
        bias[free] = np.abs(np.linalg.lstsq(columns[:, free], more @ other.values[count:], rcond=None)[0])
        bias[same.get(option, np.zeros(count, dtype=bool))] = 0.0
        total = np.maximum(total, bias)
        matters = (bias > TOLD * np.abs(found.values)) & (bias > before)
        if (better and option != COMPLIANCE) or matters.any():
            told.append(WORDS[option])
    said = f"the residuals show {' and '.join(told)}; {CONTAINED}" if told else ""
    return with_doubt(found, total, said)


def with_late_drive(found: Solution, late: Shift, y: Array, columns: Array) -> Solution:
    """Return a solution whose intervals contain what a drive that is `late` changes of y (T,) = columns (T, k).

    Columns may follow those of the parameters that were fitted beside them.
    """
    changes = np.abs(late.factors - np.linalg.lstsq(columns, y, rcond=None)[0])[: len(found.values)]
    # one that is held at its bound may be off by all that the drive in time says of it
    changes = np.where(found.held, np.abs(late.factors[: len(found.values)]), changes)
    return with_doubt(found, np.where(found.unseen, 0.0, changes))


def with_doubt(found: Solution, doubt: Array, said: str = "") -> Solution:
    """Return a solution whose intervals contain a doubt (k,), with the reason as a clause."""
    if not doubt.any() and not said:
        return found
    reasons = (*found.reasons, said) if said else found.reasons
    covariance = found.covariance + np.diag(doubt**2)
    return replace(found, covariance=covariance, doubt=np.hypot(found.doubt, doubt), reasons=reasons)
