"""A trajectory as a program for UR robots, which a user reads and starts at the robot.

Sources: Universal Robots, script manual (e-Series, SW 5): movej, servoj, stopj, popup, get_actual_joint_positions;
for the speed slider, documentation of joint_trajectory_controller, "On-Robot speed scaling".
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

import numpy as np

from joint_id_core.design.trajectory import Trajectory
from joint_id_core.errors import JointIdError
from joint_id_core.rtde.fields import JOINT_NAMES

CYCLE_S, CB3_CYCLE_S = 0.002, 0.008  # of the controllers of the e-Series, and of the CB3 series
LOOKAHEAD_S, GAIN = 0.1, 300  # the manual's defaults; ranges 0.03 to 0.2 s and 100 to 2000
SLOW_SPEED, SLOW_ACCELERATION = 0.2, 0.3  # rad/s, rad/s^2, of the move to the start
STOP = 0.5  # rad/s^2, of the stop at the end
SETTLE_S = 0.5  # that the last target is held: the robot lags by the lookahead time
NAME = "joint_id_motion"


def urscript(trajectory: Trajectory, notes: Sequence[str] = ()) -> str:
    """Return the program. Joints that the trajectory does not move stay where they are when it starts.

    Args:
        trajectory: of joints of a UR robot; names may have a prefix, as in `left_elbow_joint`.
        notes: sentences for the comments at its head.

    Raises:
        JointIdError: a joint that no UR robot has, or a sample period that is no multiple of the controller's cycle.
    """
    require_ur_robot(trajectory.names, trajectory.rate)
    columns = [_column(trajectory.names, name) for name in JOINT_NAMES]
    period = round(trajectory.period / CYCLE_S) * CYCLE_S
    targets = [
        "[" + ", ".join(f"stay[{k}]" if c is None else f"{row[c]:.6f}" for k, c in enumerate(columns)) + "]"
        for row in trajectory.position.tolist()
    ]
    hold = round(SETTLE_S / period)
    seconds = f"{trajectory.duration:g}"
    return "\n".join(
        [
            *_comments(trajectory, period, notes),
            f"def {NAME}():",
            *(["  stay = get_actual_joint_positions()"] if None in columns else []),
            f'  popup("joint_id: the robot will move slowly to the start. Is its way free?", {_POPUP})',
            f"  movej({targets[0]}, a={SLOW_ACCELERATION}, v={SLOW_SPEED})",
            f'  popup("joint_id: the motion of {seconds} s comes now. Is the recording on?", {_POPUP})',
            *(f"  servoj({q}, t={period:g}, lookahead_time={LOOKAHEAD_S}, gain={GAIN})" for q in targets[1:]),
            *[f"  servoj({targets[-1]}, t={period:g}, lookahead_time={LOOKAHEAD_S}, gain={GAIN})"] * hold,
            f"  stopj({STOP})",
            "end",
            f"{NAME}()",
            "",
        ]
    )


def require_ur_robot(names: Sequence[str], rate: float) -> None:
    """Check that a motion of these joints, at this rate in Hz, can be written as a program.

    Raises:
        JointIdError: a joint that no UR robot has, or a sample period that is no multiple of the controller's cycle.
    """
    columns = [_column(names, name) for name in JOINT_NAMES]
    if strange := [name for k, name in enumerate(names) if k not in columns]:
        raise JointIdError(
            f"URScript: {strange[0]} is no joint of a UR robot ({', '.join(JOINT_NAMES)}): write .csv or .yaml instead"
        )
    if not _whole(1.0 / (rate * CYCLE_S)):
        raise JointIdError(
            f"URScript: {rate:g} samples a second: the period must be a multiple of {1e3 * CYCLE_S:g} ms, "
            "such as at 125, 250 or 500 Hz"
        )


_POPUP = 'title="joint_id", blocking=True'


def _whole(cycles: float) -> bool:
    return round(cycles) >= 1 and abs(cycles - round(cycles)) <= 1e-6 * cycles


def _column(names: Sequence[str], joint: str) -> int | None:
    """Return the column of a joint of the robot, None if it does not move."""
    found = [k for k, name in enumerate(names) if name.endswith(joint)]
    if len(found) > 1:
        raise JointIdError(f"URScript: {names[found[0]]} and {names[found[1]]} are of two robots: write one for each")
    return found[0] if found else None


def _comments(trajectory: Trajectory, period: float, notes: Sequence[str]) -> list[str]:
    """Return the head of the program: what it does and what to check."""
    state = trajectory.between(2)
    lines = [
        "A motion designed by joint_id. Read all of this before you start it.",
        "",
        f"It moves slowly to the start ({SLOW_SPEED} rad/s), asks, then moves for {trajectory.duration:g} s:",
    ]
    for k, name in enumerate(trajectory.names):
        q = state.position[:, k]
        speed, rate = (float(np.abs(values[:, k]).max()) for values in (state.velocity, state.acceleration))
        lines.append(f"  {name}: {q.min():.3f} to {q.max():.3f} rad, up to {speed:.3f} rad/s and {rate:.3f} rad/s^2")
    lines += [
        f"servoj gets a target every {1e3 * period:g} ms. The robot follows it about {LOOKAHEAD_S:g} s late, softer.",
        "",
        "Before you start it:",
        "  - No collisions were checked: neither of the arm with itself, nor with table, cables, tool or walls.",
        "    Play the motion in a simulator first.",
        "  - Payload and centre of gravity are set as they are.",
        "  - Nobody is near, and a hand is at the emergency stop.",
        "  - The speed slider is at 100 %. With less the robot is late for its targets and leaves the path. For a slow "
        "first try, design a motion with lower limits.",
        *(
            []
            if _whole(period / CB3_CYCLE_S)
            else ["  - The robot is of the e-Series: a CB3 takes targets every 8 ms."]
        ),
        "  - The recording is on when the motion begins.",
        "It ends by itself, and stops softly. It uses no network.",
        *(["", *notes] if notes else []),
    ]
    wrapped = [part for line in lines for part in (textwrap.wrap(line, 110, subsequent_indent="  ") or [""])]
    return [f"# {line}".rstrip() for line in wrapped]
