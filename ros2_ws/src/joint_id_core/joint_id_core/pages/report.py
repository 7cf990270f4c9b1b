"""The report of a fit as a page: what is known, how well, why, and what the recording is worth."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from typing import Any

import numpy as np
import scipy

from joint_id_core.data.quantities import known_digits, two_digits, unit_text, with_deviation, with_unit
from joint_id_core.data.recording import Array, Recording
from joint_id_core.data.signals import CHANNELS
from joint_id_core.errors import JointIdError
from joint_id_core.estimators import Regression
from joint_id_core.pages.contents import Contents
from joint_id_core.pages.document import Page, badge, listed, paragraph, table
from joint_id_core.pages.series import MOST, plot
from joint_id_core.results.difference import differences
from joint_id_core.results.estimate import Estimate, ParameterEstimate, Predictions
from joint_id_core.results.verdict import Verdict

WIDE = 1.96  # standard deviations, half of a 95 % interval
TOO_WIDE = 0.3  # standard deviation over the value
SPARSE = 0.5  # share of known samples from which a signal is one that comes seldom, as a temperature does
MOST_SUSPECTS = 50  # samples that are shown
NO_TREND = (Verdict.FIXED, Verdict.NOT_EXCITED)


def report(contents: Contents) -> str:
    """Return the report as one file of HTML that fetches nothing."""
    page = Page(f"{_name(contents.estimate)}, {contents.estimate.status.value}")
    fill(page, contents)
    return page.html()


def fill(page: Page, contents: Contents, anchor: str = "") -> None:
    """Add all that is known of one joint to a page; `anchor` is its name for links."""
    contents = contents.by_name()
    estimate, recording = contents.estimate, contents.recording
    origin = float(recording.time[0]) if recording is not None and len(recording) else 0.0
    page.head(*_head(contents), anchor=anchor)
    page.section("Parameters", _parameters(estimate))
    page.section("What this motion does not show", *_unknown(contents))
    if estimate.predictions is not None:
        page.section("Measured and predicted", *_predictions(page, estimate, estimate.predictions, origin))
    if recording is not None:
        page.section("Inputs", *_inputs(page, estimate, recording, origin))
    page.section("While the motion goes on", *_windows(page, contents, origin))
    page.section("Samples that were not fitted", *_held_out(contents))
    page.section("Correlations", *_correlations(estimate))
    if contents.earlier is not None:
        page.section("Compared with an earlier estimate", *_earlier(contents.earlier, estimate))
    if recording is not None:
        page.section("The recording", *_recording(recording, contents))
    page.section(
        "How to repeat it", f"<pre>{escape(contents.command)}</pre>" if contents.command else "", _how(estimate)
    )


def _name(estimate: Estimate) -> str:
    return f"{estimate.joint or 'joint'}: {estimate.model}"


def _head(contents: Contents) -> Iterator[str]:
    estimate = contents.estimate
    yield f"<h1>{escape(_name(estimate))} {badge(estimate.status)}</h1>"
    yield f'<p class="message">{escape(estimate.message)}</p>' if estimate.message else ""
    yield listed(note for note in estimate.notes if note not in estimate.message)
    yield paragraph(f"{estimate.source}; {estimate.samples} samples, {estimate.end - estimate.start:.3g} s of motion")
    yield listed(contents.why)


def _parameters(estimate: Estimate) -> str:
    head = ("parameter", "value", "± (95 %)", "", "unit", "verdict", "reason")
    return table(head, [_row(p) for p in estimate.parameters], ("word", "text"))


def _row(p: ParameterEstimate) -> tuple[str, ...]:
    share = f"{two_digits(100.0 * WIDE * p.std_dev / abs(p.value))} %" if math.isfinite(p.std_dev) and p.value else ""
    return p.name, value_text(p), interval(p), share, unit_text(p.unit), p.verdict.value, p.reason


def value_text(p: ParameterEstimate) -> str:
    """Return the value of a parameter in the digits of its 95 % interval."""
    return known_digits(p.value, WIDE * p.std_dev)


def interval(p: ParameterEstimate) -> str:
    """Return half of the 95 % interval, such as "± 750"; empty for a parameter that is held."""
    return f"± {two_digits(WIDE * p.std_dev)}" if math.isfinite(p.std_dev) else ""


def _unknown(contents: Contents) -> Iterator[str]:
    estimate = contents.estimate
    unknown = [p for p in estimate.parameters if p.name in estimate.free and p.verdict is not Verdict.ESTIMATED]
    if unknown:
        yield listed(f"{p.name} ({p.verdict.value}): {p.reason}" for p in unknown)
    if contents.motion:
        yield paragraph("A motion that shows more, within the limits of your joint:")
        yield f"<pre>{escape(contents.motion)}</pre>"


def _predictions(page: Page, estimate: Estimate, shown: Predictions, origin: float) -> Iterator[str]:
    yield '<p class="hint">Drag over a plot to zoom in, click twice to zoom out.</p>'
    if estimate.estimator != Regression.name:
        yield paragraph("Predictions begin anew at the filtered state every 0.1 s: their errors grow from there.")
    for plot_ in prediction_plots(shown, origin, page.points):
        yield page.figure(plot_)


def prediction_plots(shown: Predictions, origin: float, most: int = MOST) -> Iterator[dict[str, Any]]:
    """Return plots of measured and predicted labels, of their differences and of the spectra of these.

    `most` as in `series.plot`.
    """
    time = shown.time - origin
    for name, predicted in shown.predicted.items():
        measured, unit = shown.measured[name], CHANNELS[name].unit if name in CHANNELS else ""
        label = name.replace("_", " ")
        both = {"measured": measured, "predicted": predicted}
        yield plot(f"{label} [{unit}]", time, both, dots=("measured",), most=most)
        error = predicted - measured
        yield plot(f"error of {label} [{unit}]", time, {"predicted - measured": error}, most=most)
        spectrum = _spectrum(time, error)
        if spectrum is not None:
            density = {"residual": spectrum[1]}
            title = f"spectrum of the error of {label} [({unit})²/Hz]"
            yield plot(title, spectrum[0], density, "frequency [Hz]", log=True, most=most)


def _spectrum(time: Array, error: Array) -> tuple[Array, Array] | None:
    """Return frequencies in Hz and the power density of an error (T,), over its longest stretch without a gap."""
    period = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
    ends = np.flatnonzero((np.diff(time) > 1.5 * period) | ~np.isfinite(np.diff(error))) + 1
    stretch = max(np.split(np.arange(len(time)), ends), key=len)
    row = error[stretch][np.isfinite(error[stretch])]
    if len(row) < 64:
        return None
    f, power = scipy.signal.welch(row, 1.0 / period, nperseg=min(len(row), 1024))
    seen = (f > 0.0) & (power > 0.0)
    return f[seen], power[seen]


def _inputs(page: Page, estimate: Estimate, recording: Recording, origin: float) -> Iterator[str]:
    shown = estimate.predictions.predicted if estimate.predictions is not None else {}
    time = recording.time - origin
    for name in recording.channels:
        if recording.measured(name) and name not in shown:
            label = f"{name.replace('_', ' ')} [{CHANNELS[name].unit}]"
            known = np.isfinite(recording[name])
            if np.mean(known) > SPARSE:  # gaps stay gaps; but single samples that come seldom are no line
                known[:] = True
            yield page.figure(plot(label, time[known], {name: recording[name][known]}, most=page.points))


def _windows(page: Page, contents: Contents, origin: float) -> Iterator[str]:
    found = [e for e in contents.windows if e.free]
    if not found:
        return
    regression = contents.estimate.estimator == Regression.name
    who = "a regression of all samples so far" if regression else "the online identifier"
    yield paragraph(f"What {who} says at each moment, with 95 % intervals, and the values above (level).")
    time = np.array([e.end for e in found]) - origin
    names = [n for n in found[-1].free if all(n in e.free for e in found)]
    course = {n: tuple(np.array([getattr(e[n], f) for e in found]) for f in ("value", "std_dev")) for n in names}
    levels = {"all samples": contents.estimate.values}
    for plot_ in trend_plots(contents.estimate.parameters, time, course, "so far", levels):
        yield page.figure(plot_)


def trend_plots(
    parameters: Sequence[ParameterEstimate],
    time: Array,
    course: Mapping[str, tuple[Array, ...]],
    name: str,
    levels: Mapping[str, Mapping[str, float]],
) -> Iterator[dict[str, Any]]:
    """Return a plot for each parameter that is known: its values with 95 % intervals, beside levels.

    Args:
        parameters: the newest estimates.
        time: instants in s, shape (T,).
        course: value and standard deviation by parameter, each of shape (T,).
        name: of the values.
        levels: constant values by parameter, by what they are called.
    """
    for p in parameters:
        if p.name not in course or p.verdict in NO_TREND:
            continue
        values, sigmas = course[p.name]
        known = sigmas < np.fmax(TOO_WIDE * np.abs(values), 2.0 * p.std_dev)  # wider ones would hide the others
        if known.any():
            rows = {n: np.full(len(time), level[p.name]) for n, level in levels.items() if p.name in level}
            rows[name] = np.where(known, values, np.nan)  # over the levels
            bands = {name: np.where(known, WIDE * sigmas, np.nan)}
            yield plot(with_unit(p.name, p.unit), time, rows, bands=bands)


def _held_out(contents: Contents) -> Iterator[str]:
    if contents.held_out:
        yield paragraph("A fit of the first 70 % of the samples predicts the others:")
        yield table(("signal", "prediction"), contents.held_out, ("text",))


def _correlations(estimate: Estimate) -> Iterator[str]:
    sd = np.sqrt(np.diag(estimate.covariance))
    known = [k for k, s in enumerate(sd.tolist()) if math.isfinite(s) and s > 0.0]
    if len(known) < 2:
        return
    names = [estimate.free[k] for k in known]
    r = (estimate.covariance / np.outer(sd, sd))[np.ix_(known, known)] if (sd > 0.0).all() else np.eye(len(known))
    head = "".join(f"<th>{escape(n)}</th>" for n in ("", *names))
    rows = "".join(
        f"<tr><th>{escape(n)}</th>"
        + "".join(f'<td style="background:{_shade(v)}">{v:+.2f}</td>' for v in row.tolist())
        + "</tr>"
        for n, row in zip(names, r, strict=True)
    )
    yield f'<div class="wide"><table class="matrix"><tr>{head}</tr>{rows}</table></div>'


def _shade(r: float) -> str:
    return f"rgba({'31,111,178' if r > 0.0 else '196,85,45'},{0.6 * min(1.0, abs(r)):.2f})"


def _earlier(earlier: Estimate, estimate: Estimate) -> Iterator[str]:
    yield paragraph(f"The earlier one: {earlier.source or 'source not known'}, {earlier.status.value}.")
    try:
        rows = differences(earlier, estimate)
    except JointIdError as error:
        yield paragraph(f"Not compared: {error}")
        return
    cells = [
        (d.name, *(with_deviation(p.value, p.std_dev) for p in (d.before, d.after)), unit_text(d.after.unit), d.text)
        for d in rows
    ]
    yield table(("parameter", "earlier, ± 1 sigma", "now, ± 1 sigma", "unit", "change"), cells, ("text",))


def _recording(recording: Recording, contents: Contents) -> Iterator[str]:
    rate = f"{1.0 / recording.period:.6g} Hz" if len(recording) > 1 else "-"
    yield paragraph(
        f"{len(recording)} samples, {recording.duration:.6g} s, {rate}, {recording.gaps} gaps. Missing values: "
        + (", ".join(_missing(recording)) or "none")
        + "."
    )
    yield listed(contents.doubts) or paragraph("The checks found nothing wrong.")
    if contents.suspects:
        more = len(contents.suspects) - MOST_SUSPECTS
        yield paragraph("Samples that the checks doubt" + (f", and {more} more:" if more > 0 else ":"))
        yield table(("channel", "sample", "time [s]", "before", "value", "after"), _suspects(recording, contents))


def _suspects(recording: Recording, contents: Contents) -> Iterator[tuple[str, ...]]:
    for name, k in contents.suspects[:MOST_SUSPECTS]:
        beside = (f"{recording[name][j]:.6g}" if 0 <= j < len(recording) else "-" for j in (k - 1, k, k + 1))
        yield name, str(k), f"{recording.time[k]:.6g}", *beside


def _missing(recording: Recording) -> Iterator[str]:
    for name, values in recording.channels.items():
        count = int(np.count_nonzero(~np.isfinite(values)))
        if count and name not in recording.derived:
            yield f"{name} {count}"


def _how(estimate: Estimate) -> str:
    options = ", ".join(f"{n} = {v}" for n, v in estimate.model_options.items())
    starts = ", ".join(f"{p.name} = {p.initial:.6g}" for p in estimate.parameters if math.isfinite(p.initial))
    held = ", ".join(f"{p.name} = {p.value:.6g}" for p in estimate.parameters if p.name not in estimate.free)
    return listed(
        text
        for text in (
            f"model {estimate.model}" + (f" with {options}" if options else ""),
            f"estimator {estimate.estimator}, cell {estimate.cell}",
            f"start values: {starts}" if starts else "",
            f"held: {held}" if held else "",
        )
        if text
    )
