"""Files that hold no recording are told as what they are."""

import gzip
import os

import pytest

from joint_id_core import formats
from joint_id_core.cli.group import BAD_INPUT
from joint_id_core.errors import JointIdError

HEADER, ROW = "time_s,link_position,torque\n", "0,0.1,2\n"


@pytest.mark.parametrize("estimator", ["innovations", "regression"])
def test_a_table_of_one_row_is_too_short(tmp_path, run, estimator):
    path = tmp_path / "one.csv"
    path.write_text(HEADER + ROW)
    code, _, err = run("fit", str(path), "--estimator", estimator)
    assert code == BAD_INPUT and "too_short: " in err


def test_a_link_to_nothing_and_one_to_itself_are_told(tmp_path):
    (tmp_path / "lost.csv").symlink_to("nowhere.csv")
    (tmp_path / "round.csv").symlink_to("round.csv")
    for name in ("lost.csv", "round.csv"):
        with pytest.raises(JointIdError, match=f"{name}: a link that leads to no file"):
            formats.read(tmp_path / name)


def test_a_pipe_is_not_waited_for(tmp_path):
    """It was called an empty file."""
    os.mkfifo(tmp_path / "pipe.csv")
    with pytest.raises(JointIdError, match=r"pipe\.csv: a pipe or a device, .* write it to a file"):
        formats.read(tmp_path / "pipe.csv")


def test_a_table_that_only_its_name_calls_compressed_is_told(tmp_path):
    path = tmp_path / "log.csv.gz"
    path.write_text(HEADER + ROW)
    with pytest.raises(JointIdError, match=r"log\.csv\.gz: not compressed, though its name ends in \.gz"):
        formats.read(path)
    path.write_bytes(gzip.compress((HEADER + ROW).encode()))
    assert len(formats.read(path)) == 1
