"""What a motion makes small (Walter & Pronzato, Identification of Parametric Models, 1997, ch. 6)."""

from __future__ import annotations

from joint_id_core.errors import JointIdError

CRITERIA = ("sigma", "D", "A")


def require_criterion(name: str) -> None:
    """Check the name of a criterion.

    `sigma` is the geometric mean of the standard deviations, `D` the volume of their ellipsoid, `A` the sum of the
    variances.

    Raises:
        JointIdError: there is none of this name.
    """
    if name not in CRITERIA:
        raise JointIdError(f"criterion {name}: choose one of {', '.join(CRITERIA)}")
