"""What is identified online, and how: what stays the same while a joint is watched."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from joint_id_core.cell.kernel import compile_model
from joint_id_core.data.recording import Array, Recording
from joint_id_core.estimators import Estimator
from joint_id_core.estimators.between_samples import fitted_between, takes_mean
from joint_id_core.estimators.cross_check import cross_checked
from joint_id_core.estimators.innovations.belief import Coordinates
from joint_id_core.estimators.innovations.estimator import Innovations
from joint_id_core.estimators.innovations.fit import fit_innovations
from joint_id_core.estimators.no_fit import no_fit
from joint_id_core.estimators.regression_starts import started
from joint_id_core.estimators.seen_ratio import with_seen_ratio
from joint_id_core.estimators.shared.data_check import concerning, refused
from joint_id_core.estimators.shared.derived_inputs import absent, contradicts_inputs
from joint_id_core.estimators.shared.fit_data import FitData, UnusableError, prepare, unusable
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.models import Model
from joint_id_core.online.checks import Background, at_once
from joint_id_core.online.options import OnlineOptions
from joint_id_core.online.tracker import Tracker
from joint_id_core.results.estimate import Estimate, Status

# With one integrator step a sample, a fit may err by a tenth of a standard deviation. A memory averages noise away, and
# no error of the integrator: after a minute this was up to a third of one (`k_2`). With two steps it is far smaller.
FEWEST_STEPS = 2


@dataclass(frozen=True)
class Task:
    """What is identified, and how.

    Attributes:
        coordinates: of the free parameters.
        background: does what must not delay the recursion.
    """

    model: Model
    settings: ParameterSettings
    options: OnlineOptions
    estimator: Estimator
    coordinates: Coordinates
    background: Background = at_once

    def _started(self, recording: Recording, settings: ParameterSettings) -> Task:
        """Return the task with these settings, starts and priors of a window: see `estimators.regression_starts`."""
        if not isinstance(self.estimator, Innovations):
            return self
        settings = started(self.model, recording, settings)
        coordinates = Coordinates(self.model, settings.applied_to(self.model)[1], settings.priors)
        return replace(self, settings=settings, coordinates=coordinates)

    def continued(self, estimate: Estimate) -> Task:
        """Return the task with the start values with which an earlier estimate began, where the settings have none."""
        begun = {p.name: p.initial for p in estimate.parameters if p.name in estimate.free}
        return replace(self, settings=self.settings.with_values(begun | dict(self.settings.values)))

    def fitted(
        self, recording: Recording, given: ParameterSettings, previous: Estimate | None
    ) -> tuple[Task, Estimate]:
        """Return the task with starts and priors for a window, and its fit with what a second estimator says.

        `previous` and `given` are as in `fit` and `cross_checked`. A first window, without a previous one, is refused
        if it contradicts itself or its model; if not, the search begins with what it shows.
        """
        task, found = self, None
        if previous is None:
            found = self._refused(recording)
            task = self._started(recording, given) if found is None else self
        if found is None:
            found = task.fit(recording, previous)
        return task, task.cross_checked(found, recording, given)

    def fit(self, recording: Recording, previous: Estimate | None) -> Estimate:
        """Fit a window by itself; innovations begin their search at the fit of a `previous` window."""
        if isinstance(self.estimator, Innovations):
            lacking = absent(self.model, recording)
            if lacking:
                error = _not_derived(lacking, self.model, recording)
                return unusable(self.model, self.estimator.name, error, recording, self.settings)
            found = fit_innovations(self.model, recording, self.settings, self.estimator, previous=previous)
            if takes_mean(self.model):  # the filter takes the drive for held; the second opinion does not
                return found
            again = partial(fit_innovations, self.model, settings=self.settings, options=self.estimator, previous=found)
            return fitted_between(found, self.model, recording, again)[0]
        return self.estimator.fit(self.model, recording, self.settings)

    def _refused(self, recording: Recording) -> Estimate | None:
        """Return the estimate of a first window that contradicts itself or its model; None if it does not."""
        if not isinstance(self.estimator, Innovations):
            return None
        found = concerning(self.model, recording)
        told = [replace(f, fatal=True) if contradicts_inputs(f, self.model) else f for f in found]
        bad = refused(self.model, self.estimator.name, told, recording, self.settings)
        return no_fit(self.model, self.estimator.name, recording, self.settings) if bad is None else bad

    def cross_checked(self, fit: Estimate, recording: Recording, given: ParameterSettings) -> Estimate:
        """Return the fit of a window with what a second estimator says of it, if it was made by innovations.

        `given` is what the user has set: priors of `started` are no knowledge that the second one must share.
        """
        if not isinstance(self.estimator, Innovations):
            return fit
        checked = cross_checked(fit, self.model, recording, given)
        return with_seen_ratio(checked, self.model, recording, given)

    def prepared(self, recording: Recording) -> FitData | None:
        """Return the signals of a recording without its rests; None if it cannot be used."""
        try:
            return prepare(self.model, recording, self.settings, leave_out_rests=True)
        except UnusableError:
            return None

    def tracker(self, recording: Recording, z: Array, last: Estimate) -> Tracker | None:
        """Return a filter for a recording, at the reference z (k,), with noise levels and steps of a fit.

        It takes `FEWEST_STEPS` or more, unless the user has set their number.
        None if the recording cannot be used or holds other signals than that fit.
        """
        data = self.prepared(recording)
        if data is None or set(data.noise_names) != set(last.noise):
            return None
        kernel = compile_model(self.model, "tanh", data.freed, last.cell)
        levels = np.square([last.noise[n] for n in data.noise_names])
        asked = isinstance(self.estimator, Innovations) and self.estimator.substeps
        steps = asked or max(FEWEST_STEPS, last.substeps)
        return Tracker(data, kernel, self.coordinates, z, levels, steps, frozenset(self.settings.values))


def _not_derived(lacking: Sequence[str], model: Model, recording: Recording) -> UnusableError:
    return UnusableError(
        Status.MISSING_SIGNAL,
        f"{recording.source} has no {' and no '.join(lacking)}, input of model {model.name}: while samples arrive it "
        "is not derived from a position; let them pass the filter first (node filter, in Python StreamingFilter)",
    )
