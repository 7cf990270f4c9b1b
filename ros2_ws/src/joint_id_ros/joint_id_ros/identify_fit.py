"""The fit of a recording of the node `identify`, in a process of its own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from joint_id_core import formats
from joint_id_core.cli.report import fitted
from joint_id_core.errors import JointIdError
from joint_id_core.pages.contents import Contents
from joint_id_core.pages.joints import report_of_joints
from joint_id_core.pages.report import report
from joint_id_core.results.estimate import Estimate
from joint_id_core.text_file import write_text
from joint_id_ros.child_process import Tell
from joint_id_ros.identify_request import Request

Fitted = Mapping[str, Estimate | str]  # by joint the estimate, or why there is none
Spans = Mapping[str, tuple[float, float] | None]  # by joint the first and last instant to fit, s since the epoch


def fit(tell: Tell, request: Request, bag: Path, spans: Spans, page: Path) -> Fitted:
    """Fit joints of a recording one after the other, and write a page about them.

    Args:
        tell: called with the progress.
        request: what is to be identified.
        bag: the recording.
        spans: of the joints that are fitted; None for all of the recording.
        page: file to write.
    """
    found: dict[str, Contents | str] = {}
    for k, (joint, span) in enumerate(spans.items()):
        tell(k / len(spans), f"fitting {joint}")
        try:
            start, end = None, None
            if span is not None:
                recording = formats.read(bag, joint)
                first = recording.origin + float(recording.time[0])
                start, end = (round(max(0.0, instant - first), 3) for instant in span)
            job = request.job(bag, joint, start, end)
            found[joint] = replace(fitted(job, lambda _: None), command=request.command(job))
        except JointIdError as error:
            found[joint] = str(error)
    tell(1.0, "writing the report")
    (first_found,) = list(found.values())[:1]
    alone = len(found) == 1 and not isinstance(first_found, str)
    write_text(page, report(first_found) if alone else report_of_joints(found, bag.name), "the report")  # type: ignore[arg-type]
    return {
        joint: one if isinstance(one, str) else replace(one.estimate, predictions=None) for joint, one in found.items()
    }
