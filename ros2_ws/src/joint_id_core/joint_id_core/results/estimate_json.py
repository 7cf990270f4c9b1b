"""Estimates as versioned JSON, without the measured and predicted samples.

A file is checked against the model that it names when it is loaded: people edit files, and disks damage them.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.data.signals import Parameter
from joint_id_core.errors import JointIdError, close_to
from joint_id_core.models import MODELS, Model
from joint_id_core.results.estimate import Checks, Estimate, ParameterChange, ParameterEstimate, Status, Verdict
from joint_id_core.text_file import write_text

FORMAT = "joint_id estimate"
VERSION = 1  # increased when a reader of the previous version would misread a file
LARGEST = 1e30  # no constant of a joint comes near it, in its SI unit


def to_dict(estimate: Estimate) -> dict[str, Any]:
    """Return the estimate as plain JSON types; values that are not finite become None.

    `from_dict` restores it to the last bit, with NaN for None. The instants `start_s` and `end_s` count from
    `origin_s`, whole seconds on the clock of the source.
    """
    checks = estimate.checks
    return {
        "format": FORMAT,
        "version": VERSION,
        "model": estimate.model,
        "model_options": dict(estimate.model_options),
        "estimator": estimate.estimator,
        "cell": estimate.cell,
        "status": estimate.status.value,
        "message": estimate.message,
        "notes": list(estimate.notes),
        "changes": [asdict(change) for change in estimate.changes],
        "parameters": [
            {
                "name": p.name,
                "unit": p.unit,
                "value": _number(p.value),
                "std_dev": _number(p.std_dev),
                "verdict": p.verdict.value,
                "initial": _number(p.initial),
                "reason": p.reason,
            }
            for p in estimate.parameters
        ],
        "free": list(estimate.free),
        "covariance": [[_number(v) for v in row] for row in np.asarray(estimate.covariance).tolist()],
        "fit": [
            {"signal": name, "nrmse": _number(v), "noise_std_dev": _number(estimate.noise.get(name, math.nan))}
            for name, v in estimate.nrmse.items()
        ],
        "noise": {name: _number(v) for name, v in estimate.noise.items()},
        "chi2": _number(estimate.chi2),
        "whiteness": {name: _number(v) for name, v in estimate.whiteness.items()},
        "deviance": _number(estimate.deviance),
        "observations": estimate.observations,
        "substeps": estimate.substeps,
        "iterations": estimate.iterations,
        "samples": estimate.samples,
        "source": estimate.source,
        "joint": estimate.joint,
        "temperature_deg_c": _number(estimate.temperature),
        "origin_s": estimate.origin,
        "start_s": _number(estimate.start),
        "end_s": _number(estimate.end),
        "elapsed_s": estimate.elapsed_s,
        "checks": None
        if checks is None
        else {
            "texts": list(checks.texts),
            "excess": np.asarray(checks.excess).tolist(),
            "nrmse": {name: _number(v) for name, v in checks.nrmse.items()},
            "together": dict(checks.together),
        },
    }


def from_dict(content: Mapping[str, Any]) -> Estimate:
    """Restore an estimate from the result of `to_dict`.

    Raises:
        JointIdError: the content is not an estimate, is incomplete, or is of a later version.
    """
    if not isinstance(content, Mapping) or content.get("format") != FORMAT:
        raise JointIdError(f'not an estimate: "format" is not "{FORMAT}"')
    if type(version := content.get("version")) is not int or version < 1:
        raise _damaged(f'"version" is {version!r}, and not a whole number from 1 on')
    if version > VERSION:
        raise JointIdError(f"the estimate is of version {version}, this library reads up to {VERSION}: update joint_id")
    try:
        checks, free = content["checks"], tuple(map(_text, content["free"]))
        return Estimate(
            model=_text(content["model"]),
            estimator=_text(content["estimator"]),
            status=Status(content["status"]),
            message=_text(content["message"]),
            notes=tuple(map(_text, content["notes"])),
            changes=tuple(ParameterChange(**change) for change in content.get("changes", ())),
            parameters=tuple(
                ParameterEstimate(
                    _text(p["name"]), _text(p["unit"]), _value(p["value"]), _value(p["std_dev"]), Verdict(p["verdict"]),
                    _value(p["initial"]), _text(p["reason"]),
                )
                for p in content["parameters"]
            ),
            free=free,
            covariance=_square(content["covariance"], len(free)),
            nrmse={row["signal"]: _value(row["nrmse"]) for row in content["fit"]},
            noise=_values(content["noise"]),
            chi2=_value(content["chi2"]),
            whiteness=_values(content["whiteness"]),
            deviance=_value(content["deviance"]),
            observations=_whole(content["observations"]),
            substeps=_whole(content["substeps"]),
            iterations=_whole(content["iterations"]),
            elapsed_s=content["elapsed_s"],
            start=_value(content["start_s"]),
            end=_value(content["end_s"]),
            samples=_whole(content["samples"]),
            origin=_whole(content["origin_s"]),
            source=_text(content["source"]),
            joint=_text(content["joint"]),
            temperature=_value(content.get("temperature_deg_c")),  # files of older libraries have none
            model_options=dict(content["model_options"]),
            cell=_text(content["cell"]),
            checks=None
            if checks is None
            else Checks(
                tuple(checks["texts"]),
                np.array(checks["excess"], dtype=float).reshape(len(free), len(free)),
                _values(checks["nrmse"]),
                dict(checks["together"]),
            ),
        )  # fmt: skip
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise _damaged(f"{type(error).__name__}: {error}") from None


def save(estimate: Estimate, path: Path) -> None:
    """Write the estimate to a file. An existing file is replaced only after the new one is complete.

    Raises:
        JointIdError: the file cannot be written.
    """
    write_text(path, json.dumps(to_dict(estimate), indent=1, allow_nan=False) + "\n", "the estimate")


def load(path: Path) -> Estimate:
    """Read a file that `save` wrote.

    Raises:
        JointIdError: the file cannot be read, does not hold an estimate, or one that no fit can have made.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise JointIdError(f"{path}: the file cannot be read: {error.strerror}") from None
    except ValueError as error:  # not JSON, or not even text
        raise JointIdError(f"{path}: not a JSON file: {error}") from None
    except RecursionError:
        raise JointIdError(f"{path}: not a JSON file of an estimate: its brackets are nested too deeply") from None
    try:
        estimate = from_dict(content)
        _check(estimate)
    except JointIdError as error:
        raise JointIdError(f"{path}: {error}") from None
    return estimate


def _check(estimate: Estimate) -> None:
    """Check an estimate against the table of its model.

    Raises:
        JointIdError: a parameter is unknown, missing or there twice, or one of its numbers or its unit cannot be true.
    """
    table, names = {q.name: q for q in _model(estimate).parameters}, list(estimate.values)
    for name in (*names, *estimate.free):
        if name not in table:
            raise _damaged(f"model {estimate.model} has no parameter {name!r}{close_to(name, table)}")
    for name in table:
        if name not in names:
            raise _damaged(f"parameter {name} is missing")
    if len(names) < len(estimate.parameters) or len(set(estimate.free)) < len(estimate.free):
        raise _damaged("a parameter is in it twice")
    for row in estimate.parameters:
        _check_row(estimate, row, table[row.name])
    _check_covariance(estimate)


def _model(estimate: Estimate) -> Model:
    """Return the model of an estimate: one of `MODELS`, or one of the user's own that this process knows.

    Raises:
        JointIdError: there is none, or it has other options.
    """
    known = {m.__dict__.get("name"): m for m in _below(Model)} | MODELS
    if estimate.model not in known:
        close = close_to(estimate.model, MODELS)
        raise _damaged(f"there is no model {estimate.model!r}{close}: there are {', '.join(MODELS)}")
    try:
        model = known[estimate.model](**estimate.model_options)
        _ = model.parameters  # a wrong option is found here at the latest
    except (AttributeError, TypeError, ValueError) as error:
        raise _damaged(f"options of model {estimate.model}: {error}") from None
    return model


def _below(kind: type[Model]) -> list[type[Model]]:
    return [m for own in kind.__subclasses__() for m in (own, *_below(own))]


def _check_row(estimate: Estimate, row: ParameterEstimate, q: Parameter) -> None:
    if row.unit != q.unit:
        raise _damaged(f"{q.name} is in {row.unit!r}, and model {estimate.model} has it in {q.unit}")
    if q.positive:  # a logarithm, which is rounded
        lower, upper = (1.0 - 1e-9) * q.lower, (1.0 + 1e-9) * q.upper
    else:  # a regression keeps to no such bounds, so it may be outside by their distance
        lower, upper = 2.0 * q.lower - q.upper, 2.0 * q.upper - q.lower
    inside = lower <= row.value <= upper and abs(row.value) <= LARGEST
    unknown = math.isnan(row.value) and math.isnan(q.nominal) and not estimate.converged  # nothing was fitted
    if not inside and not unknown:
        bounds = f"[{max(q.lower, -LARGEST):g}, {min(q.upper, LARGEST):g}] {q.unit}"
        raise _damaged(f"the value of {q.name} is {row.value:g}, and must be in {bounds}")
    estimated = row.verdict is Verdict.ESTIMATED and row.name in estimate.free
    if row.std_dev < 0.0 or row.std_dev > LARGEST or (estimated and not row.std_dev > 0.0):
        raise _damaged(f"the standard deviation of {q.name}, which is {row.verdict.value}, is {row.std_dev:g}")


def _check_covariance(estimate: Estimate) -> None:
    known = np.isfinite([estimate[name].std_dev for name in estimate.free])
    if not np.isfinite(estimate.covariance[np.ix_(known, known)]).all():
        raise _damaged("a number of its covariance is missing")
    for name, variance in zip(estimate.free, np.diag(estimate.covariance).tolist(), strict=True):
        # 0 is that of a parameter that is held at its bound, or that no recording shows
        if variance < 0.0 or (variance == 0.0 and estimate[name].verdict is Verdict.ESTIMATED):
            raise _damaged(f"the variance of {name} is {variance:g} in its covariance")


def _damaged(what: str) -> JointIdError:
    return JointIdError(f"the estimate is incomplete or damaged: {what}: fit and save it again")


def _square(rows: list[list[float | None]], count: int) -> Array:
    """Return the numbers of a covariance, shape (count, count).

    Raises:
        JointIdError: it has another shape.
    """
    if [len(row) for row in rows] != [count] * count:
        raise _damaged(f"its covariance is not {count} by {count}")
    return np.array([[_value(v) for v in row] for row in rows], dtype=float).reshape(count, count)


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _value(number: float | None) -> float:
    if isinstance(number, bool | str):
        raise TypeError(f"{number!r} is no number")
    return math.nan if number is None else float(number)


def _text(value: object) -> str:
    if not isinstance(value, str):
        raise TypeError(f"{value!r} is no text")
    return value


def _whole(value: object) -> int:
    if type(value) is not int or abs(value) > LARGEST:
        raise TypeError(f"{value!r} is no whole number")
    return value


def _values(numbers: Mapping[str, float | None]) -> dict[str, float]:
    return {name: _value(number) for name, number in numbers.items()}
