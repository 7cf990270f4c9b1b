"""`joint-id info`: show the contents of a recording."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Optional

import typer

from joint_id_core.assignments import texts_by_name
from joint_id_core.cli.output import print_json

if TYPE_CHECKING:
    from joint_id_core.data.recording import Recording


def info(
    file: Annotated[Path, typer.Argument(help="CSV, MAT or bag")],
    joint: Annotated[Optional[str], typer.Option(help="only this joint of a bag")] = None,
    map_: Annotated[Optional[list[str]], typer.Option("--map", help="channel=column, as for fit")] = None,
    json: Annotated[bool, typer.Option("--json", help="machine-readable result")] = False,
) -> None:
    """Show joints, channels, rate, gaps and missing values of a recording, and what is doubtful about it."""
    from joint_id_core import formats
    from joint_id_core.formats.mapping import listed
    from joint_id_core.jobs.given import Part

    mapping = texts_by_name(map_ or (), "--map")
    found = formats.joints(file, mapping)
    names = (joint,) if joint else found
    contents = formats.contents(file)
    part = Part(mapping, None, None)
    recordings = list(part.read_joints(file, names).values()) if names else [part.read(file, None)]
    described = [_describe(recording) | {"findings": doubts(recording, recordings)} for recording in recordings]
    unknown = formats.unread(file, mapping)
    if json:
        print_json({"file": str(file), "contents": list(contents), "unknown": unknown, "joints": described})
        return
    print(f"{file}: {listed(contents)}")
    for text in formats.taken(file, joint, mapping):
        print(text)
    for row in described:
        _show(row)
    if unknown:
        print(f"not understood and left alone (name them with --map): {listed(unknown)}")


def _describe(recording: Recording) -> dict[str, Any]:
    """Return a description of one joint; times in s, rate in Hz, values in SI units."""
    import numpy as np

    from joint_id_core.data.signals import CHANNELS
    from joint_id_core.estimators.exact_ratio import exact_ratio

    ratio = exact_ratio(recording) if len(recording) > 1 else None
    channels = []
    for name, values in recording.channels.items():
        finite = values[np.isfinite(values)]
        channels.append(
            {
                "name": name,
                "unit": CHANNELS[name].unit,
                "derived": name in recording.derived,
                "minimum": float(finite.min()) if finite.size else None,
                "maximum": float(finite.max()) if finite.size else None,
                "missing": int(values.size - finite.size),
            }
        )
    return {
        "joint": recording.joint,
        "samples": len(recording),
        "start_s": recording.origin + float(recording.time[0]) if len(recording) else None,
        "duration_s": recording.duration,
        "rate_hz": 1.0 / recording.period if len(recording) > 1 else None,
        "gaps": recording.gaps,
        "gear_ratio": dict(zip(("value", "std_dev"), ratio, strict=True)) if ratio else None,
        "channels": channels,
    }


def doubts(recording: Recording, all_joints: Sequence[Recording]) -> list[dict[str, Any]]:
    """Return what the checks find, fatal findings first, as plain types."""
    from joint_id_core.checking.finding import Finding
    from joint_id_core.checking.findings import findings
    from joint_id_core.checking.others import others_move
    from joint_id_core.estimators.regression.drive_lag import drive_lag

    found = [*findings(recording), *others_move(recording, all_joints)]
    late = "" if any(f.fatal for f in found) else drive_lag(recording)
    found += [Finding(late[:1].upper() + late[1:])] if late else []
    return [{"text": f.text, "channels": list(f.channels), "fatal": f.fatal, "samples": list(f.samples)} for f in found]


def _show(row: dict[str, Any]) -> None:
    from joint_id_core.data.quantities import with_deviation

    rate = f", {row['rate_hz']:.6g} Hz" if row["rate_hz"] else ""
    name = f"joint {row['joint']}: " if row["joint"] else ""
    print(f"\n{name}{row['samples']} samples, {row['duration_s']:.6g} s{rate}, {row['gaps']} gaps")
    print(f"  {'channel':<20}{'minimum':>13}{'maximum':>13}  {'unit':<9}{'missing':>8}")
    for c in row["channels"]:
        low, high = (f"{v:.5g}" if v is not None else "-" for v in (c["minimum"], c["maximum"]))
        mark = "  derived" if c["derived"] else ""
        print(f"  {c['name']:<20}{low:>13}{high:>13}  {c['unit']:<9}{c['missing']:>8}{mark}")
    if ratio := row["gear_ratio"]:
        print(f"  the motor goes {with_deviation(ratio['value'], ratio['std_dev'])} times as far as the link")
    for finding in row["findings"]:
        print(f"  {'wrong' if finding['fatal'] else 'doubtful'}: {finding['text']}")
