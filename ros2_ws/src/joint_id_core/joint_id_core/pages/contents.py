"""What a report shows beside the estimate: how it grows with the motion, and what it predicts of samples not fitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import PurePath

import numpy as np

from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators import Estimator, Innovations, ParameterSettings, Regression, fit
from joint_id_core.estimators.shared.derived_inputs import with_inputs
from joint_id_core.models import Model
from joint_id_core.results.estimate import Estimate

FITTED = 0.7  # share of the samples whose fit predicts the others
HOPS = 60  # estimates on the way, at most
WINDOW_S = 2.0
GROWING = 20  # regressions on the way


@dataclass(frozen=True)
class Contents:
    """What a report is made of.

    Attributes:
        estimate: the result.
        recording: that was fitted; None if only the estimate is there.
        command: that makes the report again.
        why: how the model was chosen, in words.
        doubts: findings of the checks of the recording.
        suspects: single samples that the checks doubt: channel and number.
        windows: estimates while the motion goes on, see `windows`.
        held_out: what the first part of the motion predicts of the rest: rows of signal and figure in words.
        earlier: estimate to compare with.
        motion: command that designs a motion which shows what this one does not.
    """

    estimate: Estimate
    recording: Recording | None = None
    command: str = ""
    why: Sequence[str] = ()
    doubts: Sequence[str] = ()
    suspects: Sequence[tuple[str, int]] = ()
    windows: Sequence[Estimate] = ()
    held_out: Sequence[tuple[str, str]] = ()
    earlier: Estimate | None = None
    motion: str = ""

    def by_name(self) -> Contents:
        """Return the same with the names of the recordings in place of their paths, if those differ."""
        earlier = "" if self.earlier is None else self.earlier.source
        places = [place for source in (self.estimate.source, earlier) if source for place in source.split(", ")]
        names = {place: PurePath(place).name for place in dict.fromkeys(places)}
        if len(set(names.values())) < len(names):
            return self

        def named(text: str) -> str:
            for place in sorted(names, key=len, reverse=True):
                text = text.replace(place, names[place])
            return text

        def named_in(one: Estimate) -> Estimate:
            return replace(
                one, source=named(one.source), message=named(one.message), notes=tuple(map(named, one.notes))
            )

        return replace(
            self, estimate=named_in(self.estimate), earlier=self.earlier and named_in(self.earlier),
            doubts=[named(text) for text in self.doubts], why=[named(text) for text in self.why],
            held_out=[(signal, named(text)) for signal, text in self.held_out],
        )  # fmt: skip


def windows(
    model: Model, recording: Recording, settings: ParameterSettings, solver: Estimator
) -> list[Estimate]:  # fmt: skip
    """Return estimates while the motion goes on: of the online identifier, or of a regression of all samples so far.

    [] if there are none, or if every one would take long.
    """
    if len(recording) < 2:
        return []
    if isinstance(solver, Regression):
        ends = np.linspace(0, len(recording), GROWING + 1).astype(int)[1:]
        found = [fit(model, recording.slice(0, end), settings, solver) for end in ends.tolist()]
        return [estimate for estimate in found if not estimate.status.unusable]
    if not isinstance(solver, Innovations):
        return []
    from joint_id_core.online import OnlineIdentifier, OnlineOptions

    recording = with_inputs(model, recording)
    hop = max(WINDOW_S / 4.0, recording.duration / HOPS)
    size = max(1, round(hop / recording.period))
    identifier = OnlineIdentifier(model, settings, OnlineOptions(max(WINDOW_S, 2.0 * hop), hop), solver)
    hops = [identifier.update(recording.slice(i, i + size)) for i in range(0, len(recording), size)]
    return [estimate for estimate in hops if estimate is not None]


def held_out(
    model: Model, recording: Recording, settings: ParameterSettings, solver: Estimator
) -> list[tuple[str, str]]:  # fmt: skip
    """Return by signal, in words, what a fit of the first part of a recording predicts of the rest."""
    from joint_id_core.validation.prediction import held_out as errors
    from joint_id_core.validation.prediction import held_out_drive

    first = round(FITTED * len(recording))
    try:
        found = fit(model, recording.slice(0, first), settings, solver)
        if found.status.unusable:
            return [("-", f"the first {100.0 * FITTED:.0f} % cannot be fitted: {found.message}")]
        rest = recording.slice(first, len(recording))
        rows = [(n, f"nrmse {v:.3g}, 0.1 s ahead") for n, v in errors(model, rest, found).items()]
        drive = held_out_drive(model, rest, found)
        return [*rows, (drive[0], f"R² {drive[1]:.4f}, from the motion, below 10 Hz")] if drive else rows
    except JointIdError as error:
        return [("-", f"not known: {error}")]
