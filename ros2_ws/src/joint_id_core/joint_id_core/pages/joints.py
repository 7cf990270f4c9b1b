"""The report of several joints of one recording: what is known of all of them, then of each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from html import escape

from joint_id_core.pages.contents import Contents
from joint_id_core.pages.document import Page, badge, table_of_html
from joint_id_core.pages.report import fill
from joint_id_core.pages.series import MOST
from joint_id_core.results.report import beside_others, estimated
from joint_id_core.results.status import Status


def report_of_joints(found: Mapping[str, Contents | str], source: str) -> str:
    """Return the report as one file of HTML that fetches nothing.

    The table keeps the order of the joints. Their parts follow, those of which most is known first.

    Args:
        found: by joint what its report is made of, or why there is none.
        source: what was recorded, in words.
    """
    reports = {joint: one for joint, one in found.items() if not isinstance(one, str)}
    good = sum(one.estimate.converged for one in reports.values())
    title = f"{source}: {good} of {len(found)} joints identified"
    page = Page(title, points=min(MOST, 3 * MOST // max(1, len(reports))))  # all together stay below 1 MB
    page.head(f"<h1>{escape(title)}</h1>")
    head = ("joint", "model", "status", "estimated parameters, ± 1 sigma")
    page.section("All joints", table_of_html(head, (_row(*item) for item in found.items()), ("text",)))
    for joint, one in sorted(reports.items(), key=lambda item: _usefulness(item[1].estimate.status), reverse=True):
        fill(page, one, _anchor(joint))
    return page.html()


def _usefulness(status: Status) -> int:
    """Return how much an estimate of this status tells."""
    return (status is Status.CONVERGED) + status.describes + (not status.unusable)


def _anchor(joint: str) -> str:
    return f"joint-{joint}"


def _row(joint: str, found: Contents | str) -> Iterator[str]:
    if isinstance(found, str):
        yield from (escape(joint), "-", "not fitted", escape(found))
        return
    estimate = found.estimate
    yield f'<a href="#{escape(_anchor(joint))}">{escape(joint)}</a>'
    yield escape(estimate.model)
    yield badge(estimate.status)
    values = escape(estimated(estimate))
    # Of a fit that is not good, the first sentence says why; the part about the joint says the rest.
    why = beside_others(estimate, next(iter(estimate.notes), estimate.message))
    yield values if estimate.converged else f"{escape(why)}<br>{values}"
