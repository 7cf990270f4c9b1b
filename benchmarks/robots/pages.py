"""The measured tables of docs/real_robots.md."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from robots.cases import CASES
from robots.fitted import FRICTION, Fitted
from robots.judging import farthest, held_out, pairs, relative_sigma, times, usable
from robots.methods import METHODS
from robots.stiffness import BOTH, ESTIMATORS, FOLDER, PUBLISHED, RUNS, SETTINGS, Stiffness, there
from robots.targets import KNOWN, stiffness_verdicts, verdicts

ABSENT = "skipped: `../shared/data/{}` is not there"


def methods_table(fits: Sequence[Fitted]) -> str:
    """A row for each case and method, then for all in which one joint moves alone, then for all."""
    head = ["recordings", "method", "usable", "pairs that agree", "median sigma", "pairs of `J`",
            "friction off", "`J` off", "held-out R², least", "a fit, longest"]  # fmt: skip
    rows = []
    for case in CASES:
        some = [f for f in fits if f.case == case.name]
        rows += _of_methods(case.name, some)
        if not some and not case.there:
            rows.append([case.name, ABSENT.format(case.folder), *["-"] * (len(head) - 2)])
    alone = {case.name for case in CASES if case.alone}
    rows += _of_methods("**all with one joint moving**", [f for f in fits if f.case in alone])
    rows += _of_methods("**all**", fits)
    return table(head, rows)


def _of_methods(name: str, fits: Sequence[Fitted]) -> list[list[str]]:
    by_method = ((method, [f for f in fits if f.method == method]) for method in METHODS)
    return [[name, method, *_cells(some)] for method, some in by_method if some]


def _cells(fits: Sequence[Fitted]) -> list[str]:
    known, count = usable(fits)
    middle, longest = times(fits)
    friction, inertia = (farthest(fits, KNOWN, names) for names in (FRICTION, ("J",)))
    r_squared, least = held_out(fits)
    sigma = relative_sigma(fits)
    return [
        f"{known} of {count}",
        _pairs(fits, FRICTION, True),
        f"{100.0 * sigma:.2g} %" if np.isfinite(sigma) else "-",
        _pairs(fits, ("J",), False),
        f"{friction.sigmas:+.2g} (`{friction.name}`)" if friction.fit else "-",
        f"{inertia.sigmas:+.2g}" if inertia.fit else "-",
        f"{r_squared:.3f}, {least:.3f}" if np.isfinite(r_squared) else "-",
        f"{_ms(middle)}, {_ms(longest)} ms",
    ]


def _ms(seconds: float) -> str:
    return f"{1e3 * seconds:.0f}" if seconds >= 0.01 else f"{1e3 * seconds:.1f}"


def _pairs(fits: Sequence[Fitted], names: Sequence[str], friction: bool) -> str:
    found = pairs(fits, names, friction)
    return f"{found.agree} of {found.count}" if found.count else "-"


def joints_table(fits: Sequence[Fitted]) -> str:
    """A row for each joint of the cases in which all joints move: the mean hides that errors are opposite."""
    head = ["recordings", "joint", *METHODS]
    rows = []
    for case in CASES:
        if case.alone or not any(f.case == case.name for f in fits):
            continue
        for joint in case.joints:
            some = [f for f in fits if (f.case, f.joint) == (case.name, joint.name)]
            rows.append([case.name, joint.name, *(_of_joint([f for f in some if f.method == m]) for m in METHODS)])
    return table(head, rows)


def _of_joint(fits: Sequence[Fitted]) -> str:
    known, count = usable(fits)
    if not known:
        return f"0 of {count} usable"
    off = farthest(fits, KNOWN, FRICTION)
    agree = _pairs(fits, FRICTION, True)
    return f"{known} of {count} usable, {agree} pairs, {off.sigmas:+.2g} (`{off.name}`)"


def stiffness_table(fits: Sequence[Stiffness]) -> str:
    """A row for each way to fit an axis: stiffness and motor inertia from each run, and from both."""
    runs = (*RUNS, BOTH)
    head = ["axis", "published", "settings", "method", *(f"run {r}" for r in RUNS), BOTH, "a fit, longest"]
    if not fits and not there():
        return table(head, [[ABSENT.format(FOLDER), *["-"] * (len(head) - 1)]])
    rows = []
    for axis, published in PUBLISHED.items():
        known = published.get("k_1")
        for name in SETTINGS:
            for method in ESTIMATORS:
                some = {f.run: f for f in fits if (f.axis, f.settings, f.method) == (axis, name, method)}
                rows.append([
                    str(axis), f"{1e-6 * known.value:.3g}" if known else "not identifiable", name, method,
                    *(_axis(some[r]) if r in some else "-" for r in runs),
                    f"{max((f.cpu_s for r, f in some.items() if r != BOTH), default=0.0):.1f} s",
                ])  # fmt: skip
    return table(head, rows)


def _axis(f: Stiffness) -> str:
    k, inertia = f.values["k_1"], f.values.get("J_m")
    said = f"{1e-6 * k.value:.2g} ± {1e-6 * k.sigma:.2g}" if np.isfinite(k.sigma) else "-"
    said = f"`{f.status}`; {said} `{k.verdict}`"
    return f"{said}; {inertia.value:.3g} ± {inertia.sigma:.1g} `{inertia.verdict}`" if inertia else said


def targets_table(fits: Sequence[Fitted], stiffness: Sequence[Stiffness]) -> str:
    """A row for each target, a column for each method; plain least squares has no model of the motor side."""
    by_method = [verdicts([f for f in fits if f.method == method]) for method in METHODS]
    rows = [[cells[0][0], *(said for _, said in cells)] for cells in zip(*by_method, strict=True)]
    by_axis = {m: dict(stiffness_verdicts([f for f in stiffness if f.method == m])) for m in METHODS}
    targets = dict.fromkeys(target for found in by_axis.values() for target in found)
    rows += [[target, *(by_axis[m].get(target, "-") for m in METHODS)] for target in targets]
    return table(["target", *METHODS], rows)


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table in Markdown."""
    return "\n".join(f"| {' | '.join(line)} |" for line in [head, ["---"] * len(head), *rows])
