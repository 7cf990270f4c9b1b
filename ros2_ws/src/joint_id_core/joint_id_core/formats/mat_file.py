"""MATLAB files up to version 7. Vectors are columns; scalars can be factors in a mapping.

A vector in a structure has the name `structure.field`, and the first signal of a matrix `name.1`, as MATLAB counts. If
one structure holds all vectors, they have the names of its fields; a mapping may have the structure's before them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import scipy  # whose parts load when used
from numpy.typing import NDArray

from joint_id_core.data.recording import Array, Recording
from joint_id_core.errors import JointIdError
from joint_id_core.formats import joint_columns
from joint_id_core.formats.mapping import TIME, plan
from joint_id_core.formats.mapping import taken as in_words
from joint_id_core.formats.mapping import unread as left_alone
from joint_id_core.formats.overlooked import tell, tell_empty

UNUSABLE = {  # by kind of NumPy
    "c": "complex numbers: save its real part",
    "U": "text: save its numbers",
    "O": "cells: save a vector of numbers",
}
MOST_SIGNALS = 64  # in a matrix; a larger one holds no signals of joints


def read(path: Path, joint: str, mapping: Mapping[str, str]) -> Recording:
    """Read a MAT file; `mapping` as in `joint_id_core.formats.read`, e.g. {"torque": "gtau*vir"}.

    Raises:
        JointIdError: not a MAT file, version 7.3, no time or channel, vectors of different lengths.
    """
    found, unusable, mapping = _load(path, mapping)
    for target, expression in mapping.items():
        for name in (part.strip() for part in expression.split("*")):
            if name in unusable:
                raise JointIdError(f"{path}: {target}={expression}: {name} holds {unusable[name]}")
    products = plan(path, found, joint_columns.columns(path, found, joint, mapping), unusable)
    used = {name for product in products.values() for name in product.names}
    tell(path, [name for name in found if name not in used], products, unusable)
    values: dict[str, Array] = {}
    for target, product in products.items():
        parts = [found[name] for name in product.names]
        lengths = {part.size for part in parts if part.size > 1}
        if len(lengths) > 1:
            sizes = ", ".join(f"{name} has {found[name].size}" for name in product.names)
            raise JointIdError(f"{path}: {target} multiplies vectors of different lengths ({sizes}): map others")
        total = np.asarray(product.factor)
        for part in parts:
            total = total * (part if part.size > 1 else part[0])
        values[target] = np.atleast_1d(total)
        if values[target].size != values[TIME].size:
            raise JointIdError(
                f"{path}: {target} has {values[target].size} values, {TIME} has {values[TIME].size}: they must match"
            )
    recording = Recording(values.pop(TIME), values, source=str(path), joint=joint)
    tell_empty(recording)
    return recording


def joints(path: Path, mapping: Mapping[str, str]) -> tuple[str, ...]:
    """Return the names of the joints of matrices of several; () for a file of one unnamed joint."""
    found, _, mapping = _load(path, mapping)
    return joint_columns.joints(path, found, mapping)


def taken(path: Path, joint: str, mapping: Mapping[str, str]) -> list[str]:
    """Return in words which vectors with other names are read as which channels."""
    found, unusable, mapping = _load(path, mapping)
    if not joint and (of_all := joint_columns.in_words(path, found, mapping)):
        return of_all
    return in_words(plan(path, found, joint_columns.columns(path, found, joint, mapping), unusable))


def unread(path: Path, mapping: Mapping[str, str]) -> list[str]:
    """Return the vectors that no joint reads."""
    found, unusable, mapping = _load(path, mapping)
    joints_ = joint_columns.joints(path, found, mapping) or ("",)
    plans = [plan(path, found, joint_columns.columns(path, found, one, mapping), unusable) for one in joints_]
    return left_alone(found, plans)


def variables(path: Path) -> tuple[str, ...]:
    """Return the names of the real vectors and scalars in the file.

    Raises:
        JointIdError: not a MAT file, or version 7.3.
    """
    return tuple(_load(path, {})[0])


def _load(path: Path, mapping: Mapping[str, str]) -> tuple[dict[str, Array], dict[str, str], dict[str, str]]:
    """Return the vectors and scalars of the file by name, each of shape (n,), of others what they hold, and a mapping.

    The longest come first. The mapping is the user's, with the names of here.
    """
    try:
        data = scipy.io.loadmat(path)
    except NotImplementedError:
        raise JointIdError(f"{path}: MAT version 7.3 (HDF5) is not read: save it in MATLAB with -v7") from None
    except Exception as error:  # the decoder raises many kinds of errors on damaged bytes
        what = str(error) or type(error).__name__
        raise JointIdError(f"{path}: not a readable MAT file ({' '.join(what.split())}): save it again") from None
    found: dict[str, Array] = {}
    unusable: dict[str, str] = {}
    for variable, value in data.items():
        if not variable.startswith("__") and not isinstance(value, scipy.io.matlab.MatlabOpaque):
            for name, signal in _signals(variable, np.asarray(value)):
                if isinstance(signal, str):
                    unusable[name] = signal
                else:
                    found[name] = signal
    if not found:
        raise JointIdError(f"{path}: no real vector in this MAT file: save the signals as vectors or in structures")
    holders = {name.partition(".")[0] for name, signal in found.items() if signal.size > 1}
    prefix = f"{holders.pop()}." if len(holders) == 1 else ""
    short = {name.removeprefix(prefix): signal for name, signal in found.items()}
    if prefix and data[prefix[:-1]].dtype.names and len(short) == len(found):
        found, unusable = short, {name.removeprefix(prefix): what for name, what in unusable.items()}
        own = {t: [part.strip().removeprefix(prefix) for part in e.split("*")] for t, e in mapping.items()}
        mapping = {target: "*".join(parts) for target, parts in own.items()}
    # Signals before the constants beside them: an error lists the columns, and proposes to map the first ones.
    return dict(sorted(found.items(), key=lambda item: -item[1].size)), unusable, dict(mapping)


def _signals(name: str, value: NDArray[Any]) -> Iterator[tuple[str, Array | str]]:
    """Return names and values (n,) of the signals in a variable; of those that are not real, what they hold."""
    if value.dtype.names and value.size == 1:
        for field in value.dtype.names:
            yield from _signals(f"{name}.{field}", np.asarray(value.flat[0][field]))
    elif value.dtype.kind in UNUSABLE and value.size > 1:
        yield name, UNUSABLE[value.dtype.kind]
    elif value.dtype.kind in "fiub" and value.size:
        if max(value.shape, default=1) == value.size:
            yield name, value.ravel().astype(float)
        elif value.ndim == 2 and min(value.shape) <= MOST_SIGNALS:
            rows = value if value.shape[0] <= value.shape[1] else value.T
            for number, row in enumerate(rows, start=1):
                yield f"{name}.{number}", row.astype(float)
