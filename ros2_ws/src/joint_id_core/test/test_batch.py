"""Many recordings become one table, and nothing of them is lost or done twice."""

from __future__ import annotations

import importlib
import json
import os
import shutil
from pathlib import Path

import pytest

from joint_id_core import formats
from joint_id_core.batch import cores
from joint_id_core.batch.recordings import find
from joint_id_core.batch.run import run as run_batch

from . import moving_arm
from .many_recordings import COMMAND, CRASHING, recordings, rows, run_here, work, write_bags

SPACE = "/cell_3/ur5e"


def test_every_joint_is_a_row_with_what_was_found_and_where_it_came_from(tmp_path, run):
    write_bags(tmp_path / "ur_1", 1, 2)
    shutil.copytree(tmp_path / "ur_1", tmp_path / "ur_2")
    (tmp_path / "ur_2/a_0").rename(tmp_path / "ur_2/b")
    output = tmp_path / "out.parquet"
    code, out, err = run("batch", tmp_path / "{robot}/*/*.mcap", "-o", output, *COMMAND)
    assert (code, err) == (0, "") and "4 rows (4 converged)" in out
    found = rows(output)
    assert [(r["robot"], r["joint"], r["status"]) for r in found] == [
        (robot, joint, "converged") for robot in ("ur_1", "ur_2") for joint in ("joint_0", "joint_1")
    ]
    first = found[0]
    assert first["recording"] == str(tmp_path / "ur_1/a_0") and first["samples"] > 300
    assert first["size_bytes"] == sum(p.stat().st_size for p in (tmp_path / "ur_1/a_0").iterdir())
    assert '"model": "rigid_joint"' in first["options"] and "joint-id-core" in first["versions"]
    assert 0.0 <= first["start_s"] < 0.2 and 2.8 < first["end_s"] <= 3.0
    inertia = next(p for p in first["parameters"] if p["name"] == "J")
    assert inertia["verdict"] == "estimated" and abs(inertia["value"] - 1.0) < 4.0 * inertia["std_dev"]
    k = first["free"].index("J")
    assert first["covariance"][k * len(first["free"]) + k] == pytest.approx(inertia["std_dev"] ** 2)
    assert not Path(f"{output}.parts").exists()


def test_the_rows_are_those_of_joint_id_fit(tmp_path):
    import joint_id_core as jid

    (bag,) = write_bags(tmp_path, 1)
    run_here([bag], tmp_path / "out.parquet")
    estimate = jid.fit(jid.build("rigid_joint"), jid.read(bag), estimator=jid.Regression())
    (row,) = rows(tmp_path / "out.parquet")
    assert {p["name"]: p["value"] for p in row["parameters"]} == estimate.values
    assert row["message"] == estimate.message


def test_what_is_wrong_with_a_recording_is_a_row_and_is_done_again_on_demand(tmp_path, run, in_this_process):
    good, cut = write_bags(tmp_path, 2)
    data = next(cut.glob("*.mcap"))
    whole = data.read_bytes()
    data.write_bytes(whole[:200])
    (tmp_path / "other.csv").write_text("a,b\n1,2\n")
    (tmp_path / "notes.md").write_text("no recording")
    output = tmp_path / "out.parquet"
    code, _, err = run("batch", tmp_path, "-o", output, *COMMAND)
    assert code == 1 and "2 recordings could not be read or fitted" in err
    for place in (cut, tmp_path / "other.csv"):  # each with its reason
        (line,) = (line for line in err.splitlines() if line.startswith(f"joint-id: {place}"))
        assert line.count(str(place)) == 1 and len(line) > len(f"joint-id: {place}: ")
    assert [(Path(r["recording"]).name, r["status"]) for r in rows(output)] == [
        ("a_0", "converged"), ("a_1", "error"), ("other.csv", "error"),
    ]  # fmt: skip
    assert "damaged or truncated" in rows(output)[1]["message"] and "no known time_s" in rows(output)[2]["message"]
    code, out, _ = run("batch", tmp_path, "-o", output, *COMMAND)
    assert code == 0 and "0 recordings fitted, 3 were finished before" in out
    told = json.loads(run("batch", tmp_path, "-o", output, *COMMAND, "--json")[1])
    assert (told["fitted"], told["before"], told["rows"]) == (0, 3, {"converged": 1, "error": 2})
    stat = data.stat()
    data.write_bytes(whole)
    os.utime(data, ns=(stat.st_atime_ns, stat.st_mtime_ns))  # the size alone tells
    code, out, _ = run("batch", tmp_path, "-o", output, *COMMAND)
    assert (code, out.count("1 recording fitted, 2 were finished before")) == (0, 1)
    assert [r["status"] for r in rows(output)] == ["converged", "converged", "error"]
    code, out, err = run("batch", tmp_path, "-o", output, *COMMAND, "--retry")
    assert (code, out.count("1 recording fitted")) == (1, 1) and good.exists()
    assert "joint-id: 1 recording could not be read or fitted" in err
    assert "1 row (1 error); 1 rec" in run("batch", tmp_path / "other.csv", "-o", tmp_path / "one.parquet", *COMMAND)[1]


def test_csv_files_have_the_names_of_the_pattern(tmp_path):
    from joint_id_core.formats import write_csv

    for robot, motion in zip(("r1", "r2"), recordings(2), strict=True):
        (tmp_path / robot).mkdir()
        write_csv(tmp_path / robot / "elbow.csv", motion)
    run_here([tmp_path / "{robot}/{joint}.csv"], tmp_path / "out.parquet")
    assert [(r["robot"], r["joint"]) for r in rows(tmp_path / "out.parquet")] == [("r1", "elbow"), ("r2", "elbow")]


def test_the_namespace_of_a_bag_names_its_robot(tmp_path):
    from joint_id_core.formats import bag_reader

    (bag,) = write_bags(tmp_path, 1)
    known = bag_reader._known

    def moved(path, reader):
        return [(t, c._replace(topic=SPACE + c.topic)) for t, c in known(path, reader)]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bag_reader, "_known", moved)
        patch.setattr(
            bag_reader, "_messages", lambda r, c, m=bag_reader._messages: m(r, c._replace(topic=c.topic[12:]))
        )
        run_here([bag], tmp_path / "out.parquet")
    assert rows(tmp_path / "out.parquet")[0]["robot"] == SPACE.strip("/")


def test_new_recordings_are_added_and_those_of_other_patterns_stay(tmp_path):
    first, second, third = write_bags(tmp_path, 3)
    output = tmp_path / "out.parquet"
    run_here([second], output)
    before = rows(output)
    done = run_here([third, first, first], output)
    assert (done.fitted, done.before, done.rows) == (2, 0, {"converged": 3})
    assert rows(output)[1] == before[0]
    assert [Path(r["recording"]).name for r in rows(output)] == ["a_0", "a_1", "a_2"]


def test_other_options_are_no_more_of_the_same_table(tmp_path, run, in_this_process):
    (bag,) = write_bags(tmp_path, 1)
    output = tmp_path / "out.parquet"
    assert run("batch", bag, "-o", output, *COMMAND)[0] == 0
    code, _, err = run("batch", bag, "-o", output, "--model", "rigid_joint")
    assert code == 2 and "made with other options" in err and "give another -o" in err
    assert len(rows(output)) == 1


def test_the_file_of_a_robot_goes_with_the_work_and_its_content_is_among_the_options(tmp_path, run, in_this_process):
    (bag,) = write_bags(tmp_path, 1)
    output, robot = tmp_path / "out.parquet", tmp_path / "cell.yaml"
    robot.write_text("identifier: {ros__parameters: {fix: ['J=1.0']}}")
    assert run("batch", bag, "-o", output, *COMMAND, "--robot", robot)[0] == 0
    inertia = next(p for p in rows(output)[0]["parameters"] if p["name"] == "J")
    assert (inertia["verdict"], inertia["value"], inertia["std_dev"]) == ("fixed", 1.0, None)
    assert "cell.yaml" in rows(output)[0]["options"]
    robot.write_text("identifier: {ros__parameters: {fix: ['J=1.5']}}")
    code, _, err = run("batch", bag, "-o", output, *COMMAND, "--robot", robot)
    assert code == 2 and "made with other options" in err


@pytest.mark.long
def test_the_joints_of_an_arm_have_the_load_of_its_description(tmp_path, run, in_this_process):
    pytest.importorskip("pinocchio", reason="a robot's description needs Pinocchio")
    pytest.importorskip("mujoco", reason="the arm is one of MuJoCo")
    arm, output = tmp_path / "arm.urdf", tmp_path / "out.parquet"
    arm.write_text(moving_arm.URDF)
    formats.write_bag(tmp_path / "moves", moving_arm.rigid(8.0))
    words = ("batch", tmp_path / "moves", *COMMAND)
    code, _, err = run(*words, "-o", output, "--urdf", arm)
    assert code == 0, err
    for k, row in enumerate(rows(output)):
        found = {p["name"]: p for p in row["parameters"]}
        assert row["joint"] == moving_arm.JOINTS[k] and row["status"] == "converged", row["message"]
        for name, truth in (("c", moving_arm.VISCOUS[k]), ("tau_f", moving_arm.COULOMB[k])):
            assert abs(found[name]["value"] - truth) < 4.0 * found[name]["std_dev"], (row["joint"], name)
    assert "arm.urdf" in row["options"]
    for wrong, told in (
        (("--urdf", tmp_path / "no.urdf"), "no.urdf: cannot be read"),
        (("--base-gravity", "0,0,9.81"), "give --urdf, too"),
    ):
        code, _, err = run(*words, "-o", tmp_path / "other.parquet", *wrong)
        assert code == 2 and told in err


def test_only_a_part_and_one_joint_of_each_recording(tmp_path, run, in_this_process):
    (bag,) = write_bags(tmp_path, 1, 2)
    output = tmp_path / "out.parquet"
    words = ("batch", bag, "-o", output, *COMMAND, "--joint", "joint_1", "--start", "0.0", "--end", "2.0")
    assert run(*words)[0] == 0
    (row,) = rows(output)
    assert row["joint"] == "joint_1" and row["end_s"] < 2.0 and '"start": 0.0' in row["options"]
    code, _, err = run("batch", bag, "-o", tmp_path / "none.parquet", *COMMAND, "--joint", "elbow")
    assert code == 1 and "has no joint 'elbow'" in rows(tmp_path / "none.parquet")[0]["message"] and err


@pytest.mark.parametrize(
    ("pattern", "said"),
    [
        ("none/*.mcap", "matches no recording"),
        ("none.mcap", "no such file or folder"),
        ("{maker}/*.mcap", "{maker} has no meaning: known are {robot} and {joint}"),
    ],
)
def test_a_pattern_without_recordings_is_said(tmp_path, run, pattern, said):
    code, _, err = run("batch", tmp_path / pattern, "-o", tmp_path / "out.parquet")
    assert code == 2 and said in err and not list(tmp_path.iterdir())


def test_progress_tells_the_time_left(tmp_path):
    said: list[str] = []
    run_here(write_bags(tmp_path, 2), tmp_path / "out.parquet", progress=said.append)
    assert said[0] == "2 of 2 recordings to fit"
    assert said[1].startswith("1 of 2 recordings, about ") and said[1].endswith(" s left")


def test_what_is_finished_is_counted_and_told(tmp_path, run):
    """A batch that went on counted from one again; before its table is written, `history` said that there is none."""
    made, output, said = write_bags(tmp_path, 3), tmp_path / "out.parquet", list[str]()

    def ended(text: str) -> None:
        if text.startswith("2 of 3 recordings, about"):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_here(made, output, progress=ended)
    code, _, err = run("history", output)
    assert code == 2 and f"1 finished recording is not in {output} yet: wait for its joint-id batch" in err
    run_here(made, output, progress=said.append)
    assert said[0] == "2 of 3 recordings to fit, the others are finished"
    assert said[1].startswith("2 of 3 recordings, 1 of them earlier, about ")
    made = write_bags(tmp_path / "more", 3)
    with pytest.raises(KeyboardInterrupt):
        run_here(made, output, progress=ended)
    code, _, err = run("history", output)
    assert code == 0 and "1 finished recording is not in" in err


@pytest.mark.long
def test_a_process_that_ends_costs_only_its_recording(tmp_path, monkeypatch):
    bags = write_bags(tmp_path, 6)
    output = tmp_path / "out.parquet"
    (tmp_path / "crashing_work.py").write_text(CRASHING)
    monkeypatch.syspath_prepend(str(tmp_path))
    crashing = importlib.import_module("crashing_work").Crashing(work().job, "{}")
    done = run_batch(find([str(b) for b in bags]), crashing, str(output), lambda w, f: cores.on_cores(w, f, 2))
    assert done.failed == 2
    told = {Path(r["recording"]).name: (r["status"], r["message"]) for r in rows(output)}
    assert [told[f"a_{k}"][0] for k in range(6)] == [
        "converged", "crashed", "converged", "converged", "crashed", "converged",
    ]  # fmt: skip
    assert "crash or for lack of memory" in told["a_1"][1]
