"""Types of the arguments of public functions."""

from __future__ import annotations

from joint_id_core.errors import JointIdError


def require_type(what: str, value: object, kinds: type | tuple[type, ...], advice: str) -> None:
    """Check the type of an argument; `advice` says how to get the right one.

    Raises:
        JointIdError: it is of another type.
    """
    if not isinstance(value, kinds):
        raise JointIdError(f"{what} is {value!r:.60}, of type {type(value).__name__}: {advice}")
