"""Processor time of a fit of a model that a recording does not bear out, beside that of a good fit of the recording."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

from joint_id_core.data.recording import Recording
from joint_id_core.estimators import ParameterSettings, fit
from joint_id_core.models import build
from joint_id_core.results.estimate import Estimate
from robots.recordings import DATA, RATIO, UR10E_ALL, emps, kuka, ur3e_both_sides, ur10e_both_sides

WRONG = "harmonic_drive"
MOST = 20.0  # of the time of a good fit


@dataclass(frozen=True)
class Case:
    """A recording, the model that suits it with its options, and what both models are told."""

    name: str
    folder: str
    recorded: Callable[[], tuple[Recording, Mapping[str, float]]]
    good: str = "rigid_joint"
    gravity: bool = False
    delays: bool = False


@dataclass(frozen=True)
class Row:
    """Status and processor time in s of both fits of a recording."""

    name: str
    good: str
    good_status: str
    good_s: float
    wrong_status: str
    wrong_s: float

    @property
    def ratio(self) -> float:
        """Time of the fit of the wrong model over that of the good one."""
        return self.wrong_s / self.good_s


def _ur10e(name: str, joint: int) -> tuple[Recording, Mapping[str, float]]:
    return ur10e_both_sides(name, joint), {"N": RATIO}


def _ur3e(joint: int) -> tuple[Recording, Mapping[str, float]]:
    return ur3e_both_sides(joint), {"N": RATIO}


def _kuka(axis: int) -> tuple[Recording, Mapping[str, float]]:
    ratio, recording = kuka("A", axis)
    return recording, {"N": ratio}


ALONE = "UR10e, joint {0} moves"
CASES = (
    *(Case(ALONE.format(k), "ur10e", partial(_ur10e, f"ur-20_01_22-joint_{k}", k), gravity=k > 1) for k in (1, 4)),
    *(Case(f"UR10e, all joints move, joint {k}", "ur10e", partial(_ur10e, UR10E_ALL[0], k)) for k in range(1, 7)),
    Case("UR3e, shoulder moves", "ur3e", partial(_ur3e, 1), gravity=True),
    *(Case(f"UR3e, shoulder moves, joint {k + 1}", "ur3e", partial(_ur3e, k), "motor_side") for k in (0, 2, 3, 4)),
    *(Case(f"KUKA, axis {k}", "kuka_kr300", partial(_kuka, k), "motor_side", delays=True) for k in (1, 2, 3)),
    Case("EMPS, linear axis", "emps", lambda: (emps(), {})),
)


def rows(cases: Sequence[Case] = CASES) -> Iterator[Row]:
    """Both fits of each recording that is there, after one that compiles or loads."""
    loaded: set[tuple[str, bool]] = set()
    for case in cases:
        if not (DATA / case.folder).is_dir():
            continue
        recording, values = case.recorded()
        loads = {WRONG, case.good} - {name for name, gravity in loaded if gravity == case.gravity}
        for name in loads:
            _timed(case, name, recording.slice(0, 500), values)
            loaded.add((name, case.gravity))
        good, good_s = _timed(case, case.good, recording, values)
        wrong, wrong_s = _timed(case, WRONG, recording, values)
        yield Row(case.name, case.good, good.status.value, good_s, wrong.status.value, wrong_s)


def _timed(case: Case, name: str, recording: Recording, values: Mapping[str, float]) -> tuple[Estimate, float]:
    """A fit, and its processor time in s."""
    options = {"gravity": case.gravity} if name != "motor_side" else {"delays": case.delays}
    model = build(name, **options)
    known = {n: v for n, v in values.items() if n in model.parameter_names}
    if name == "rigid_joint":
        recording, known = _at_link(recording, values), {}
    begun = time.process_time()
    found = fit(model, recording, ParameterSettings(known))
    return found, time.process_time() - begun


def _at_link(recording: Recording, values: Mapping[str, float]) -> Recording:
    """A recording as a rigid joint has it: the torque at the link."""
    channels = {"link_position": recording["link_position"], "torque": values.get("N", 1.0) * recording["torque"]}
    return Recording(recording.time, channels, source=recording.source)


def cells(row: Row) -> list[str]:
    """The cells of a row of the table."""
    good = f"`{row.good}` {row.good_s:.2g} s, `{row.good_status}`"
    return [row.name, good, f"{row.wrong_s:.2g} s, `{row.wrong_status}`", f"{row.ratio:.2g}"]


HEAD = ["recording", "a model that suits it", f"`{WRONG}`", f"ratio (aim {MOST:g})"]
