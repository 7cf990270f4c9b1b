"""What is known of an arm, in a JSON file, so that a restart goes on with it."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from joint_id_core.arm.belief import Belief, Scores
from joint_id_core.arm.faults import Faults
from joint_id_core.arm.gains import Gains
from joint_id_core.arm.regressor import Regressor
from joint_id_core.errors import JointIdError
from joint_id_core.text_file import write_text

FORMAT, VERSION = "joint_id arm knowledge", 4
ARRAYS = ("values", "covariance", "sigma", "colour", "mean", "torque", "drift")


def write(path: Path, belief: Belief, regressor: Regressor, gains: Gains) -> None:
    """Write a belief, with what it is of.

    Raises:
        JointIdError: the file cannot be written.
    """
    content: dict[str, Any] = {"format": FORMAT, "version": VERSION, "arm": _arm(regressor), "gains": _plain(gains)}
    content |= {name: getattr(belief, name).tolist() for name in ARRAYS}
    content |= {"seen": belief.seen.tolist(), "carries": belief.carries, "duration": belief.duration}
    content["scores"] = {"products": belief.scores.products.tolist(), "squares": belief.scores.squares.tolist()}
    content["scores"]["duration"] = belief.scores.duration
    faults = belief.faults
    content["faults"] = {"texts": list(faults.texts), "shift": faults.shift.tolist(), "gross": faults.gross}
    content["faults"]["amounts"] = dict(faults.amounts)
    write_text(path, json.dumps(content), "what is known of the arm")


def read(path: Path, regressor: Regressor, gains: Gains) -> Belief:
    """Read a belief.

    Raises:
        JointIdError: the file cannot be read, is another one or damaged, or of another robot or other gains.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise JointIdError(f"{path}: cannot be read ({error.strerror}): check the path and its permissions") from None
    except ValueError:
        content = None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise JointIdError(f"{path}: no file of joint_id with what is known of an arm: give another state_file")
    if content.get("version") != VERSION:
        version = f"of version {content.get('version')}, this is {VERSION}"
        raise JointIdError(f"{path}: {version}: give another state_file, or delete it")
    for name, now in (("arm", _arm(regressor)), ("gains", _plain(gains))):
        if content.get(name) != now:
            what = "another description" if name == "arm" else "other torque constants or gear ratios"
            raise JointIdError(f"{path}: it was made with {what}: give another state_file, or delete it")
    try:
        return _belief(content, regressor)
    except (KeyError, TypeError, ValueError, AttributeError):
        raise JointIdError(f"{path}: damaged: delete it, or give another state_file") from None


def _belief(content: Mapping[str, Any], regressor: Regressor) -> Belief:
    """Return the belief of a file; ValueError and others where it is not one."""
    arrays = {name: np.array(content[name], dtype=float) for name in ARRAYS}
    count, size = len(regressor.joints), len(arrays["values"])
    seen = np.array(content["seen"], dtype=bool)
    sums = content["scores"]
    scores = Scores(
        np.array(sums["products"], dtype=float), np.array(sums["squares"], dtype=float), float(sums["duration"])
    )
    told = content["faults"]
    amounts = {str(name): float(amount) for name, amount in told["amounts"].items()}
    faults = Faults(tuple(map(str, told["texts"])), np.array(told["shift"], dtype=float), str(told["gross"]), amounts)
    shapes = {"values": (size,), "covariance": (size, size)} | dict.fromkeys(ARRAYS[2:], (count,)) | {"drift": (2,)}
    if any(arrays[name].shape != shape for name, shape in shapes.items()) or any(
        a.shape != (size,) for a in (seen, faults.shift)
    ):
        raise ValueError
    numbers = (*arrays.values(), scores.products, scores.squares, faults.shift, np.array(list(amounts.values())))
    if not all(np.isfinite(a).all() for a in numbers):
        raise ValueError
    variance = np.diag(arrays["covariance"])
    if (variance < 0.0).any() or (arrays["sigma"] <= 0.0).any() or not math.isfinite(content["duration"]):
        raise ValueError
    belief = Belief(
        **arrays, base=len(regressor.reference), carries=bool(content["carries"]), seen=seen,
        duration=float(content["duration"]), scores=scores, faults=faults,
    )  # fmt: skip
    if scores.products.shape != (count, len(belief.scores_of(0))) or scores.squares.shape != scores.products.shape:
        raise ValueError
    return belief


def _arm(regressor: Regressor) -> str:
    """Return what tells one description from another one, as far as a belief depends on it."""
    told = [*regressor.joints, *regressor.combinations, *(f"{value:.9g}" for value in regressor.reference)]
    return hashlib.sha256("\n".join(told).encode()).hexdigest()


def _plain(gains: Gains) -> dict[str, dict[str, float]]:
    return {joint: dict(own) for joint, own in gains.items()}
