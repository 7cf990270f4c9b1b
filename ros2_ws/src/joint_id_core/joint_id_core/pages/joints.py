"""The report of several joints of one recording: what is known of all of them, then of each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from html import escape

from joint_id_core.pages.contents import Contents
from joint_id_core.pages.document import Page, badge
from joint_id_core.pages.report import fill
from joint_id_core.pages.series import MOST
from joint_id_core.results.verdict import Verdict


def report_of_joints(found: Mapping[str, Contents | str], source: str) -> str:
    """Return the report as one file of HTML that fetches nothing.

    Args:
        found: by joint what its report is made of, or why there is none.
        source: what was recorded, in words.
    """
    reports = {joint: one for joint, one in found.items() if not isinstance(one, str)}
    good = sum(one.estimate.converged for one in reports.values())
    title = f"{source}: {good} of {len(found)} joints identified"
    page = Page(title, points=min(MOST, 3 * MOST // max(1, len(reports))))  # all together stay below 1 MB
    page.head(f"<h1>{escape(title)}</h1>")
    page.section("All joints", _table(found))
    for joint, one in reports.items():
        fill(page, one, _anchor(joint))
    return page.html()


def _anchor(joint: str) -> str:
    return f"joint-{joint}"


def _table(found: Mapping[str, Contents | str]) -> str:
    head = "".join(f"<th>{name}</th>" for name in ("joint", "model", "status", "estimated parameters, ± 1 sigma"))
    rows = "".join(f"<tr>{''.join(f'<td>{cell}</td>' for cell in _row(*item))}</tr>" for item in found.items())
    return f'<div class="wide"><table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div>'


def _row(joint: str, found: Contents | str) -> Iterator[str]:
    if isinstance(found, str):
        yield from (escape(joint), "-", "not fitted", escape(found))
        return
    estimate = found.estimate
    yield f'<a href="#{escape(_anchor(joint))}">{escape(joint)}</a>'
    yield escape(estimate.model)
    yield badge(estimate.status)
    known = [p for p in estimate.parameters if p.verdict is Verdict.ESTIMATED]
    values = ", ".join(f"{p.name} {p.value:.4g} ± {p.std_dev:.2g} {p.unit}" for p in known)
    # Of a fit that is not good, the first sentence says why; the part about the joint says the rest.
    yield escape(values) if estimate.converged else f"{escape(estimate.notes[0])}<br>{escape(values)}"
