"""The paper's network as a dataclass whose fields are its options."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from joint_id_core.errors import JointIdError
from joint_id_core.options import Progress, check, option

if TYPE_CHECKING:  # the command line reads the options without loading NumPy
    from joint_id_core.data.recording import Recording
    from joint_id_core.estimators.shared.settings import ParameterSettings
    from joint_id_core.models import Model
    from joint_id_core.results.estimate import Estimate


@dataclass(frozen=True)
class HPinn:
    """The physics-informed network of Yang et al. (H-PINN): the reference method. Needs torch.

    The paper trains for 300 to 1000 epochs and does not give its learning rates. `bounds` are intervals (lower, upper)
    by parameter that training does not leave. Other parameters keep to the bounds of the model's table.

    Raises:
        JointIdError: an option outside its range, or an interval whose lower end is not below its upper one.
    """

    name: ClassVar[str] = "hpinn"

    epochs: int = option(300, "training epochs, each one simulation of the whole record", lower=1)
    learning_rate: float = option(0.01, "first RMSProp step, relative to each parameter's start value", "", 1e-9, 1.0)
    decay_at: tuple[float, ...] = option((0.4, 0.6, 0.8), "shares of the epochs at which the learning rate decays")
    decay_factor: float = option(0.3, "factor of each decay of the learning rate", lower=0.0, upper=1.0)
    substeps: int = option(0, "RK4 steps a sample, 1 in the paper; 0 finds a stable number", lower=0, upper=64)
    friction: str = option("sign", "Coulomb friction: sign as in the paper, or smoothed", choices=("sign", "tanh"))
    torsion_label: bool = option(True, "add the torsion theta_m/N - q as a label where both angles are measured")
    bounds: Mapping[str, tuple[float, float]] = option({}, "intervals (lower, upper) by parameter")

    def __post_init__(self) -> None:
        check(self)
        if any(not 0.0 < share < 1.0 for share in self.decay_at):
            raise JointIdError(f"option decay_at = {self.decay_at}: shares of the epochs must lie between 0 and 1")
        for name, (lower, upper) in self.bounds.items():
            if not lower < upper:
                raise JointIdError(f"option bounds: {name} = ({lower:g}, {upper:g}): put the lower end first")

    def fit(
        self,
        model: Model,
        recording: Recording,
        settings: ParameterSettings | None = None,
        progress: Progress | None = None,
    ) -> Estimate:
        """Train on `recording`: see `estimators.fit`."""
        from joint_id_core.estimators.hpinn.fit import fit_hpinn  # takes these options

        return fit_hpinn(model, recording, settings, self, progress)

    def compile(self, model: Model, settings: ParameterSettings) -> None:
        """Compile all that fits of `model` need, or load it from the cache, so that the first fit is not slower."""
        from joint_id_core.cell.kernel import compile_model
        from joint_id_core.estimators.hpinn import fit  # noqa: F401  # loads torch

        _ = compile_model(model, self.friction, tuple(sorted(settings.freed_in(model)))).sensitivities

    def is_compiled(self, model: Model, settings: ParameterSettings) -> bool:
        """Return whether `compile` only has to load."""
        from joint_id_core.cell.kernel import is_compiled

        return is_compiled(model, self.friction, tuple(sorted(settings.freed_in(model))))
