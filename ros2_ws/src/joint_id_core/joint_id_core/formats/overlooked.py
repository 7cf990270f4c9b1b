"""Columns that are of no use although they seem to be meant: a unit that is not known, a typing error, text, empty."""

from __future__ import annotations

import logging
import shlex
from collections.abc import Collection, Iterator, Mapping
from difflib import get_close_matches
from pathlib import Path

from joint_id_core.data.recording import Recording
from joint_id_core.data.signals import CHANNELS
from joint_id_core.formats.column_names import TIME, TIMES, factor_of, parts, unit_of
from joint_id_core.formats.joint_columns import is_of_a_joint, understood

log = logging.getLogger(__name__)
CLOSE = 0.8  # of a name that is a typing error; `torque_cmd` is none
KNOWN = {"timestamp": TIME, "time": TIME, TIME: TIME} | {name: name for name in CHANNELS}


def tell(
    path: Path, found: Collection[str], targets: Collection[str], unusable: Mapping[str, str] | None = None
) -> None:
    """Log which columns are not read as the channels that they seem to be; see `overlooked`."""
    for _, text in overlooked(found, targets, unusable or {}):
        log.warning("%s: %s", path, text)


def tell_empty(recording: Recording) -> None:
    """Log which channels have no value."""
    for name in recording.channels:
        if not recording.measured(name):
            log.warning(
                "%s: %s is empty, no sample has a value: record it, or take another column (--map %s=COLUMN)",
                recording.source, name, name,
            )  # fmt: skip


def overlooked(
    found: Collection[str], targets: Collection[str], unusable: Mapping[str, str]
) -> Iterator[tuple[str, str]]:
    """Yield the target that a column seems to be, and in words why it is not read as this.

    Args:
        found: the columns.
        targets: those that are read already, from whichever column.
        unusable: by name of another variable, what it holds instead of real numbers and what to do.
    """
    for column, what in unusable.items():
        known = understood(column)
        target = _target(parts(column)[0]) or (known[1] if known is not None else "")
        if target and target not in targets:
            yield target, f"{column!r} is not read as {target}: it holds {what}"
    for column in found:
        name, unit = parts(column)
        target = _target(name)
        close = [] if target else get_close_matches(name, KNOWN, n=1, cutoff=CLOSE)
        meant = target or next((KNOWN[one] for one in close), "")
        if not meant or meant in targets or is_of_a_joint(column):
            continue
        factor = factor_of(meant, unit)
        number = "FACTOR*" if factor is None else "" if factor == 1.0 else f"{factor:.6g}*"
        why = f" (did you mean {meant}?)" if close else ""
        if factor is None:
            why += f": {unit!r} is not known as a unit of {meant}, which is in {unit_of(meant)}"
        yield meant, f"{column!r} is not read{why}: name it, --map {shlex.quote(f'{meant}={number}{column}')}"


def _target(name: str) -> str:
    """Return the target that has this name; "" if none has."""
    return TIME if name in TIMES else name if name in CHANNELS else ""
