"""Rank the trials of a comparison, with the reasons in words."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from joint_id_core.comparison.trial import HeldOut, Trial, common_signals, same_data
from joint_id_core.results.estimate import Verdict

ALIKE = 2.0  # difference of BIC "not worth more than a bare mention" (Kass and Raftery, JASA 90, 1995)


@dataclass(frozen=True)
class Row:
    """One row of the ranking.

    Attributes:
        trial: the candidate with its fit and its validation.
        rank: 1 for the first; None if it cannot be compared with the others.
        score: geometric mean of the held-out nrmse of the signals that decide; NaN if it does not predict them.
        delta_bic: BIC minus the lowest BIC of the rows with the same labels, converged ones if there are any; NaN if no
            other row has these labels.
        reason: why it has this rank.
    """

    trial: Trial
    rank: int | None
    score: float
    delta_bic: float
    reason: str


@dataclass(frozen=True)
class Ranking:
    """Result of a ranking.

    Attributes:
        rows: best first.
        signals: signals whose held-out prediction decided.
        notes: notes on all rows.
        conclusion: the result in one sentence.
    """

    rows: tuple[Row, ...]
    signals: tuple[str, ...]
    notes: tuple[str, ...]
    conclusion: str

    @property
    def best(self) -> Trial | None:
        """The candidate that describes the record best; None if none describes it or they cannot be compared."""
        first = self.rows[0]
        return first.trial if first.rank == 1 and first.trial.describes else None


def rank(trials: Sequence[Trial]) -> Ranking:
    """Rank trials.

    First come trials that describe the data they were fitted to, then those that converged to a poor fit or did not
    converge, then those that failed. Within the first two groups the held-out prediction decides, on the signals that
    all of them predict. Trials form a class if their errors differ from the best one of the class by no more than
    chance. Within a class of the first group, BIC decides if all its trials explain the same labels, else the error.
    """
    good = [t for t in trials if t.describes]
    poor = [t for t in trials if t.errors and not t.describes]
    failed = [t for t in trials if not t.errors]
    signals = common_signals(good or poor)
    seen = [t for t in (*good, *poor) if all(name in t.errors for name in signals)]
    judged = HeldOut(seen, signals)
    held_out = judged if judged.signals else None
    classes = _classes(good, held_out)
    ordered = [*(t for together in classes for t in together)]
    ordered += [t for together in _classes([t for t in poor if t in seen], held_out, False) for t in together]
    ordered += [t for t in poor if t not in seen]
    comparable = held_out is not None or _all_same_data(good or poor)
    rows = []
    for k, t in enumerate((*ordered, *failed), 1):
        score = held_out.score(t) if held_out and t in seen else math.nan
        reason = _reason(t, classes, held_out)
        rows.append(Row(t, k if comparable and t.errors else None, score, _delta_bic(t, trials), reason))
    return Ranking(tuple(rows), judged.signals, _notes(trials), _conclusion(rows, classes, held_out))


def _classes(trials: Sequence[Trial], held_out: HeldOut | None, by_bic: bool = True) -> list[list[Trial]]:
    """Return the trials in order, grouped into classes that predict equally well."""
    left = sorted(trials, key=held_out.score) if held_out else list(trials)
    classes = []
    while left:
        best = left[0]
        together = [t for t in left if t is best or held_out is None or not held_out.apart(t, best)]
        left = [t for t in left if t not in together]
        if by_bic and _all_same_data(together):
            together = sorted(together, key=lambda t: t.bic)
        classes.append(together)
    return classes


def _all_same_data(trials: Sequence[Trial]) -> bool:
    return all(same_data(trials[0], t) for t in trials)


def _delta_bic(trial: Trial, trials: Sequence[Trial]) -> float:
    group = [t for t in trials if same_data(trial, t)]
    return trial.bic - min(t.bic for t in ([t for t in group if t.describes] or group)) if len(group) > 1 else math.nan


def _reason(trial: Trial, classes: list[list[Trial]], held_out: HeldOut | None) -> str:
    """Return the reason for the rank of a trial, in words."""
    status = trial.estimate.status
    found = (*trial.estimate.notes, trial.estimate.message)[0]
    text = found[:1].lower() + found[1:].rstrip(".")
    if trial.failure:
        return trial.failure
    if not trial.describes:
        said = text if text.startswith(status.advice) else f"{status.value}: {text}"
        return f"{said}; behind those that describe the record, and its BIC and AIC mean little"
    unseen = [p.name for p in trial.estimate.parameters if p.verdict in (Verdict.NOT_EXCITED, Verdict.PRIOR)]
    aside = f"; this motion does not show its {', '.join(unseen)}" if unseen else ""
    first = classes[0][0]
    if trial is first:
        return _why_first(classes, held_out) + aside
    bic = ""
    if same_data(trial, first):
        above = trial.bic - first.bic
        bic = f", BIC {'higher' if above > 0 else 'lower'} by {abs(above):.3g}"
        bic = ", BIC the same within 2" if abs(above) < ALIKE else bic
    if held_out is None:
        return (bic[2:] or "predicts no signal that the others predict") + aside
    if trial in classes[0]:
        fewer = _fewer(trial, first)
        return f"predicts the unseen part as well as the first{bic}{f', {fewer}' if fewer else ''}{aside}"
    return f"its error on the unseen part is {_larger(held_out.ratio(trial, first), 'that of the first')}{bic}{aside}"


def _why_first(classes: list[list[Trial]], held_out: HeldOut | None) -> str:
    first, *others = classes[0]
    following = others or (classes[1] if len(classes) > 1 else [])
    if not following:
        return "the only one that describes the record"
    if held_out is None:
        return "lowest BIC" if same_data(first, following[0]) else "predicts no signal that the others predict"
    if not others:
        ratio = held_out.ratio(following[0], first)
        return f"smallest error on the unseen part, that of {following[0].label} is {_larger(ratio)}"
    criterion = "lowest BIC" if _all_same_data(classes[0]) else "smallest error, though by no more than chance,"
    return f"{criterion} of {len(classes[0])} that predict the unseen part equally well"


def _conclusion(rows: Sequence[Row], classes: list[list[Trial]], held_out: HeldOut | None) -> str:
    """Return the result in one sentence."""
    predicting = [r for r in rows if r.trial.errors]
    if not predicting:
        return "no candidate could be fitted and validated: see the reason of each"
    if not classes:
        return (
            f"no candidate describes this record; {predicting[0].trial.label} predicts the unseen part with the "
            "smallest error, but do not trust its parameters"
        )
    first = classes[0][0]
    if rows[0].rank is None:
        return (
            "these candidates predict no signal in common and explain different labels, so nothing ranks them: "
            "compare models of the same side of the gear"
        )
    text = f"{first.label} describes this record best: {_why_first(classes, held_out)}"
    simpler = [t for t in classes[0][1:] if t.free < first.free]
    if simpler:
        simplest = min(simpler, key=lambda t: (t.free, classes[0].index(t)))
        close = same_data(simplest, first) and simplest.bic - first.bic < ALIKE
        text += f"; {simplest.label} is as good, {_fewer(simplest, first)}" if close else (
            f"; {simplest.label} predicts as well, {_fewer(simplest, first)}"
        )  # fmt: skip
    ahead = [r.trial for r in rows if not r.trial.describes and r.score < rows[0].score]
    if held_out and ahead and held_out.apart(ahead[0], first):
        status = ahead[0].estimate.status.value
        text += f"; {ahead[0].label} predicts with a smaller error still, but its fit is not good ({status})"
    return text


def _notes(trials: Sequence[Trial]) -> tuple[str, ...]:
    """Return notes that concern all rows."""
    notes = []
    fitted = [t for t in trials if t.labels]
    sets = {(t.labels, t.estimate.observations): t for t in fitted}
    if len(sets) > 1:
        said = "; ".join(f"{t.label} {', '.join(t.labels)} ({t.estimate.observations} values)" for t in sets.values())
        notes.append(f"the candidates explain different labels, BIC and AIC compare only rows of the same: {said}")
    ratios = {t.estimate.values["N"]: t for t in fitted if "N" in t.estimate.values}
    if len(ratios) > 1:
        said = ", ".join(f"{n:g} in {t.label}" for n, t in ratios.items())
        notes.append(f"the gear ratio N is {said}: give one with --set N=... unless that is meant")
    return tuple(notes)


def _fewer(a: Trial, b: Trial) -> str:
    n = b.free - a.free
    return f"with {n} parameter{'s' if n > 1 else ''} fewer" if n > 0 else ""


def _larger(ratio: float, what: str = "") -> str:
    if ratio >= 2.0:
        return f"{ratio:.2g} times {what}" if what else f"{ratio:.2g} times as large"
    return f"{100.0 * (ratio - 1.0):.2g} % larger{f' than {what}' if what else ''}"
