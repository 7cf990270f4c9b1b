"""The table that a batch writes: what stands in its place before is kept aside or left alone, and nothing is lost."""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as parquet
import pytest

from joint_id_core.batch.recordings import Found, find
from joint_id_core.batch.store import ASIDE, LocalStore, store
from joint_id_core.batch.table import join, write_part
from joint_id_core.errors import JointIdError

from .many_recordings import COMMAND, rows, run_here, work, write_bags


@pytest.mark.parametrize("content", [b"", b"PAR1 half", bytes(1000)])
def test_a_half_written_table_is_kept_aside(tmp_path, content):
    (bag,) = write_bags(tmp_path, 1)
    output = tmp_path / "out.parquet"
    output.write_bytes(content)
    Path(f"{output}{ASIDE}").write_bytes(b"an earlier one")
    done = run_here([bag], output)
    assert len(done.said) == 1 and f"kept as {output}{ASIDE}-1" in done.said[0]
    assert Path(f"{output}{ASIDE}-1").read_bytes() == content and len(rows(output)) == 1
    assert Path(f"{output}{ASIDE}").read_bytes() == b"an earlier one"


def test_a_table_cut_short_is_kept_aside_and_made_anew(tmp_path):
    bags = write_bags(tmp_path, 2)
    output = tmp_path / "out.parquet"
    run_here(bags, output)
    whole, content = rows(output), output.read_bytes()
    output.write_bytes(content[:-200])
    assert run_here(bags, output).fitted == 2 and rows(output) == whole


def test_a_table_of_something_else_is_left_alone(tmp_path):
    (bag,) = write_bags(tmp_path, 1)
    output = tmp_path / "out.parquet"
    parquet.write_table(pa.table({"a": [1]}), output)
    with pytest.raises(JointIdError, match="a table that joint-id batch did not write"):
        run_here([bag], output)
    assert parquet.read_table(output).to_pydict() == {"a": [1]}


def test_a_file_that_is_no_table_is_left_alone(tmp_path, run):
    (bag,) = write_bags(tmp_path, 1)
    output = tmp_path / "out.parquet"
    output.write_text("time_s,torque\n0,1\n")
    with pytest.raises(JointIdError, match="a file that is no table"):
        run_here([bag], output)
    assert output.read_text() == "time_s,torque\n0,1\n"
    code, _, err = run("batch", bag, "-o", tmp_path / "log.csv", *COMMAND)
    assert code == 2 and "end its name in .parquet" in err and not (tmp_path / "log.csv").exists()


def test_a_damaged_part_is_kept_aside_and_its_recording_done_again(tmp_path):
    bags = write_bags(tmp_path, 2)
    output = tmp_path / "out.parquet"
    place, found, jobs = store(str(output)), find([str(b) for b in bags]), work()
    with place.locked():
        names = [write_part(place, jobs.rows(one), one) for one in found]
    part = Path(f"{output}.parts") / names[0]
    part.write_bytes(part.read_bytes()[:-9])
    done = run_here(bags, output)
    assert (done.fitted, done.before) == (1, 1) and "a part of" in done.said[0]
    assert [p.name for p in Path(f"{output}.parts").iterdir()] == [names[0] + ASIDE]
    assert len(rows(output)) == 2


def test_two_runs_do_not_write_one_table(tmp_path):
    (bag,) = write_bags(tmp_path, 1)
    output = str(tmp_path / "out.parquet")
    with LocalStore(output).locked(), pytest.raises(JointIdError, match="being written by another process"):
        run_here([bag], output)


def test_a_table_is_joined_without_holding_it_in_memory(tmp_path, monkeypatch):
    """Blocks are written when they are full, also where old rows and new ones alternate."""
    (bag,) = write_bags(tmp_path, 1)
    row = work().rows(find([str(bag)])[0])[0]
    place = store(str(tmp_path / "out.parquet"))
    monkeypatch.setattr("joint_id_core.batch.table.BLOCK", 10)

    def parts(numbers):
        made = {}
        for k in numbers:
            one = Found(f"/bag_{k:03}", k, "now")
            made[one.place] = write_part(place, [row | {"recording": one.place, "samples": k}], one)
        return made

    with place.locked():
        join(place, parts(range(0, 60, 2)))
        assert join(place, parts(range(1, 60, 2)) | parts([6])) == {"converged": 60}
    file = parquet.ParquetFile(tmp_path / "out.parquet")
    assert file.num_row_groups == 6
    assert file.read().column("samples").to_pylist() == list(range(60))


def test_a_place_that_cannot_be_written_is_said_before_any_fit(tmp_path, run):
    (bag,) = write_bags(tmp_path, 1)
    code, _, err = run("batch", bag, "-o", tmp_path / "no/out.parquet")
    assert code == 2 and "check folder, rights and space" in err
    code, _, err = run("batch", bag, "-o", tmp_path)
    assert code == 2 and "is a folder" in err
