"""Inverse-dynamics regression as a dataclass whose fields are its options."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from joint_id_core.options import Progress, check, option

if TYPE_CHECKING:  # the command line reads the options without loading NumPy
    from joint_id_core.data.recording import Recording
    from joint_id_core.estimators.shared.settings import ParameterSettings
    from joint_id_core.models import Model
    from joint_id_core.results.estimate import Estimate


@dataclass(frozen=True)
class Regression:
    """Inverse dynamics, linear in the parameters (IDIM-LS; Gautier 1997), with intervals for coloured residuals.

    It takes milliseconds, assumes nothing of the noise but that it is stationary, and uses only the band in which the
    joint moves. Every state must be measured, or follow from a measured position.
    """

    name: ClassVar[str] = "regression"

    band_hz: float = option(0.0, "band of the equations that are fitted; 0 finds it", "Hz", lower=0.0, upper=1e4)
    lag_s: float = option(0.0, "memory of the residuals in the covariance; 0 finds it", "s", lower=0.0, upper=1e3)

    instruments: str = option(
        "automatic",
        "motion along which the instruments are computed; command needs reference_position. automatic: for models with "
        "a twist that of the command, else that of the motor, and for others none, but plain least squares",
        choices=("automatic", "command", "motion"),
    )

    def __post_init__(self) -> None:
        check(self)

    def fit(
        self,
        model: Model,
        recording: Recording,
        settings: ParameterSettings | None = None,
        progress: Progress | None = None,
    ) -> Estimate:
        """Fit `model` to `recording`: see `estimators.fit`."""
        from joint_id_core.estimators.regression.fit import fit_regression  # takes these options

        return fit_regression(model, recording, settings, self)

    def compile(self, model: Model, settings: ParameterSettings) -> None:
        """Load what a fit imports; there is nothing to compile."""
        from joint_id_core.estimators.regression import fit  # noqa: F401  # loads what a fit imports

    def is_compiled(self, model: Model, settings: ParameterSettings) -> bool:
        """Return whether `compile` only has to load."""
        return True
