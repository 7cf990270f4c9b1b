"""What is proposed for a table whose columns or cells are written in another way."""

from __future__ import annotations

from pathlib import Path

import pytest

from joint_id_core import formats
from joint_id_core.errors import JointIdError


def written(folder: Path, text: str) -> Path:
    path = folder / "log.csv"
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "Zeit [ms],Winkel [deg],M\n0,1,2\n",
            r"--map 'time_s=0.001\*Zeit \[ms\]' --map 'link_position=0.0174533\*Winkel \[deg\]'$",
        ),
        ("Zeit [s],Winkel [rad]\n0,1\n", r"--map 'time_s=Zeit \[s\]' --map 'link_position=Winkel \[rad\]'$"),
        ("n,my.time,my.pos\n0,1,2\n", r"--map time_s=my.time --map link_position=my.pos \("),
        ("time,torque\n2026-01-31 22:13:20.5,1\n", r"column time: '2026-.*' is a date or a time .*: write seconds"),
        ("time,torque\n0 days 00:00:00.5,1\n", r"'0 days 00:00:00.5' is a date or a time of the day: write seconds"),
        ("time,torque\n31.01.2026,1\n", r"'31.01.2026' is a date"),
    ],
)
def test_the_advice_can_be_used(tmp_path, text, message):
    with pytest.raises(JointIdError, match=message) as caught:
        formats.read(written(tmp_path, text))
    assert "\n" not in str(caught.value)


def test_row_numbers_without_a_name_are_no_signal(tmp_path):
    path = written(tmp_path, ",time_s,torque,other\n0,0,1,2\n1,1,3,4\n")
    assert formats.unread(path) == ["other"]
    with pytest.raises(JointIdError, match=r"among the columns \(without a name\), q: "):
        formats.read(written(tmp_path, ",q\n0,1\n"))
