"""The work on one recording: read it once, fit every joint, return its rows. It runs in the processes of a pool."""

from __future__ import annotations

import json
import logging
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from joint_id_core.batch.recordings import Found
from joint_id_core.batch.row import ERROR, Row, row_of_estimate, row_of_failure, with_provenance
from joint_id_core.errors import JointIdError
from joint_id_core.jobs.fit_job import FitJob
from joint_id_core.jobs.given import Given, window

_ONE_AT_A_TIME = threading.Lock()  # a worker of Dask may have several threads, and a fit is made for one


@dataclass(frozen=True)
class Work:
    """How every recording is fitted.

    Attributes:
        job: its `joint` is the only one that is fitted, or None; its files are those of each recording.
        options: all options in words (JSON), for the table.
        robot_file: name and content of the file that `job.robot` names: another machine may not have it.
    """

    job: FitJob
    options: str
    robot_file: tuple[str, bytes] | None = None

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
        if job.joint is not None:
            if job.joint not in recordings:
                raise JointIdError(f"{found.place} has no joint {job.joint!r}: it has {', '.join(recordings)}")
            recordings = {job.joint: recordings[job.joint]}
        rows, of_all = [], len(warnings)
        for joint, recording in recordings.items():
            del warnings[of_all:]
            try:
                if isinstance(recording, JointIdError):
                    raise recording
                given = Given([window(recording, job.start, job.end)])
                result = replace(job, joint=joint or None).run(given)
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
        """Give the job with the robot's file as this machine has it."""
        if self.robot_file is None:
            yield self.job
            return
        name, content = self.robot_file
        with tempfile.TemporaryDirectory(prefix="joint_id_") as folder:
            path = Path(folder) / name
            path.write_bytes(content)
            yield replace(self.job, robot=str(path))


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
