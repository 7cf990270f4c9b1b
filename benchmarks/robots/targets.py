"""What the figures are compared with."""

from __future__ import annotations

from collections.abc import Sequence

from robots.cases import CASES
from robots.fitted import FRICTION, Fitted
from robots.judging import Off, Pairs, farthest, pairs, relative_sigma, usable
from robots.stiffness import BOTH, DOCUMENTED, PUBLISHED, Stiffness

COVERAGE = (0.85, 0.98)
SIGMA = 0.05
USABLE = 0.9
FRICTION_OFF = 2.0  # combined standard deviations
GOOD_OFF = 4.0
STIFFNESS_OFF = 0.3
KNOWN = {(case.name, joint.name): dict(joint.known) for case in CASES for joint in case.joints}
ALONE = {case.name for case in CASES if case.alone}
OF_URDF = {case.name for case in CASES if "URDF" in case.name}
UR10E = {case.name for case in CASES if case.folder == "ur10e"} - OF_URDF


def verdicts(fits: Sequence[Fitted]) -> list[tuple[str, str]]:
    """Targets and what the fits of one method come to, with "met" or "missed"; no row without a fit."""
    if not fits:
        return []
    alone = [f for f in fits if f.case in ALONE]
    known, count = usable(alone)
    sigma, covered = relative_sigma(alone), pairs(alone)
    friction, of_urdf = (farthest([f for f in fits if f.case in some], KNOWN, FRICTION) for some in (UR10E, OF_URDF))
    good = farthest(fits, KNOWN, ("J", *FRICTION), good=True)
    loaded = [("the same with the load of the stock URDF", _said(_off(of_urdf), abs(of_urdf.sigmas) <= FRICTION_OFF))]
    return [
        (
            f"one joint moves: {COVERAGE[0]:g} to {COVERAGE[1]:g} of the pairs agree",
            _said(_pairs(covered), COVERAGE[0] <= covered.share <= COVERAGE[1]),
        ),
        (f"their median sigma is below {100 * SIGMA:g} %", _said(f"{100 * sigma:.2g} %", sigma < SIGMA)),
        (
            f"{100 * USABLE:g} % of these fits are usable",
            _said(f"{known} of {count}", bool(count) and known >= USABLE * count),
        ),
        (
            f"UR10e: friction within {FRICTION_OFF:g} combined sigma of the reference",
            _said(_off(friction), abs(friction.sigmas) <= FRICTION_OFF),
        ),
        *(loaded if of_urdf.fit is not None else []),
        (
            f"nothing that is called good is more than {GOOD_OFF:g} sigma off",
            _said(_off(good), abs(good.sigmas) <= GOOD_OFF),
        ),
    ]


def stiffness_verdicts(fits: Sequence[Stiffness]) -> list[tuple[str, str]]:
    """The same of the stiffness, by one method; no row without a fit."""
    rows: list[tuple[str, str]] = []
    if not fits:
        return rows
    for axis, published in PUBLISHED.items():
        some = [f for f in fits if f.axis == axis]
        if "k_1" not in published:
            called = sum(f.status == "converged" and f.values["k_1"].verdict == "estimated" for f in some)
            text = f"{called} of {len(some)} fits call it estimated"
            rows.append((f"KUKA axis {axis}: stiffness not identifiable", _said(text, not called)))
            continue
        target = f"KUKA axis {axis}: within {100 * STIFFNESS_OFF:g} % of the published stiffness, by the command below"
        for f in (f for f in some if (f.settings, f.run) == (DOCUMENTED, BOTH)):
            k = f.values["k_1"]
            off = k.value / published["k_1"].value - 1.0
            good = f.status == "converged" and k.verdict == "estimated"
            text = f"{1e-6 * k.value:.3g} ± {1e-6 * k.sigma:.2g}e6 ({100.0 * off:+.0f} %, `{f.status}`)"
            rows.append((target, _said(text, good and abs(off) <= STIFFNESS_OFF)))
    wrong = [(f, n, z) for f in fits for n, z in f.called_good]
    fit, name, z = max(wrong, key=lambda row: abs(row[2]), default=(None, "", 0.0))
    beyond = f"{sum(abs(row[2]) > GOOD_OFF for row in wrong)} of {len(wrong)}"
    text = f"`{name}` of axis {fit.axis}, {z:+.2g}; {beyond}" if fit else "nothing is called good"
    target = f"KUKA: nothing that is called good is more than {GOOD_OFF:g} sigma off"
    rows.append((target, _said(text, abs(z) <= GOOD_OFF)))
    return rows


def _said(text: str, met: bool) -> str:
    return f"{text}: {'met' if met else '**missed**'}"


def _pairs(found: Pairs) -> str:
    return f"{found.share:.2f} ({found.agree} of {found.count})"


def _off(found: Off) -> str:
    if found.fit is None:
        return "no value with a reference"
    return f"{found.sigmas:+.2g} (`{found.name}`, {found.fit.joint}, {100.0 * found.share:+.0f} %)"
