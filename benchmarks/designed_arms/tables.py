"""The tables of docs/benchmarks.md about designed motions of arms."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from designed_arms.runs import Foreseen, Found
from joint_id_core.data.recording import Array


def table(rows: Sequence[Foreseen], found: Sequence[Found]) -> str:
    """Return both tables: what motions promise, and what became of the promise."""
    return f"{_motions(rows)}\n\n{_kept(found)}"


def _motions(rows: Sequence[Foreseen]) -> str:
    """Return a row a motion: standard deviations over those of the designed one, as geometric means."""
    lines = [
        "| motion of 20 s | std dev over that of the designed one | of friction alone | parameters shown of all "
        "| condition number | design, CPU s |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    designed = [row for row in rows if row.motion == "designed"]
    for motion in dict.fromkeys(row.motion for row in rows):
        own = [row for row in rows if row.motion == motion]
        pairs = list(zip(own, designed, strict=True))
        worse = np.exp(np.mean([a.log_sigma - b.log_sigma for a, b in pairs]))
        friction = np.exp(np.mean([a.log_friction - b.log_friction for a, b in pairs]))
        condition = np.exp(np.mean([np.log(row.condition) for row in own]))
        cpu = max(row.cpu_s for row in own)
        shown = f"{np.mean([row.shown for row in own]):.0f} of {own[0].parameters}"
        lines.append(
            f"| {motion} | {worse:.2g} | {friction:.2g} | {shown} | {condition:.3g} | {f'{cpu:.1f}' if cpu else '-'} |"
        )
    return "\n".join(lines)


def _kept(found: Sequence[Found]) -> str:
    """Return a row for each kind of arm and promise: realised over promised errors."""
    lines = [
        "| arms | promise from | rms error over promise | of links and rotors | of friction | least and most of a size "
        "| error of the multisine over that of the designed motion |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for bent in (False, True):
        own = [one for one in found if one.bent is bent]
        kind = "friction bends" if bent else "friction is straight"
        gain = np.exp(np.mean(np.log(np.abs(_stack(own, "multisine")) / np.abs(_stack(own, "errors")))))
        for source, name in (("typical values", "typical"), ("a fit of a random motion", "fitted")):
            off, split = _stack(own, name), own[0].friction
            sizes = [_rms(_stack([one for one in own if one.size == size], name)) for size in {o.size for o in own}]
            lines.append(
                f"| {len(own)}, {kind} | {source} | {_rms(off):.2f} | {_rms(off[:, :-split]):.2f} | "
                f"{_rms(off[:, -split:]):.2f} | {min(sizes):.2f}, {max(sizes):.2f} | {gain:.2g} |"
            )
    return "\n".join(lines)


def _stack(found: Sequence[Found], name: str) -> Array:
    """Return what fits of these arms found, shape (arms, parameters); the parameters of sizes are as many."""
    return np.array([getattr(one, name) for one in found])


_rms: Callable[[Array], float] = lambda values: float(np.sqrt(np.nanmean(values**2)))  # noqa: E731  # a formula
