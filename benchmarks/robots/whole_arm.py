"""The whole arm of a UR10e: each log by itself, the logs together, and each predicted by the others.

Each is also predicted by the files that the fit of the others writes: from their numbers, read again.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from joint_id_core.arm.arm_estimate import ArmEstimate, JointValues
from joint_id_core.arm.description import Description
from joint_id_core.arm.exported import exported
from joint_id_core.arm.fit import fit_arm
from joint_id_core.arm.written import explained_by
from joint_id_core.data.recording import Recording
from robots.cases import ARM
from robots.recordings import DATA, UR10E_ALL, UR10E_NM_PER_A, ur10e

FOLDER = "ur10e"
LOADED, MASS = "ur-20_02_19_14harm50secLoad", 2.805  # kg
POINT_TO_POINT = "ur-20_01_17-ptp_10_points"  # of the same robot; by the same authors
AUTHORS_NM_PER_A = (10.0, 10.7, 8.46, 9.0, 9.48, 10.12)
INTERVAL = 1.959964  # standard deviations: 95 %
SHOWN = ("damping", "friction", "armature")
URDF = DATA / "ur10e/ur10e.urdf"
FILES = ("new.xml", "new.urdf")  # MJCF, and URDF, which holds the first rotor only


@dataclass(frozen=True)
class Row:
    """One joint.

    Attributes:
        joint: its number.
        values: by quantity, value and standard deviation from all logs.
        agree, pairs: pairs of logs whose damping and friction agree within 95 % intervals, and how many there are.
        sigma: median of their relative standard deviations, of single logs.
        held_out: least R2, in motion, of a log that the fit of the others predicts.
        in_band: least share of its rests that the band holds, whose half width in Nm is `band`.
        point_to_point: both of a log with motion from point to point, that the fit of all logs predicts; NaN without.
        off: largest distance of damping and friction from the reference, in combined standard deviations.
        cpu_s: processor time of the fit of all logs.
        link: that the joint moves; `masses`: in kg by the description and by all logs; `moved`: its centre, in m.
        files: least R2 of a log by the files that the fit of the others writes: MJCF, URDF.
    """

    joint: int
    values: dict[str, tuple[float, float]]
    agree: int
    pairs: int
    sigma: float
    held_out: float
    band: float
    in_band: float
    point_to_point: tuple[float, float]
    off: float
    cpu_s: float
    link: str
    masses: tuple[float, float]
    moved: float
    files: tuple[float, float]


def there() -> bool:
    """Whether the recordings are there."""
    return (DATA / FOLDER).is_dir()


def rows() -> list[Row]:
    """Fit, and compare."""
    description = Description.read(URDF)
    gains = {name: {"torque": 1.0} for name in description.joints}
    records = [record(name, description.joints) for name in UR10E_ALL]
    path = DATA / FOLDER / f"{POINT_TO_POINT}.csv"
    rests = record(POINT_TO_POINT, description.joints) if path.exists() else None
    begun = time.process_time()
    whole = fit_arm(description, records, gains, rests)
    cpu_s = time.process_time() - begun
    alone = [fit_arm(description, [record], gains).joints for record in records]
    others = [[r for r in records if r is not record] for record in records]
    predicted = [fit_arm(description, rest, gains, record) for rest, record in zip(others, records, strict=True)]
    files = [by_files(description, fit, record) for fit, record in zip(predicted, records, strict=True)]
    return [
        _row(j, whole, [a[j] for a in alone], [p.joints[j] for p in predicted], cpu_s, files)
        for j in range(len(description.joints))
    ]


def by_files(description: Description, fit: ArmEstimate, log: dict[str, Recording]) -> list[tuple[float, ...]]:
    """R2 of each joint by the files that are made of a fit, a row a file."""
    gains = {name: {"torque": 1.0} for name in description.joints}
    with TemporaryDirectory() as folder:
        paths = [Path(folder) / name for name in FILES]
        for path in paths:
            path.write_text(exported(fit, description, path, "joint_id"))
        return [explained_by(path, description, log, gains) for path in paths]


def payload() -> list[str]:
    """Weigh the payload of the log that has one, and find the gains from its mass, as cells of a table."""
    description = Description.read(URDF)
    gains = {name: {"torque": 1.0} for name in description.joints}
    free = [record(name, description.joints) for name in UR10E_ALL]
    carrying = [record(LOADED, description.joints)]
    weighed = fit_arm(description, free, gains, payload=carrying).payload
    assert weighed is not None
    found = [f"{weighed.mass:.4g} ± {weighed.mass_std_dev:.2g} kg"]
    for factor in fit_arm(description, free, gains, payload=carrying, mass=MASS).factors:
        gain = UR10E_NM_PER_A[len(found)]
        found.append(f"{gain * factor.value:.3g} ± {gain * factor.std_dev:.2g}")
    return found


def payload_table(cells: Sequence[str]) -> str:
    """What was found beside what is known."""
    head = ["", f"payload, {MASS} kg", *(f"gain of joint {j}, Nm/A" for j in UR10E_NM_PER_A)]
    rows = [
        head, ["---"] * len(head), ["found", *(cells or ["-"] * (len(head) - 1))],
        ["config/ur10e.yaml", "-", *(f"{g:g}" for g in UR10E_NM_PER_A.values())],
        ["the data's authors", "-", *(f"{g:g}" for g in AUTHORS_NM_PER_A)],
    ]  # fmt: skip
    return "\n".join("| " + " | ".join(row) + " |" for row in rows)


def record(name: str, joints: Sequence[str]) -> dict[str, Recording]:
    """All joints of a log, by name."""
    return {joint: replace(ur10e(name, k), joint=joint) for k, joint in enumerate(joints, 1)}


def _row(
    j: int,
    fit: ArmEstimate,
    alone: Sequence[JointValues],
    predicted: Sequence[JointValues],
    cpu_s: float,
    files: Sequence[Sequence[tuple[float, ...]]],
) -> Row:
    whole, link = fit.joints[j], fit.links.links[j]
    found = [(a.damping, a.friction) for a in alone]
    agree = [
        abs(x.value - y.value) < INTERVAL * np.hypot(x.std_dev, y.std_dev)
        for one, other in combinations(found, 2)
        for x, y in zip(one, other, strict=True)
    ]
    off = [
        (value.value - ARM[j + 1][name].value) / np.hypot(value.std_dev, ARM[j + 1][name].spread)
        for name, value in (("c", whole.damping), ("tau_f", whole.friction))
    ]
    values = {name: (getattr(whole, name).value, getattr(whole, name).std_dev) for name in SHOWN}
    sigma = float(np.median([v.std_dev / v.value for pair in found for v in pair]))
    held_out, in_band = min(p.held_out for p in predicted), min(p.rest.held for p in predicted)
    mjcf, urdf = (min(of_log[k][j] for of_log in files) for k in range(len(FILES)))
    return Row(
        j + 1, values, sum(map(bool, agree)), len(agree), sigma, held_out, whole.rest.band, in_band,
        (whole.held_out, whole.rest.held), max(off, key=abs), cpu_s,
        link.name, (link.described.mass, link.found.mass), link.moved, (mjcf, urdf),
    )  # fmt: skip


def table(found: Sequence[Row]) -> str:
    """A row a joint."""
    head = ["joint", "damping, Nm s/rad", "Coulomb friction, Nm", "armature, kg m²", "pairs that agree", "median sigma",
            "friction off", "held-out R² in motion, least", "band at rest, ± Nm", "held-out rests in it, least",
            "point to point: R² in motion", "rests in the band"]  # fmt: skip
    lines = ["| " + " | ".join(head) + " |", "| " + " | ".join("---" for _ in head) + " |"]
    for row in found:
        cells = [str(row.joint), *(f"{v:.3g} ± {s:.2g}" for v, s in row.values.values())]
        cells += [f"{row.agree} of {row.pairs}", f"{100.0 * row.sigma:.2g} %", f"{row.off:+.2g}", f"{row.held_out:.4f}"]
        moving, resting = row.point_to_point
        cells += [f"{row.band:.3g}", f"{100.0 * row.in_band:.0f} %"]
        cells += [f"{moving:.4f}", f"{100.0 * resting:.0f} %"] if np.isfinite(moving) else ["-", "-"]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def links_table(found: Sequence[Row]) -> str:
    """What became of the links, and what the written files predict, a row a link."""
    head = ["link", "mass, kg, description", "found", "centre moved, mm", "held-out R², least, fit", "MJCF",
            "URDF, first rotor only"]  # fmt: skip
    lines = ["| " + " | ".join(head) + " |", "| " + " | ".join("---" for _ in head) + " |"]
    for row in found:
        described, mass = row.masses
        cells = [f"`{row.link}`", f"{described:.4g}", f"{mass:.4g}", f"{1e3 * row.moved:.3g}"]
        cells += [f"{value:.4f}" for value in (row.held_out, *row.files)]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)
