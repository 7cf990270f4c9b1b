"""A load that was computed from the description of an arm: a derived channel, and what estimates owe to it.

Offline and online, a load that is measured is no derived channel, and none of this applies to it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from joint_id_core.data.recording import Recording
from joint_id_core.models import Model
from joint_id_core.results.estimate import SHOWN, Estimate

LOAD = "external_torque"
# Errors of the parameters of a flexible joint, as shares of their values, which a fit does not see: vibrations of other
# joints are above the band of a computed load, or below its noise. On a simulated arm of six flexible joints the
# damping of the gear came out 9 to 56 % too large, online 15 % too small to 74 % too large; of the others few were more
# than 1 % off.
DAMPING_ERROR, ERROR = 0.5, 0.01


def computed(recording: Recording) -> bool:
    """Return whether a recording has a load that was computed."""
    return LOAD in recording.derived


def where_known(recording: Recording) -> Recording:
    """Return the samples without those at which a computed load is not known, which say nothing of the joint."""
    if not computed(recording):
        return recording
    known = np.isfinite(recording[LOAD])
    if known.all():
        return recording
    channels = {name: values[known] for name, values in recording.channels.items()}
    return recording.trusted(recording.time[known], channels, recording.derived)


def with_doubt(estimate: Estimate, model: Model) -> Estimate:
    """Return an estimate from a recording with a computed load: flexible joints are known less than the fit says."""
    damping = model.gear_damping
    if damping is None or not estimate.free:
        return estimate
    rows, scale = {p.name: p for p in estimate.parameters}, np.ones(len(estimate.free))
    for k, name in enumerate(estimate.free):
        before = rows[name].std_dev
        if not before > 0.0:
            continue
        sigma = float(np.hypot(before, _share(model, name) * rows[name].value))
        scale[k] = sigma / before
        rows[name] = replace(rows[name], std_dev=sigma)
    if damping in estimate.free:
        told = f"a computed load lacks the vibrations that show it: {100.0 * DAMPING_ERROR:.0f} % of it are doubtful"
        rows[damping] = replace(rows[damping], reason=told)
    covariance = estimate.covariance * np.outer(scale, scale)
    estimate = replace(estimate, parameters=tuple(rows.values()), covariance=covariance)
    return _with_doubtful_changes(estimate, model) if estimate.changes else estimate


def _share(model: Model, name: str) -> float:
    """Return the share of the value of a parameter that is doubtful."""
    return DAMPING_ERROR if name == model.gear_damping else ERROR * model.parameter(name).positive


def _with_doubtful_changes(estimate: Estimate, model: Model) -> Estimate:
    """Return an estimate without the changes that another motion, with other vibrations, may have made."""
    wider = []
    for change in estimate.changes:
        share = _share(model, change.name)
        before = float(np.hypot(change.before_std_dev, share * change.before))
        after = float(np.hypot(change.after_std_dev, share * change.after))
        wider.append(replace(change, before_std_dev=before, after_std_dev=after))
    told = {old.text: new.text if new.size > SHOWN else "" for old, new in zip(estimate.changes, wider, strict=True)}
    changes = tuple(change for change in wider if change.size > SHOWN)
    notes = tuple(filter(None, (told.get(note, note) for note in estimate.notes)))
    return estimate.noted(notes, changes=changes)
