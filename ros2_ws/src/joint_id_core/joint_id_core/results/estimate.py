"""The result of an estimation: values, covariance, verdicts, fit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from joint_id_core.arguments import file_path
from joint_id_core.data.recording import Array
from joint_id_core.errors import JointIdError, close_to
from joint_id_core.results.level_effect import LevelEffect
from joint_id_core.results.parameter_change import SHOWN as SHOWN
from joint_id_core.results.parameter_change import ParameterChange as ParameterChange
from joint_id_core.results.status import Status as Status
from joint_id_core.results.verdict import Verdict as Verdict

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame

MOST_SENTENCES = 3  # of the notes, in a message


def message(notes: Sequence[str]) -> str:
    """Return the first `MOST_SENTENCES` notes as one text."""
    return " ".join(notes[:MOST_SENTENCES])


@dataclass(frozen=True)
class ParameterEstimate:
    """One row of the result. `std_dev` is NaN if there is none (fixed parameters, a failed fit).

    `reason` explains the verdict in words.
    """

    name: str
    unit: str
    value: float
    std_dev: float
    verdict: Verdict
    initial: float = float("nan")
    reason: str = ""

    def at(self, value: float, std_dev: float) -> ParameterEstimate:
        """Return the row with another value and standard deviation, as `replace` does in ten times the time."""
        made = object.__new__(ParameterEstimate)
        made.__dict__.update(self.__dict__, value=value, std_dev=std_dev)
        return made


@dataclass(frozen=True)
class Checks:
    """Findings of the checks of a fit's residuals and predictions.

    Attributes:
        texts: one text per check; empty if the check found nothing.
        excess: addition to the covariance of the estimation coordinates (`Belief`), shape (k, k).
        nrmse: as in `Estimate`.
        together: by parameter that enters only in combination with others, what is known instead and what to do.
        levels: how the intervals depend on the noise levels; None if it is not known. Files do not hold it.
        doubt, lasting, bias: of what the model lacks, as in `misfit.Misfit`. Files do not hold them.
        of_drive, of_gain: parts of the standard deviations for noise of the drive's sensor, and for a gain of it that
            changes (free,). Files do not hold them.
    """

    texts: tuple[str, ...]
    excess: Array
    nrmse: Mapping[str, float]
    together: Mapping[str, str]
    levels: LevelEffect | None = field(default=None, compare=False, repr=False)
    doubt: str = ""
    lasting: Array | None = field(default=None, compare=False, repr=False)
    bias: Array | None = field(default=None, compare=False, repr=False)
    of_drive: Array | None = field(default=None, compare=False, repr=False)
    of_gain: Array | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True)
class Predictions:
    """Measured and predicted labels of the samples that were fitted.

    Attributes:
        time: instants in s, shape (T,).
        measured, predicted: by signal, shape (T,), in the signal's unit; `measured` is NaN where nothing was measured.
        inputs: of the model by name, shape (T,).
        horizon_s: how far ahead the predictions reach, each time from a filtered state; 0 for all of the record.
    """

    time: Array
    measured: Mapping[str, Array]
    predicted: Mapping[str, Array]
    inputs: Mapping[str, Array] = field(default_factory=dict)
    horizon_s: float = 0.0


@dataclass(frozen=True, repr=False, eq=False)
class Estimate:
    """The result of an estimator. `print` shows it as a table; `save` and `load` store it as JSON.

    Attributes:
        model: name of the model; model_options: the options it was built with (`models.build`).
        estimator: name of the estimator; cell: the integrator of its model, "rk4" or "implicit".
        status, message: how the fit ended, and the most important findings in words.
        parameters: all parameters in the model's order, fixed ones included.
        free: names of the estimated parameters, in the order of `covariance`.
        covariance: of the free parameters in SI units, shape (len(free), len(free)).
        nrmse: by signal, rms of prediction minus label over the label's standard deviation.
        noise: estimated standard deviation by label and noisy input, SI units.
        chi2: mean squared normalised innovation; 1 for a correct model.
        whiteness: by label, lag-one autocorrelation of the innovations; 0 for a correct model.
        deviance: -2 log likelihood of the labels at the estimate, without its constant term (NaN where an estimator
            has no likelihood); observations: how many label values it covers.
        substeps: integrator steps per sample.
        iterations, elapsed_s: number of iterations and computing time in s.
        start, end: first and last instant of the data in s, counted from `origin` (see `Recording`).
        samples: number of samples used.
        source, joint: where the data came from, as in `Recording`.
        temperature: mean temperature of the joint over the data in deg C; NaN where it is not known. Friction depends
            on it.
        predictions: measured and predicted labels; None for a fit that failed, a loaded or an online estimate.
        losses: of each epoch of a training; empty for other estimators, and for a loaded estimate.
        checks: findings of the checks of this fit; online, of the newest fit of a whole window.
        notes: all findings as sentences, the most useful first; `message` holds the first ones.
        changes: parameters that changed while the joint was watched, the most significant first.
    """

    model: str
    estimator: str
    status: Status
    message: str
    parameters: tuple[ParameterEstimate, ...]
    free: tuple[str, ...] = ()
    covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))
    nrmse: Mapping[str, float] = field(default_factory=dict)
    noise: Mapping[str, float] = field(default_factory=dict)
    chi2: float = float("nan")
    whiteness: Mapping[str, float] = field(default_factory=dict)
    deviance: float = float("nan")
    observations: int = 0
    substeps: int = 0
    iterations: int = 0
    elapsed_s: float = 0.0
    start: float = float("nan")
    end: float = float("nan")
    samples: int = 0
    origin: int = 0
    source: str = ""
    joint: str = ""
    temperature: float = float("nan")
    model_options: Mapping[str, Any] = field(default_factory=dict)
    cell: str = "rk4"
    predictions: Predictions | None = None
    checks: Checks | None = None
    losses: tuple[float, ...] = ()
    notes: tuple[str, ...] = ()
    changes: tuple[ParameterChange, ...] = ()

    @property
    def converged(self) -> bool:
        """Whether the fit converged and describes the data."""
        return self.status is Status.CONVERGED

    @property
    def values(self) -> dict[str, float]:
        """Value of every parameter by name."""
        return {p.name: p.value for p in self.parameters}

    def noted(self, notes: Sequence[str], **fields: Any) -> Estimate:
        """Return a copy with these notes, the first of which are its message, and other `fields`."""
        return replace(self, notes=tuple(notes), message=message(notes), **fields)

    def updated(self, **fields: Any) -> Estimate:
        """Return a copy with other `fields`, as `dataclasses.replace` does in ten times the time."""
        made = object.__new__(Estimate)
        made.__dict__.update(self.__dict__, **fields)
        return made

    def __getitem__(self, name: str) -> ParameterEstimate:
        """Return the estimate of one parameter.

        Raises:
            JointIdError: the model has no such parameter.
        """
        for row in self.parameters:
            if row.name == name:
                return row
        raise JointIdError(
            f"model {self.model} has no parameter {name!r}{close_to(name, self.values)}: it has "
            f"{', '.join(self.values)}"
        )

    def __contains__(self, name: object) -> bool:
        """Return whether the model has a parameter of this name."""
        return name in self.values

    def __iter__(self) -> Iterator[str]:
        """Return the names of all parameters, as a mapping does."""
        return iter(self.values)

    def __len__(self) -> int:
        """Return the number of parameters."""
        return len(self.parameters)

    def __eq__(self, other: object) -> bool:
        """Return whether the other estimate has the same content; predictions, which are not saved, are ignored."""
        return isinstance(other, Estimate) and self.to_dict() == other.to_dict()

    __hash__ = object.__hash__

    def __repr__(self) -> str:
        """Return one line: model, status, and the estimated parameters."""
        from joint_id_core.results.report import one_line

        return one_line(self)

    def __str__(self) -> str:
        """Return the report as a table in text."""
        from joint_id_core.results.report import table

        return table(self)

    def _repr_html_(self) -> str:
        """Return the table that a notebook shows."""
        from joint_id_core.results.html import table

        return table(self)

    def to_dict(self) -> dict[str, Any]:
        """Return the estimate as plain JSON types, without `predictions`. See `results.estimate_json`."""
        from joint_id_core.results.estimate_json import to_dict

        return to_dict(self)

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> Estimate:
        """Restore an estimate from the result of `to_dict`.

        Raises:
            JointIdError: the content is not an estimate, is incomplete, or is of a later version.
        """
        from joint_id_core.results.estimate_json import from_dict

        return from_dict(content)

    def save(self, path: str | Path) -> None:
        """Write the estimate as a JSON file. An existing file is replaced only after the new one is complete.

        Raises:
            JointIdError: the file cannot be written.
        """
        from joint_id_core.results.estimate_json import save

        save(self, file_path(path))

    @classmethod
    def load(cls, path: str | Path) -> Estimate:
        """Read a file that `save` wrote.

        Raises:
            JointIdError: the file cannot be read or does not hold an estimate.
        """
        from joint_id_core.results.estimate_json import load

        return load(file_path(path))

    def plot(self, path: str | Path | None = None) -> Figure:
        """Return a picture of measured and predicted labels, and save it if there is a path. Needs matplotlib.

        The file extension sets the format.

        Raises:
            JointIdError: matplotlib is missing, there are no predictions, or the file cannot be written.
        """
        from joint_id_core.results.plot import figure, save

        if path is not None:
            save(file_path(path), self)
        return figure(self)

    def to_frame(self) -> DataFrame:
        """Return a pandas table: a row a parameter with value, std_dev, unit, verdict, initial and reason.

        Raises:
            JointIdError: pandas is not installed.
        """
        try:
            from pandas import DataFrame
        except ImportError:
            raise JointIdError("to_frame needs pandas, which is not installed: pip install pandas") from None
        columns = ("value", "std_dev", "unit", "verdict", "initial", "reason")
        rows = [[getattr(p, c) if c != "verdict" else p.verdict.value for c in columns] for p in self.parameters]
        names = [p.name for p in self.parameters]
        return DataFrame(rows, index=names, columns=list(columns)).rename_axis("parameter")
