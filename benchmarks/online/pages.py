"""The measured tables of docs/reliability.md."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence

import numpy as np

from online.cases import CASES, MOTIONS
from online.joints import JOINTS
from online.loads import EVERY_S, Loads
from online.long_run import AT_S, LongRun, honesty
from online.watching import FAR, Outcome

COLUMNS = ("said", "right", "wrong", "largest")


def changes_table(outcomes: Sequence[Outcome]) -> str:
    """A table for each model, with a row for each case."""
    return "\n\n".join(_of_model(m, [o for o in outcomes if o.model == m]) for m in JOINTS if _has(outcomes, m))


def _has(outcomes: Sequence[Outcome], model: str) -> bool:
    return any(o.model == model for o in outcomes)


def _of_model(model: str, outcomes: Sequence[Outcome]) -> str:
    head = ["case", *(f"{motion}: {c}" if c == "said" else c for motion in MOTIONS for c in COLUMNS)]
    rows = []
    for case in CASES:
        runs = [[o for o in outcomes if o.case == case.name and o.motion == motion] for motion in MOTIONS]
        reason = JOINTS[model].lacks.get(case.part)
        if reason is not None:
            rows.append([case.name, f"- ({reason})", *["-"] * (2 * len(COLUMNS) - 1)])
        elif any(runs):
            rows.append([case.name, *(cell for some in runs for cell in _cells(some, case.name == "nothing"))])
    counts = Counter((o.case, o.motion) for o in outcomes).values()
    least, most = min(counts), max(counts)
    joints = f"{most} joint{'s' * (most > 1)}" if least == most else f"{least} to {most} joints"
    return f"`{model}`, {joints} a case:\n\n{_table(head, rows)}"


def _cells(runs: Sequence[Outcome], nothing: bool) -> list[str]:
    """Median and worst time in s, and the largest error over sigma."""
    if not runs:
        return ["-"] * len(COLUMNS)
    raised = sum(bool(o.raised) for o in runs)
    said = _times([o.said for o in runs])
    if nothing:
        alarms = sum(np.isfinite(o.said) or o.early for o in runs)
        said = f"{alarms} of {len(runs)}" if alarms else "never"
    worst = max(runs, key=lambda o: o.largest)
    largest = f"{worst.largest:.2g} {f'`{worst.worst}`' if worst.largest > FAR else ''}".strip() if worst.worst else "-"
    if raised:
        largest += f"; {raised} ended by an error"
    return [said, _times([o.right for o in runs]), _times([o.wrong_s for o in runs]), largest]


def _times(times: Sequence[float]) -> str:
    """The median, and the largest where it is another."""
    middle, last = float(np.median(times)), max(times)
    return _time(middle) if _time(middle) == _time(last) else f"{_time(middle)} ({_time(last)})"


def _time(seconds: float) -> str:
    return f"{seconds:.1f}" if np.isfinite(seconds) else "never"


def loads_table(runs: Sequence[Loads]) -> str:
    """Shares of the estimates while loads come and go, and how long one is wrong: medians of joints and the worst."""
    head = ["model", "a change every", "joints", "right", "wrong", "longest, s"]
    rows = []
    for model, every in dict.fromkeys((m, every) for m in JOINTS for every in EVERY_S):
        some = [r for r in runs if (r.model, r.every_s) == (model, every)]
        if some:
            right, wrong = [r.right for r in some], [r.wrong for r in some]
            shares = [f"{np.median(right):.0%} ({min(right):.0%})", f"{np.median(wrong):.0%} ({max(wrong):.0%})"]
            rows.append([f"`{model}`", f"{every:g} s", str(len(some)), *shares, _times([r.longest_s for r in some])])
    return _table(head, rows)


def long_table(runs: Sequence[LongRun]) -> str:
    """Errors over sigma and false alarms of joints that do not change."""
    head = ["model", "motion", "after", "joints", "rms error / sigma", "coverage", "mean"]
    rows, alarms = [], []
    for model, motion in dict.fromkeys((m, motion) for m in JOINTS for motion in MOTIONS):
        some = [r for r in runs if (r.model, r.motion) == (model, motion)]
        for at in AT_S:
            found = honesty(some, at)
            if found is None:
                continue
            ratio = f"{_range(found.ratio)} (`{found.worst}`)"
            rows.append([f"`{model}`", motion, f"{at:g} s", str(found.joints), ratio, _range(found.coverage),
                         f"{found.mean:.3f}"])  # fmt: skip
        if some:
            hours = sum(r.seconds for r in some) / 3600.0
            late = [1.0 - r.not_converged for r in some]
            alarms.append([f"`{model}`", motion, f"{hours:.2g}", str(sum(len(r.alarms) for r in some)),
                           f"{100.0 * float(np.mean(late)):.1f} %", f"{max(r.largest for r in some):.1f}"])  # fmt: skip
    head_2 = ["model", "motion", "hours", "false alarms", "converged", "largest error / sigma"]
    return f"{_table(head, rows)}\n\n{_table(head_2, alarms)}"


def _range(ends: tuple[float, float]) -> str:
    return f"{ends[0]:.2f} to {ends[1]:.2f}"


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    return "\n".join(f"| {' | '.join(line)} |" for line in [head, ["---"] * len(head), *rows])
