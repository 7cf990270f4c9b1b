"""The work on one recording: read it once, fit every joint, return its rows. It runs in the processes of a pool."""

from __future__ import annotations

import json
import logging
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from joint_id_core.batch.recordings import Found
from joint_id_core.batch.row import ERROR, Row, row_of_estimate, row_of_failure, with_provenance
from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.jobs.fit_job import FitJob
from joint_id_core.jobs.given import Given, described, given_with_load, names_in, window

_ONE_AT_A_TIME = threading.Lock()  # a worker of Dask may have several threads, and a fit is made for one


@dataclass(frozen=True)
class Work:
    """How every recording is fitted.

    Attributes:
        job: its `joint` is the only one that is fitted, or None; its files are those of each recording.
        options: all options in words (JSON), for the table.
        files: name and content of the files that the job names, by its field: another machine may not have them.
    """

    job: FitJob
    options: str
    files: Mapping[str, tuple[str, bytes]] = field(default_factory=dict)

    def rows(self, found: Found) -> list[Row]:
        """Return a row a joint of a recording; what is wrong with it is a row, too."""
        with _ONE_AT_A_TIME, _warnings() as warnings, self._here() as job:
            try:
                return self._rows(found, job, warnings)
            except Exception as error:  # an error that is not foreseen costs this recording only
                return [self._complete(row_of_failure(ERROR, _said(error)), found, found.joint, found.robot, warnings)]

    def _rows(self, found: Found, job: FitJob, warnings: list[str]) -> list[Row]:
        from joint_id_core import formats

        contents = formats.read_joints(found.place, job.mapping, found.joint)
        robot = found.robot or contents.namespace
        recordings = contents.recordings
        if job.joint is not None and job.joint not in recordings:
            raise JointIdError(f"{found.place} has no joint {job.joint!r}: it has {', '.join(recordings)}")
        given = _given(job, recordings)
        rows, of_all = [], len(warnings)
        for joint in recordings if job.joint is None else [job.joint]:
            del warnings[of_all:]
            try:
                result = replace(job, joint=joint or None, joints=tuple(recordings)).run(given(joint))
                options = json.dumps(dict(result.estimate.model_options), sort_keys=True)
                row = row_of_estimate(result.estimate, options)
            except Exception as error:  # also one that is not foreseen: the other joints are fitted
                row = row_of_failure(ERROR, _said(error))
            rows.append(self._complete(row, found, joint, robot, list(warnings)))
        return rows

    def failed(self, found: Found, status: str, message: str) -> list[Row]:
        """Return the row of a recording on which the work did not come to an end."""
        return [self._complete(row_of_failure(status, message), found, found.joint, found.robot, [])]

    def _complete(self, row: Row, found: Found, joint: str, robot: str, warnings: list[str]) -> Row:
        return with_provenance(row, found, joint, robot, warnings, self.options)

    @contextmanager
    def _here(self) -> Iterator[FitJob]:
        """Give the job with its files as this machine has them."""
        with tempfile.TemporaryDirectory(prefix="joint_id_") as folder:
            places: dict[str, Any] = {}
            for name, (own, content) in self.files.items():
                path = Path(folder) / name / own
                path.parent.mkdir()
                path.write_bytes(content)
                places[name] = str(path) if name == "robot" else path
            yield replace(self.job, **places)


def _given(job: FitJob, recordings: Mapping[str, Recording | JointIdError]) -> Callable[[str], Given]:
    """Return a function that gives what is fitted of a joint; it raises what was wrong with a recording."""
    description = None
    if job.urdf is not None:
        description = described(job.urdf, job.base_gravity, job.still)
        description.source = job.urdf.name  # in rows: it lies in a folder of its own here

    def part(joint: str) -> Recording:
        recording = recordings[joint]
        if isinstance(recording, JointIdError):
            raise recording
        return window(recording, job.start, job.end)

    def given(joint: str) -> Given:
        if description is None:
            return Given([part(joint)])
        known = names_in(description.joints, tuple(recordings))
        used = [name for name in recordings if known[name] in description.joints or name == joint]
        there = {known[name]: replace(part(name), joint=known[name]) for name in used}
        return given_with_load(description, known[joint], [there])

    return given


def _said(error: Exception) -> str:
    """Return what was wrong in one line."""
    text = " ".join(str(error).split())
    return text if isinstance(error, JointIdError) else f"{type(error).__name__}: {text}"


@contextmanager
def _warnings() -> Iterator[list[str]]:
    """Collect the warnings of the library, which belong into the row, and not on a terminal among many others."""
    kept: list[str] = []

    class Keep(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            kept.append(record.getMessage())

    logger, handler = logging.getLogger("joint_id_core"), Keep(logging.WARNING)
    before = logger.propagate
    logger.addHandler(handler)
    logger.propagate = False
    try:
        yield kept
    finally:
        logger.removeHandler(handler)
        logger.propagate = before
