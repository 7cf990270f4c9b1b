"""Which single fault of its signals explains what the equation of a motor leaves: the drive, or one of two encoders.

Each fault is put right by itself, by the size that leaves least. One is told only if that leaves a small part of what
was left before, and no other one does. So what the model lacks is not taken for a fault of the signals. A wrong ratio
makes the twist of the gear look larger than it is; one that would make it smaller only stands for a load.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy

from joint_id_core.data.recording import Array, Recording
from joint_id_core.estimators.regression.changed_gain import change_of
from joint_id_core.estimators.regression.encoder_lag import encoder_lag
from joint_id_core.estimators.regression.motor_equation import MotorEquation, left, motor_equation
from joint_id_core.estimators.regression.path import of_motor
from joint_id_core.estimators.regression.signals import Rows

LEFT = 0.2  # share of what is left, which is left without the fault
LITTLE = 5e-4  # share of the drive that is left at least with the fault; less matters to no fit
OTHERS = 2.0  # times that is left at least without any other fault
EXPLAINED = 0.985  # of the drive at least, without the fault; of axes of a KUKA with late encoders 0.991 to 0.996
BETWEEN = 0.5  # samples by which a drive is late that changes between two samples
LATE_SAMPLES, LATE_S = 0.75, 1e-3  # least lags beside that
LONGEST_DRIVE_S, LONGEST_LINK_S = 0.03, 0.012  # that are looked for
CHANCE = 3.0  # standard deviations of the longest lag that the twist allows
DOUBT = 0.5  # share of that lag which these may be
SCALE = 0.004  # least relative error of the ratio: an eccentric disc of an encoder makes 0.001
MOST_SCALE = 0.03  # by which the positions may show another ratio than the best one
POINTS = 49  # sizes that are tried first


@dataclass(frozen=True)
class Fault:
    """What is left of the drive without a fault, and the fault in words; empty if it is too small to matter."""

    left: float
    text: str


def side_fault(recording: Recording, drive: str, ratio: float) -> str:
    """Return which fault explains a recording of a joint with two encoders; empty if none does, or several do.

    Args:
        recording: what was measured.
        drive: torque or current of the motor.
        ratio: of the gear, as the model has it.
    """
    equation = motor_equation(recording, drive, ratio)
    if equation is None:
        return ""
    columns, between = equation.columns(ratio), BETWEEN * recording.period
    held, mean = (left(equation.known(late), columns) for late in (0.0, between))
    base, before = (0.0, held) if held < mean else (between, mean)
    if before < LITTLE:
        return ""
    y, found = equation.known(base), []
    late, rest = _best(lambda late: left(equation.known(late), columns), 0.0, LONGEST_DRIVE_S)
    least = max(LATE_SAMPLES * recording.period, LATE_S)
    apart = late - float(np.clip(late, 0.0, between))
    found.append(Fault(rest, _drive_text(late, drive) if abs(apart) >= least else ""))
    late, rest = _late_link(equation, y, ratio)
    found.append(Fault(rest, _link_text(late) if abs(late) >= LATE_S else ""))
    shown, rest = _best(lambda n: left(y, equation.columns(n)), equation.ratio, MOST_SCALE * abs(equation.ratio))
    wrong = abs(shown / ratio - 1.0) >= SCALE and equation.twist(shown) < equation.twist(ratio)
    found.append(Fault(rest, _ratio_text(shown, ratio) if wrong else ""))
    found.append(Fault(left(-y, columns), _sign_text(drive)))
    change = change_of(equation.time[equation.index], y, columns)
    if change is not None:
        found.append(Fault(change.left, change.text(equation.time[0], drive)))
    best, second = sorted(found, key=lambda fault: fault.left)[:2]
    if best.left > min(LEFT * before, 1.0 - EXPLAINED) or second.left < OTHERS * best.left:
        return ""
    return best.text


def _late_link(equation: MotorEquation, y: Array, ratio: float) -> tuple[float, float]:
    """Return how late the link's encoder is in s, and what is left of y (R,) without that.

    A linear spring of a link that is later looks like more friction of the motor, which gives no upper limit. The twist
    does: it looks later than it is by what viscous friction of the link adds.
    """
    rows = Rows(equation.index, np.zeros_like(equation.index))
    twist = encoder_lag(equation.time, equation.moved, of_motor(equation.moved, ratio), ratio, rows, equation.band_hz)
    longest = min(twist.late + CHANCE * twist.sigma, LONGEST_LINK_S)
    middle, reach = 0.5 * (longest - LONGEST_LINK_S), 0.5 * (longest + LONGEST_LINK_S)
    if not reach > 0.0 or CHANCE * twist.sigma > DOUBT * abs(twist.late):
        return 0.0, 1.0

    def size(late: float) -> float:
        return left(y, equation.columns(ratio, late))

    found = _best(size, middle, reach, beyond=longest)[0]
    late = min(found, max(twist.late, 0.0))
    if OTHERS * size(found) < size(late):  # a spring that is not linear tells it better than the twist
        late = found
    return late, size(late)


def _best(size: Callable[[float], float], middle: float, reach: float, beyond: float = np.inf) -> tuple[float, float]:
    """Return the value within `reach` of `middle` for which `size` is smallest, and that size; 1 if it may lie outside.

    Beyond the value `beyond` nothing is possible.
    """
    values = np.linspace(middle - reach, middle + reach, POINTS)
    sizes = [size(float(value)) for value in values]
    k = int(np.argmin(sizes))
    if k == 0 or (k == POINTS - 1 and values[k] < beyond):
        return float(values[k]), 1.0
    ends = (values[k - 1], values[min(k + 1, POINTS - 1)])
    found = scipy.optimize.minimize_scalar(size, bounds=ends, method="bounded")
    return (float(found.x), float(found.fun)) if found.fun < sizes[k] else (float(values[k]), sizes[k])


def _when(late: float) -> str:
    return f"{1e3 * abs(late):.2g} ms {'late' if late > 0.0 else 'early'}"


def _drive_text(late: float, drive: str) -> str:
    return f"the {drive} is {_when(late)} against both encoders: correct its times"


def _link_text(late: float) -> str:
    return (
        f"the link's encoder is {_when(late)} against the motor's and the drive: take a model with delays (--delays), "
        "or correct its times"
    )


def _sign_text(drive: str) -> str:
    return f"the {drive} acts against the motion: its sign is wrong (--map {drive}=-1*COLUMN)"


def _ratio_text(shown: float, ratio: float) -> str:
    return (
        f"motor_position goes {shown:.4g} times as far as link_position, beside the twist of the gear, and the gear "
        f"ratio N is {ratio:.4g}: correct N (--set N={shown:.4g}), or a factor of the positions "
        f"(--map link_position={shown / ratio:.4g}*COLUMN)"
    )
