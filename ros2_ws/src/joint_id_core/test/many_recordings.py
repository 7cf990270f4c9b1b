"""Recordings and runs that the tests of batches share."""

from __future__ import annotations

import pyarrow.parquet as parquet
import pytest

import joint_id_core as jid
from joint_id_core import formats
from joint_id_core.batch.cores import here
from joint_id_core.batch.recordings import find
from joint_id_core.batch.run import run
from joint_id_core.batch.work import Work
from joint_id_core.estimators import ParameterSettings, build
from joint_id_core.jobs.fit_job import FitJob

MODEL = jid.build("rigid_joint")
COMMAND = ("--model", "rigid_joint", "--estimator", "regression")  # the quickest fits there are
# Differ from run to run: computing time, and a version of the file that a storage makes up.
ITS_OWN = ("elapsed_s",)
# A module whose work ends its process at two of the recordings.
CRASHING = """
import os
import signal

from joint_id_core.batch.work import Work


class Crashing(Work):
    def rows(self, found):
        if found.place.endswith(("a_1", "a_4")):
            os.kill(os.getpid(), signal.SIGKILL)
        return super().rows(found)
"""


def recordings(count: int, rate: float = 125.0) -> list[jid.Recording]:
    """Motions of one joint with different noise."""
    return [jid.simulate_motion(MODEL, 3.0, rate, seed=k) for k in range(count)]


def write_bags(folder, count: int, joints: int = 1) -> list:
    """Write bags `a_0`, `a_1`, ... with joints `joint_0`, ... each."""
    motions, made = recordings(count * joints), []
    for k in range(count):
        made.append(folder / f"a_{k}")
        formats.write_bag(made[-1], {f"joint_{j}": motions[k * joints + j] for j in range(joints)})
    return made


def work(options: str = "{}", **fields) -> Work:
    """Fits of `rigid_joint` by regression, the quickest there are."""
    chosen = {"model": "rigid_joint"}
    return Work(FitJob((), None, {}, None, None, chosen, ParameterSettings(), build("regression")), options, **fields)


def run_here(patterns, output, **options):
    """Run a batch in this process."""
    return run(find([str(p) for p in patterns]), work(), str(output), here, **options)


def rows(output) -> list[dict]:
    """The rows of a table, without what differs from run to run."""
    found = parquet.read_table(output).to_pylist() if not isinstance(output, bytes) else []
    return [{name: value for name, value in row.items() if name not in ITS_OWN} for row in found]


def assert_same(found: list[dict], expected: list[dict]) -> None:
    """The same fits of the same recordings; another number of threads may round otherwise."""
    for one, other in zip(found, expected, strict=True):
        assert one["recording"] == other["recording"] and one["status"] == other["status"] == "converged"
        for p, q in zip(one["parameters"], other["parameters"], strict=True):
            assert p["value"] == pytest.approx(q["value"], rel=1e-6, abs=1e-9)
