"""Generate ROS parameters from options dataclasses (`joint_id_core.options.option`); defaults exist only once."""

from __future__ import annotations

import difflib
import math
from collections.abc import Collection, Mapping
from dataclasses import Field, fields
from typing import Any, TypeVar

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import InvalidParameterException, ParameterException
from rclpy.node import Node

from joint_id_core.options import names

Options = TypeVar("Options")

INT64_MAX = 2**63 - 1
# Exceptions of rclpy for a value of the wrong type or out of range; their text names the parameter and the reason.
PARAMETER_ERRORS = (ParameterException, InvalidParameterException)


def describe(option: Field[Any], read_only: bool = True) -> ParameterDescriptor:
    """Return the descriptor of one option: meaning with unit, range, choices."""
    meta = option.metadata
    unit = meta.get("unit", "")
    description = meta.get("description", "") + (f" [{unit}]" if unit else "")
    descriptor = ParameterDescriptor(name=option.name, description=description, read_only=read_only)
    if choices := meta.get("choices"):
        descriptor.additional_constraints = f"one of: {names(choices)}"
    lower, upper = meta.get("lower"), meta.get("upper")
    if lower is None and upper is None:
        return descriptor
    if isinstance(option.default, float):
        low, high = (-math.inf if lower is None else float(lower)), (math.inf if upper is None else float(upper))
        descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
    elif isinstance(option.default, int):
        low_int, high_int = (-INT64_MAX if lower is None else int(lower)), (INT64_MAX if upper is None else int(upper))
        descriptor.integer_range = [IntegerRange(from_value=low_int, to_value=high_int, step=1)]
    return descriptor


def declare(
    node: Node,
    cls: type[Options],
    read_only: bool = True,
    only: Collection[str] = (),
    defaults: Mapping[str, object] | None = None,
) -> None:
    """Declare one ROS parameter for every option of a dataclass (or for those in `only`) that is not declared yet.

    `defaults` holds defaults that depend on other parameters.

    Raises:
        PARAMETER_ERRORS: a value given at start has the wrong type or is out of range.
    """
    for f in fields(cls):  # type: ignore[arg-type]  # any dataclass
        # An empty ROS list has no type: the empty tuple is declared as one empty string.
        default = (defaults or {}).get(f.name, f.default)
        default = (list(default) or [""]) if isinstance(default, tuple) else default
        if not node.has_parameter(f.name) and (not only or f.name in only):
            node.declare_parameter(f.name, default, describe(f, read_only))


def read(node: Node, cls: type[Options]) -> Options:
    """Build the options from the declared parameters.

    Raises:
        JointIdError: a value outside its range or choices (options check themselves).
    """
    values = {}
    for f in fields(cls):  # type: ignore[arg-type]  # any dataclass
        values[f.name] = from_ros(f, node.get_parameter(f.name).value)
    return cls(**values)


def unknown(node: Node) -> list[str]:
    """Return a sentence for every parameter that was given at the start and that the node does not have."""
    known = [name for name in node._parameters if not name.startswith("qos_overrides.")]
    sentences = []
    for name in node._parameter_overrides:
        if name in node._parameters or name.startswith("qos_overrides."):
            continue
        near = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
        advice = f"did you mean {near[0]}?" if near else f"it has {', '.join(sorted(known))}"
        sentences.append(f"parameter {name} has no effect, because node {node.get_name()} does not have it: {advice}")
    return sentences


def from_ros(option: Field[Any], value: Any) -> Any:
    """Return the value of an option from its ROS parameter; for ROS an empty list is a list with one empty string."""
    return tuple(v for v in value if v != "") if isinstance(option.default, tuple) else value
