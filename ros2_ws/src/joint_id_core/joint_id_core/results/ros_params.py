"""Estimates as a parameter file of the identifier node: what was identified is what it starts from."""

from __future__ import annotations

import math
from collections.abc import Mapping

import yaml

from joint_id_core.errors import JointIdError
from joint_id_core.models import build
from joint_id_core.results.estimate import Estimate, ParameterEstimate
from joint_id_core.results.verdict import Verdict

NODE = "/**/identifier"


def parameter_file(estimates: Mapping[str, Estimate], source: Mapping[str, str]) -> str:
    """Return the file: estimated values as start values, held ones as they were held, with their uncertainty.

    Values that were not estimated are left to the model's table.

    Args:
        estimates: by joint, all of one model with the same options.
        source: what the values are from, by joint.

    Raises:
        JointIdError: estimates of several models or options, which one node cannot identify.
    """
    first = next(iter(estimates.values()))
    for joint, estimate in estimates.items():
        if (estimate.model, dict(estimate.model_options)) != (first.model, dict(first.model_options)):
            raise JointIdError(
                f"joint {joint} is of another model, or has other options, than {next(iter(estimates))}: one "
                "identifier node has one model; export them one by one"
            )
    model = build(first.model, **first.model_options)
    fixed_by_table = {p.name for p in model.parameters if p.fixed}
    lists: dict[str, list[str]] = {"set": [], "fix": [], "free": []}
    for joint, estimate in estimates.items():
        for p in estimate.parameters:
            if not math.isfinite(p.value):  # it has no default, and nothing was fitted
                continue
            if p.name in estimate.free:
                if p.verdict is Verdict.ESTIMATED:
                    lists["set"].append(f"{joint}.{p.name}={p.value:.6g}")
                if p.name in fixed_by_table:
                    lists["free"].append(f"{joint}.{p.name}")
            elif p.name not in fixed_by_table:
                lists["fix"].append(f"{joint}.{p.name}={_held(p)}")
            elif p.value != model.parameter(p.name).nominal or math.isfinite(p.std_dev):
                lists["set"].append(f"{joint}.{p.name}={_held(p)}")
    options = {n: v for n, v in first.model_options.items() if v not in ("", False)}
    parameters = {"model": first.model, **options, "joints": list(estimates)} | {n: v for n, v in lists.items() if v}
    heads = [f"# {_on_one_line(f'{joint}: {text}')}" for joint, text in source.items()]
    return "\n".join([*heads, yaml.safe_dump({NODE: {"ros__parameters": parameters}}, sort_keys=False)])


def _on_one_line(text: str) -> str:
    """Return a text without the characters that would end a comment of YAML, or that YAML does not have."""
    return "".join(c if c.isprintable() else "?" for c in text)


def _held(p: ParameterEstimate) -> str:
    return f"{p.value:.6g}" + (f"+-{p.std_dev:.3g}" if math.isfinite(p.std_dev) and p.std_dev > 0.0 else "")
