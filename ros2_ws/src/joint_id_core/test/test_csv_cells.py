"""Cells of tables as spreadsheets write them, and as programs leave them that were killed."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest

from joint_id_core import formats
from joint_id_core.errors import JointIdError
from joint_id_core.formats import csv_file


def written(folder: Path, text: str) -> Path:
    path = folder / "log.csv"
    path.write_text(text)
    return path


@pytest.mark.parametrize("delimiter", [";", "\t"])
@pytest.mark.parametrize("above", ["", "Messung 3\n\n"])
@pytest.mark.parametrize("names", ["time_s;torque;note", "Zeit;M;N"])
def test_decimal_commas_are_read_where_nothing_else_can_be_meant(tmp_path, delimiter, above, names):
    text = f"{above}{names}\n0;-1,5;a\n0,25;2,5e-3;1.5\n1;;\n".replace(";", delimiter)
    own = dict(zip(("time_s", "torque"), names.split(";"), strict=False))
    recording = formats.read(written(tmp_path, text), mapping=own)
    assert recording.time.tolist() == [0.0, 0.25, 1.0]
    np.testing.assert_array_equal(recording["torque"], [-1.5, 2.5e-3, np.nan])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time_s;torque\n0;0,5\n1;1.234,5\n", r"line 3, column torque: '1.234,5' is not .* separators of thousands$"),
        ("time_s;torque\n0;0,5\n1;1,234,567\n", r"'1,234,567' is not a number: write one without separators of th"),
        ("time_s;torque\n0;1,234\n1;0.5\n", r"line 2, column torque: '1,234' is not a number: .* decimal point$"),
        ("0;0,5\n1;1,5\n", r"no header, line 1 holds numbers only"),
    ],
)
def test_commas_that_may_mean_something_else_are_refused(tmp_path, text, message):
    with pytest.raises(JointIdError, match=message):
        formats.read(written(tmp_path, text))


WHOLE = "time_s,link_position,torque\n0.1,1.0,0.25\n0.2,2.0,-10.75\n0.3,3.0,-11.25"


@pytest.mark.parametrize("lost", [1, 3, 6, 7, 9, 11, 13])
def test_a_last_line_that_was_cut_is_left_out_and_said(tmp_path, caplog, lost):
    recording = formats.read(written(tmp_path, WHOLE[:-lost]))
    assert recording.time.tolist() == [0.1, 0.2] and recording["torque"].tolist() == [0.25, -10.75]
    assert "log.csv: line 4 is left out, as the file seems to be cut short within it" in caplog.text


def test_a_cut_line_of_several_joints_is_said_once(tmp_path, caplog):
    path = written(tmp_path, "time_s,q1,q2\n0,0.5,0.25\n1,0.75,0.5\n2,0.5,0.")
    found = formats.read_joints(path).recordings
    assert [len(recording) for recording in found.values()] == [2, 2] and caplog.text.count("line 4 is left out") == 1


@pytest.mark.parametrize("end", ["", "\n", "\r\n", "\n\n", "\n# the end"])
def test_a_whole_last_line_is_read(tmp_path, caplog, end):
    path = written(tmp_path, WHOLE + end)
    packed = path.with_suffix(".csv.gz")
    packed.write_bytes(gzip.compress(path.read_bytes()))
    for one in (path, packed):
        assert formats.read(one)["torque"].tolist() == [0.25, -10.75, -11.25]
    assert not caplog.text


@pytest.mark.parametrize("line_end", ["\n", "\r\n"])
@pytest.mark.parametrize("delimiter", [",", "\t", " ", "   ", ", "])
@pytest.mark.parametrize(("lost", "whole"), [(0, True), (1, False), (7, False), (9, False)])
@pytest.mark.parametrize("packed", [False, True])
def test_a_table_without_a_last_line_end_is_read_by_numpy(
    tmp_path, caplog, monkeypatch, line_end, delimiter, lost, whole, packed
):
    """Ten million rows took eight times as long."""
    monkeypatch.setattr(csv_file, "_table", lambda *_: pytest.fail("the slow reader"))
    path = written(tmp_path, "")
    text = WHOLE[: len(WHOLE) - lost].replace("\n", line_end).replace(",", delimiter).encode()
    if packed:
        path = path.with_suffix(".csv.gz")
    path.write_bytes(gzip.compress(text) if packed else text)
    assert formats.read(path).time.tolist() == ([0.1, 0.2, 0.3] if whole else [0.1, 0.2])
    assert ("line 4 is left out" in caplog.text) == (not whole)


@pytest.mark.parametrize("position", ["1.0", ""])
def test_a_shorter_number_with_all_decimals_is_whole(tmp_path, caplog, position):
    """A minus sign in its column made a last number without one seem cut. NumPy reads no empty cells."""
    text = f"time_s,link_position,torque\n0.1,{position},-10.75\n0.2,2.0,-11.25\n\n0.3,3.0,1.25"
    assert formats.read(written(tmp_path, text))["torque"].tolist() == [-10.75, -11.25, 1.25]
    assert not caplog.text


def test_a_shorter_number_with_a_decimal_comma_is_whole(tmp_path, caplog):
    text = "time_s;link_position;torque\n0,1;1,0;-10,75\n0,2;2,0;-11,25\n0,3;3,0;1,25"
    assert formats.read(written(tmp_path, text))["torque"].tolist() == [-10.75, -11.25, 1.25] and not caplog.text


@pytest.mark.parametrize("word", ["NA", "n/a", "#N/A", "null", "None", "NaN"])
def test_words_of_other_programs_for_no_value_are_missing_values(tmp_path, word):
    """They were no numbers, and the table was refused."""
    recording = formats.read(written(tmp_path, f"time_s,torque\n0,1\n1,{word}\n2,3\n"))
    assert np.isnan(recording["torque"]).tolist() == [False, True, False]


@pytest.mark.parametrize(
    ("text", "position"),
    [
        ("time,position,torque\ns,rad,Nm\n0,180,1\n1,90,2\n", [180.0, 90.0]),
        ("time;q;tau\n[ms];[deg];[Nm]\n0;180;1\n1000;90;2\n", np.deg2rad([180.0, 90.0])),
        ("time_s,comment,position,torque\ns,-,mrad,Nm\n0,0,180,1\n1,0,90,2\n", [0.18, 0.09]),
    ],
)
def test_a_line_of_units_below_the_names_is_understood(tmp_path, text, position):
    """Such a table was refused, as `s` is not a number."""
    recording = formats.read(written(tmp_path, text))
    assert recording["link_position"] == pytest.approx(position) and recording["torque"].tolist() == [1.0, 2.0]
    assert recording.time.tolist() == [0.0, 1.0]


def test_units_of_another_kind_are_not_taken(tmp_path, caplog):
    recording = formats.read(written(tmp_path, "time,position,torque\ns,rad,A\n0,180,1\n1,90,2\n"))
    assert not recording.measured("torque") and "'torque [A]' is not read" in caplog.text
    with pytest.raises(JointIdError, match="line 2, column time: 's' is not a number"):
        formats.read(written(tmp_path, "time,position,torque\ns,rad,furlong\n0,180,1\n1,90,2\n"))


@pytest.mark.parametrize("text", ["time_s,torque\n0,1\n1\n", "time_s,torque\n0,1\n1,2,3"])
def test_other_lines_of_the_wrong_length_are_refused(tmp_path, text):
    with pytest.raises(JointIdError, match=r"line 3 has . cells, the header has 2"):
        formats.read(written(tmp_path, text))
