"""Mapping from columns to channels: known column names, and expressions such as `torque=gtau*vir`."""

from __future__ import annotations

import math
import re
import shlex
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

from joint_id_core.data.signals import CHANNELS
from joint_id_core.errors import JointIdError, close_to
from joint_id_core.formats.column_names import DEGREE, TIME, TIMES, factor_of, understood, without_unit
from joint_id_core.formats.joint_columns import WORDS
from joint_id_core.formats.overlooked import overlooked
from joint_id_core.formats.remote import Place

TARGETS = (TIME, *CHANNELS)


@dataclass(frozen=True)
class Product:
    """A product of a number and columns; a column that is squared appears twice."""

    factor: float
    names: tuple[str, ...]


def plan(
    path: Place, found: Collection[str], mapping: Mapping[str, str], unusable: Mapping[str, str] | None = None
) -> dict[str, Product]:
    """Determine how time and each channel are computed from the columns `found` in a file.

    Columns with a known name are taken as they are unless `mapping` names another source; those whose name and unit are
    written in another way (`column_names`) are converted. Other columns are ignored. `time_s` may have other times
    beside it.

    `unusable` says what other variables of the file hold instead of real numbers, by name.

    Returns:
        By target (`time_s`, channel names), the product to compute; in the order of `TARGETS`.

    Raises:
        JointIdError: no time, no channel, two columns for one, an unknown target, an expression that is not a product
            of columns.
    """
    unusable = unusable or {}
    targets = {name: Product(1.0, (name,)) for name in TARGETS if name in found}
    written: dict[str, list[tuple[str, float]]] = {name: [(name, 1.0)] for name in targets}
    for column in found:
        known = understood(column) if column not in TARGETS else None
        if known is not None and known[0] not in mapping and not (known[0] == TIME and TIME in targets):
            written.setdefault(known[0], []).append((column, known[1]))
    for target, ((column, factor), *others) in written.items():
        if others:
            raise JointIdError(
                f"{path}: {' and '.join(repr(c) for c, _ in written[target])} could all be {target}: rename all but "
                f"one, or say which, e.g. --map {shlex.quote(f'{target}={column}')}"
            )
        targets[target] = Product(factor, (column,))
    for target, expression in mapping.items():
        if target not in TARGETS:
            raise JointIdError(
                f"{path}: cannot map to {target!r}{close_to(target, TARGETS)}: known are {', '.join(TARGETS)}"
            )
        targets[target] = parse(path, target, expression, found)
    if TIME not in targets or len(targets) < 2:
        missing = TIME if TIME not in targets else "channel"
        meant = [why for name, why in overlooked(found, targets, unusable) if missing in (name, "channel")]
        hint = f"understood are {', '.join(TARGETS)} in SI units; name yours, e.g. {_example(found)}"
        raise JointIdError(f"{path}: no known {missing} among the columns {listed(found)}: {'; '.join(meant) or hint}")
    return {name: targets[name] for name in TARGETS if name in targets}


def parse(path: Place, target: str, expression: str, found: Collection[str]) -> Product:
    """Parse an expression such as `gtau*vir` or `0.5*q`.

    Raises:
        JointIdError: a part that is neither a number nor among the columns `found`, or no column at all.
    """
    factor, names = 1.0, []
    for part in (p.strip() for p in expression.split("*")):
        if part in found:
            names.append(part)
            continue
        try:
            number = float(part)
        except ValueError:
            number = math.nan
        if not math.isfinite(number):
            raise JointIdError(
                f"{path}: {target}={expression}: {part!r} is neither a column nor a number: the columns are "
                f"{listed(found)}"
            )
        factor *= number
    if not names:
        raise JointIdError(f"{path}: {target}={expression} uses no column: the columns are {listed(found)}")
    return Product(factor, tuple(names))


def listed(columns: Collection[str]) -> str:
    """Return names of columns as text; those of one matrix, `name.1`, `name.2` and so on, as the first to the last."""
    shown: list[str] = []
    for column in columns:
        matrix, _, number = column.rpartition(".")
        if number.isdecimal() and number != "1" and shown and shown[-1].startswith(f"{matrix}.1"):
            shown[-1] = f"{matrix}.1 to {number}"
        else:
            shown.append(column or "(without a name)")
    return ", ".join(shown)


def taken(plan_: Mapping[str, Product]) -> list[str]:
    """Return in words which columns with other names became which channels."""
    return [
        f"{target} = {'' if product.factor == 1.0 else f'{product.factor:.6g} * '}{' * '.join(product.names)}"
        for target, product in plan_.items()
        if product != Product(1.0, (target,))
    ]


def unread(found: Collection[str], plans: Iterable[Mapping[str, Product]]) -> list[str]:
    """Return the columns that none of the plans reads; one without a name, as of row numbers, is not meant to be."""
    used = {name for plan_ in plans for product in plan_.values() for name in product.names}
    return [column for column in found if column and column not in used]


def _example(found: Collection[str]) -> str:
    """Return example options that map the user's own columns."""
    own = [name for name in found if name not in TARGETS]
    time = next((c for c in found if (understood(c) or ("",))[0] == TIME), None) or _named(own, TIMES) or "t"
    position = _named([c for c in own if c != time], WORDS["link_position"]) or "q"
    options = (_option(TIME, time), _option("link_position", position))
    text = " ".join(options)
    in_degrees = f"0.0174533*{position}"
    told = without_unit(position)[1] or in_degrees in text
    return text if told else f"{text} ({in_degrees} if it is in degrees)"


def _named(columns: Sequence[str], words: Collection[str]) -> str | None:
    """Return the first column with one of these words in its name, or else the first one; None if there are none."""
    tokens = (re.split(r"[\W\d_]+", column.lower()) for column in columns)
    return next((c for c, its in zip(columns, tokens, strict=True) if {*words} & {*its}), next(iter(columns), None))


def _option(target: str, column: str) -> str:
    """Return the option that maps a column, in SI units if its name tells the unit."""
    factor = factor_of(target, without_unit(column)[1])
    if factor == 1.0 and target != TIME and "deg" in column.lower():
        factor = DEGREE
    number = f"{factor:.6g}*" if factor not in (None, 1.0) else ""
    return f"--map {shlex.quote(f'{target}={number}{column}')}"
