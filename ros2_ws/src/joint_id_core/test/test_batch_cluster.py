"""A batch on a cluster of Dask, whose workers die."""

from __future__ import annotations

import importlib
import os
import signal

import pytest

from joint_id_core.batch import cluster as batch_cluster
from joint_id_core.batch.cluster import on_cluster
from joint_id_core.batch.recordings import find
from joint_id_core.batch.run import run
from joint_id_core.errors import JointIdError

from .many_recordings import CRASHING, assert_same, rows, run_here, work, write_bags

distributed = pytest.importorskip("distributed")


@pytest.fixture
def open_cluster():
    opened = []

    def call(workers):
        opened.append(
            distributed.LocalCluster(
                n_workers=workers, threads_per_worker=1, processes=True, dashboard_address=None, host="127.0.0.1"
            )
        )
        return opened[-1]

    yield call
    for one in opened:
        one.close(timeout=30.0)


@pytest.mark.long
def test_a_worker_that_is_killed_loses_nothing_and_doubles_nothing(tmp_path, open_cluster):
    bags = write_bags(tmp_path, 10)
    run_here(bags, tmp_path / "undisturbed.parquet")
    cluster, killed = open_cluster(2), []

    def pool(work, found):
        for count, done in enumerate(on_cluster(work, found, cluster.scheduler_address)):
            if count == 1:  # all others are with the workers
                killed.append(next(iter(cluster.workers.values())).pid)
                os.kill(killed[0], signal.SIGKILL)
            yield done

    output = tmp_path / "out.parquet"
    done = run(find([str(b) for b in bags]), work(), str(output), pool)
    assert killed and (done.fitted, done.failed) == (10, 0)
    found, expected = rows(output), rows(tmp_path / "undisturbed.parquet")
    assert len(found) == 10
    assert_same(found, expected)


@pytest.mark.long
def test_a_recording_that_kills_its_workers_is_a_row(tmp_path, open_cluster, monkeypatch):
    bags = write_bags(tmp_path, 3)
    (tmp_path / "crashing_on_workers.py").write_text(CRASHING)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")]))
    crashing = importlib.import_module("crashing_on_workers").Crashing(work().job, "{}")
    cluster = open_cluster(1)
    cluster.scheduler.allowed_failures = 0  # three by default, which takes as many new workers
    output = tmp_path / "out.parquet"
    found = find([str(b) for b in bags])
    done = run(found, crashing, str(output), lambda w, f: on_cluster(w, f, cluster.scheduler_address))
    told = {os.path.basename(r["recording"]): r["status"] for r in rows(output)}
    assert done.failed >= 1 and told["a_1"] == "crashed" and len(told) == 3


@pytest.mark.long
def test_a_scheduler_that_ends_keeps_what_is_finished(tmp_path, open_cluster):
    bags = write_bags(tmp_path, 6)
    cluster = open_cluster(1)

    def pool(work, found):
        for count, done in enumerate(on_cluster(work, found, cluster.scheduler_address)):
            yield done
            if count == 1:
                cluster.close(timeout=30.0)

    output = tmp_path / "out.parquet"
    with pytest.raises(JointIdError, match=r"the connection was lost: what is finished is kept"):
        run(find([str(b) for b in bags]), work(), str(output), pool)
    done = run_here(bags, output)
    assert done.before >= 2 and done.before + done.fitted == 6 and len(rows(output)) == 6


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nonsense://x"])
def test_a_cluster_that_is_not_there_is_said(tmp_path, run, address, monkeypatch):
    monkeypatch.setattr(batch_cluster, "PATIENCE_S", 1.0)
    (bag,) = write_bags(tmp_path, 1)
    code, _, err = run("batch", bag, "-o", tmp_path / "out.parquet", "--dask", address)
    assert code == 2 and f"--dask {address}: no scheduler answers" in err and "start one with dask scheduler" in err


@pytest.mark.long
def test_a_cluster_without_workers_and_one_of_another_version_are_said(tmp_path, open_cluster, monkeypatch):
    monkeypatch.setattr(batch_cluster, "PATIENCE_S", 5.0)
    cluster = open_cluster(0)
    with pytest.raises(JointIdError, match="the scheduler has no worker"):
        next(on_cluster(work(), [], cluster.scheduler_address))
    monkeypatch.setattr(batch_cluster, "PATIENCE_S", 60.0)
    cluster.scale(1)
    here = batch_cluster.versions()
    monkeypatch.setattr(batch_cluster, "_here", lambda: "joint-id-core 9.9")
    with pytest.raises(JointIdError, match=f"has {here}, here is joint-id-core 9.9"):
        next(on_cluster(work(), [], cluster.scheduler_address))


def test_jobs_and_a_cluster_exclude_each_other(tmp_path, run):
    code, _, err = run("batch", tmp_path, "-o", tmp_path / "out.parquet", "--dask", "tcp://host:1", "--jobs", "2")
    assert code == 2 and "--jobs and --dask exclude each other" in err
