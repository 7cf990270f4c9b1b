"""The methods side by side."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import combinations

import numpy as np

from robots.arm_peers.found import Found, Method
from robots.arm_peers.runs import OURS
from robots.judging import Pairs, agree
from robots.pages import table

HEAD = ("method", "logs fitted", "held-out R², whole logs", "held-out R², in motion", "pairs that agree",
        "of the worst joint", "median sigma", "links, kg", "least rotor, kg m²", "a fit", "by ours")  # fmt: skip


def peers_table(methods: Sequence[Method]) -> str:
    """A row for each method; R2 of the joints one after the other, the least of all logs that a fit did not see."""
    ours = [f.cpu_s for m in methods if m.name.startswith(OURS) for f in m.fits]
    unit = float(np.median(ours)) if ours else float("nan")
    return table(HEAD, [_row(method, unit) for method in methods])


def _row(method: Method, unit: float) -> list[str]:
    fits = method.fits
    infinite = sorted(f.infinite for f in fits)
    told = [f"{infinite[0]} to {infinite[-1]} of its intervals infinite"] if any(infinite) else []
    notes = dict.fromkeys(filter(None, [*(f.note for f in fits), *told, method.failed]))
    if not fits:
        return [method.name, "; ".join(notes), *["-"] * (len(HEAD) - 2)]
    by_joint = pairs_by_joint(fits)
    worst = min(range(len(by_joint)), key=lambda j: by_joint[j].share if by_joint[j].count else np.inf)
    seconds = float(np.median([f.cpu_s for f in fits]))
    masses = [mass for f in fits for mass in f.masses]
    rotors = [rotor for f in fits for rotor in f.rotors if np.isfinite(rotor)]
    together = sum(by_joint, Pairs())
    return [
        method.name,
        "; ".join([str(len(fits)), *notes]),
        _joints(least(f.whole for f in fits)),
        _joints(least(f.moving for f in fits)),
        f"{together.agree} of {together.count}",
        f"{by_joint[worst].agree} of {by_joint[worst].count} (joint {worst + 1})",
        f"{100.0 * relative_sigma(fits):.2g} %",
        f"{min(masses):.2g} to {max(masses):.3g}" if masses else "-",
        f"{min(rotors):.3g}" if rotors else "-",
        f"{seconds:.2g} s",
        f"{seconds / unit:.3g}",
    ]


def pairs_by_joint(fits: Sequence[Found]) -> list[Pairs]:
    """Of each joint, pairs of fits whose damping and friction agree, where both are known."""
    count = len(next(iter(fits[0].friction.values())))
    found = [Pairs()] * count
    for j in range(count):
        for name in fits[0].friction:
            known = [v for v in (f.friction[name][j] for f in fits) if np.isfinite(v.sigma)]
            found[j] += Pairs(sum(agree(a, b) for a, b in combinations(known, 2)), len(known) * (len(known) - 1) // 2)
    return found


def relative_sigma(fits: Sequence[Found]) -> float:
    """Median standard deviation over value, of damping and friction where they are known."""
    shares = [v.sigma / abs(v.value) for f in fits for some in f.friction.values() for v in some if v.value]
    return float(np.nanmedian(shares))


def least(scores: Iterable[Mapping[str, Sequence[float]]]) -> list[float]:
    """The smallest R2 of each joint."""
    return np.min([values for by_log in scores for values in by_log.values()], axis=0).tolist()


def _joints(values: Sequence[float]) -> str:
    return " ".join(f"{value:.3f}".replace("0.", ".", 1) for value in values)
