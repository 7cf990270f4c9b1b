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
from joint_id_core.errors import JointIdError
from joint_id_core.results.estimate import Checks, Estimate, ParameterChange, ParameterEstimate, Status, Verdict
from joint_id_core.results.estimate_check import LARGEST, check, damaged
from joint_id_core.text_file import write_text

FORMAT = "joint_id estimate"
OTHERS = {  # formats of other files, and what they are
    "joint_id knowledge": "the state of an identifier",
    "joint_id baselines": "the baselines of an identifier",
    "joint_id arm knowledge": "the state of an arm identifier",
    "joint_id arm estimate": "of arm fit --save",
}
VERSION = 1  # increased when a reader of the previous version would misread a file


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
    """Restore an estimate from the result of `to_dict`. Whether its numbers can be true is checked by `load` only.

    Raises:
        JointIdError: the content is not an estimate, is incomplete, or is of a later version.
    """
    if not isinstance(content, Mapping) or content.get("format") != FORMAT:
        other = str(content["format"]) if isinstance(content, Mapping) and "format" in content else ""
        what = f", but {other!r}{', ' + OTHERS[other] if other in OTHERS else ''}" if other else ""
        raise JointIdError(f'not an estimate: "format" is not "{FORMAT}"{what}: give a file that fit --save wrote')
    if type(version := content.get("version")) is not int or version < 1:
        raise damaged(f'"version" is {version!r}, and not a whole number from 1 on')
    if version > VERSION:
        raise JointIdError(f"the estimate is of version {version}, this library reads up to {VERSION}: update joint_id")
    try:
        checks, free = content["checks"], tuple(map(str, content["free"]))
        return Estimate(
            model=_text(content, "model"),
            estimator=_text(content, "estimator"),
            status=Status(content["status"]),
            message=_text(content, "message"),
            notes=tuple(map(str, content["notes"])),
            changes=tuple(ParameterChange(**change) for change in content.get("changes", ())),
            parameters=tuple(
                ParameterEstimate(
                    _text(p, "name"), _text(p, "unit"), _value(p["value"]), _value(p["std_dev"]), Verdict(p["verdict"]),
                    _value(p["initial"]), _text(p, "reason"),
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
            observations=_whole(content, "observations"),
            substeps=_whole(content, "substeps"),
            iterations=_whole(content, "iterations"),
            elapsed_s=content["elapsed_s"],
            start=_value(content["start_s"]),
            end=_value(content["end_s"]),
            samples=_whole(content, "samples"),
            origin=_whole(content, "origin_s"),
            source=_text(content, "source"),
            joint=_text(content, "joint"),
            temperature=_value(content.get("temperature_deg_c")),  # files of older libraries have none
            model_options=dict(content["model_options"]),
            cell=_text(content, "cell"),
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
        raise damaged(f"{type(error).__name__}: {error}") from None


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
        why = "" if path.suffix.lower() != ".json" else f" ({error})"
        raise JointIdError(
            f"{path}: not an estimate, since not a JSON file{why}: give a file that joint-id fit --save wrote"
        ) from None
    except RecursionError:
        raise JointIdError(f"{path}: not a JSON file of an estimate: its brackets are nested too deeply") from None
    try:
        estimate = from_dict(content)
        check(estimate)
    except JointIdError as error:
        raise JointIdError(f"{path}: {error}") from None
    return estimate


def _square(rows: Any, count: int) -> Array:
    """Return the numbers of a covariance, shape (count, count).

    Raises:
        ValueError: it has another shape.
    """
    if not isinstance(rows, list) or [isinstance(row, list) and len(row) for row in rows] != [count] * count:
        raise ValueError(f"its covariance is not {count} by {count}")
    return np.array([[_value(v) for v in row] for row in rows], dtype=float).reshape(count, count)


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _value(number: float | None) -> float:
    if isinstance(number, bool | str):
        raise TypeError(f"{number!r} is no number")
    return math.nan if number is None else float(number)


def _text(content: Mapping[str, Any], name: str) -> str:
    if not isinstance(value := content[name], str):
        raise TypeError(f"{name} is {value!r}, and no text")
    return value


def _whole(content: Mapping[str, Any], name: str) -> int:
    if type(value := content[name]) is not int or abs(value) > LARGEST:
        raise TypeError(f"{name} is {value!r}, and no whole number")
    return value


def _values(numbers: Mapping[str, float | None]) -> dict[str, float]:
    return {name: _value(number) for name, number in numbers.items()}
