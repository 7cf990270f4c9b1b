"""The default estimator as a dataclass whose fields are its options."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from joint_id_core.cell import CELLS
from joint_id_core.options import Progress, check, option

if TYPE_CHECKING:  # the command line reads the options without loading NumPy
    from joint_id_core.data.recording import Recording
    from joint_id_core.estimators.shared.settings import ParameterSettings
    from joint_id_core.models import Model
    from joint_id_core.results.estimate import Estimate

MAX_SUBSTEPS = 64


@dataclass(frozen=True)
class Innovations:
    """Maximum likelihood with the innovations form of the RK4 network; it models the noise of the measured input.

    Also called the prediction-error method (Ljung, System Identification, 2nd ed., ch. 7). Use it unless you want to
    compare with the paper's network (`HPinn`).
    """

    name: ClassVar[str] = "innovations"

    max_iterations: int = option(50, "Gauss-Newton iterations in one stage", lower=1)
    substeps: int = option(0, "steps a sample; 0 finds them", lower=0, upper=MAX_SUBSTEPS)
    cell: str = option("rk4", "Runge-Kutta 4, or an implicit method for stiff joints", choices=CELLS)
    horizon_s: float = option(0.1, "how far ahead the predictions look whose nrmse is reported", "s", lower=0.0)

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
        from joint_id_core.estimators.innovations.fit import fit_innovations  # takes these options

        return fit_innovations(model, recording, settings, self, progress=progress)

    def compile(self, model: Model, settings: ParameterSettings) -> None:
        """Compile all that fits of `model` need, online as well, or load it from the cache: no fit waits for it."""
        import scipy.signal  # noqa: F401  # half a second, which the regression for the first start must not take

        from joint_id_core.cell.kernel import compile_model, compile_shared
        from joint_id_core.estimators.innovations import fit  # noqa: F401  # loads what a fit imports

        compile_shared()
        _ = compile_model(model, "tanh", settings.freed_in(model), self.cell).tracking

    def is_compiled(self, model: Model, settings: ParameterSettings) -> bool:
        """Return whether `compile` only has to load."""
        from joint_id_core.cell.kernel import is_compiled

        return is_compiled(model, "tanh", settings.freed_in(model), self.cell)
