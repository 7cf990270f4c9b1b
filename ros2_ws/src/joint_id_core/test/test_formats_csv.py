"""CSV in and out."""

import gzip

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from joint_id_core import formats
from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError


@pytest.fixture
def csv(tmp_path):
    def write(text):
        path = tmp_path / "log.csv"
        path.write_text(text, encoding="utf-8")
        return path

    return write


@pytest.mark.parametrize("delimiter", [",", ";", "\t", " ", "   "])
def test_delimiter_is_found(csv, delimiter):
    rows = [["time_s", "link_position", "note"], ["0", "1.5", "a"], ["0.25", "-2e-3", "b"]]
    path = csv("\n".join(delimiter.join(row) for row in rows) + "\n")
    recording = formats.read(path, joint="elbow")
    assert recording.time.tolist() == [0.0, 0.25]
    assert dict(recording.channels).keys() == {"link_position"}
    assert recording["link_position"].tolist() == [1.5, -2e-3]
    assert recording.joint == "elbow"
    assert formats.contents(path) == ("time_s", "link_position", "note")
    assert formats.joints(path) == ()


def test_empty_cells_and_nan_are_missing_values_and_gaps_stay(csv):
    recording = formats.read(csv('time_s,"current",voltage\n0,,1\n1,nan,2\n\n5,NaN,3\n7,4,\n'))
    assert recording.time.tolist() == [0, 1, 5, 7]
    np.testing.assert_array_equal(recording["current"], [np.nan, np.nan, np.nan, 4])
    np.testing.assert_array_equal(recording["voltage"], [1, 2, 3, np.nan])


def test_mapping_multiplies_columns_and_numbers(csv):
    path = csv("t,q_deg,kt,i,current\n0,180,2,3,9\n1,90,2,5,9\n")
    mapping = {"time_s": "t", "link_position": "0.5*q_deg", "torque": "kt * i", "motor_velocity": "i*i*-1"}
    recording = formats.read(path, mapping=mapping)
    assert recording["link_position"].tolist() == [90, 45]
    assert recording["torque"].tolist() == [6, 10]
    assert recording["motor_velocity"].tolist() == [-9, -25]
    assert recording["current"].tolist() == [9, 9]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "when,q,i\n0,1,2\n",
            r"log.csv: no known time_s among the columns when, q, i: understood are time_s, motor_position, .*in SI "
            r"units; name yours, e.g. --map time_s=when --map link_position=q \(0.0174533\*q if it is in degrees\)$",
        ),
        ("time_s,q_deg\n0,1\n", r"among the columns time_s, q_deg: .*--map 'link_position=0.0174533\*q_deg'$"),
        ("0,1,2\n1,2,3\n", r"log.csv: no header, line 1 holds numbers only: put column names above it, time_s, motor"),
        ("time_s,current\n", r"log.csv: only a header \(time_s, current\), no samples"),
        ("\n\n", r"log.csv: the file holds no line"),
        ("", r"log.csv: the file is empty"),
        (
            "time_s,current\n0,1\n\n1,high\n",
            r"log.csv: line 4, column current: 'high' is not a number: write one, or leave",
        ),
        ("time_s;current\n0;1,5\n", r"line 2, column current: '1,5' is not a number: write one with a decimal point"),
        ("time_s,current\n0,1\n1\n", r"log.csv: line 3 has 1 cells, the header has 2"),
        ("time_s,current,current\n0,1,2\n", r"log.csv: 2 columns are called 'current'"),
        ("time_s,current\n0,1\n2,1\n1,1\n", r"log.csv: time goes backwards at sample 2 \(2 s, then 1 s\)"),
        ("time_s,current\n0,1\n0,1\n", r"log.csv: time repeats at sample 1"),
        ("time_s,current\n0,1\n,1\n", r"log.csv: time of sample 1 is nan"),
        ("time_s,current\n0,inf\n", r"log.csv: current is infinite at sample 0"),
    ],
)
def test_bad_files_say_what_and_where(csv, text, message):
    with pytest.raises(JointIdError, match=message) as caught:
        formats.read(csv(text))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("mapping", "message"),
    [
        ({"speed": "t"}, r"log.csv: cannot map to 'speed': known are time_s, motor_position"),
        ({"current": "t*j"}, r"log.csv: current=t\*j: 'j' is neither a column nor a number: the columns are t, i"),
        ({"current": "i**2"}, r"'' is neither a column nor a number"),
        ({"current": "nan*i"}, r"'nan' is neither"),
        ({"current": "2*3"}, r"log.csv: current=2\*3 uses no column"),
    ],
)
def test_bad_mappings(csv, mapping, message):
    with pytest.raises(JointIdError, match=message):
        formats.read(csv("t,i\n0,1\n"), mapping={"time_s": "t", **mapping})


def test_not_text(tmp_path):
    path = tmp_path / "photo.csv"
    path.write_bytes(b"time_s,\xff\xfe")
    with pytest.raises(JointIdError, match=r"photo.csv: byte 7 is not UTF-8 text"):
        formats.read(path)


def test_unknown_and_missing_paths(tmp_path):
    with pytest.raises(JointIdError, match=r"nothing.csv: no such file or directory"):
        formats.read(tmp_path / "nothing.csv")
    (tmp_path / "log.doc").write_text("x")
    with pytest.raises(
        JointIdError, match=r"log.doc: not a known format: give a .csv, .txt, .tsv, .mat, .mcap or .db3 file"
    ):
        formats.read(tmp_path / "log.doc")


def test_writing_leaves_out_derived_channels_and_never_overwrites(tmp_path):
    time = np.array([0.0, 0.1])
    recording = Recording(time, {"link_position": time, "link_velocity": time}, derived=frozenset({"link_velocity"}))
    path = tmp_path / "out.csv"
    formats.write_csv(path, recording)
    assert path.read_text() == "time_s,link_position\n0.0,0.0\n0.1,0.1\n"
    with pytest.raises(JointIdError, match=r"out.csv exists already"):
        formats.write_csv(path, recording)
    with pytest.raises(JointIdError, match="no measured channel"):
        formats.write_csv(tmp_path / "none.csv", Recording(time, {}))


numbers = st.floats(allow_infinity=False, allow_nan=False)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=50, deadline=None)
@given(
    st.lists(numbers, min_size=1, max_size=20, unique=True).map(sorted),
    st.data(),
)
def test_any_recording_reads_back_exactly(tmp_path, times, data):
    values = st.lists(st.one_of(numbers, st.just(np.nan)), min_size=len(times), max_size=len(times))
    channels = {name: np.array(data.draw(values)) for name in ("current", "external_torque")}
    path = tmp_path / "round.csv"
    path.unlink(missing_ok=True)
    formats.write_csv(path, Recording(np.array(times), channels))
    back = formats.read(path)
    np.testing.assert_array_equal(back.time, times)
    for name, column in channels.items():
        np.testing.assert_array_equal(back[name], column)


HEADERS = {
    "Time (ms),Link position [deg],Motor velocity (rpm),Current (mA)\n0,180,60,500\n250,90,30,250\n",
    "# taken with a UR\n# time  link_position motor.velocity current\n0 3.141592653589793 6.283185307179586 0.5\n"
    "0.25 1.5707963267948966 3.141592653589793 0.25\n",
    "| t_ms | link position_deg | motor_velocity_rpm | current |\n| 0 | 180 | 60 | 0.5 |\n\n| 250 | 90 | 30 | 0.25 |\n",
    "% a comment\nTIMESTAMP;Link Position (°);Motor Velocity (deg/s);Current (A);Note (x)\n0;180;360;0.5;1\n"
    "// later\n0.25;90;180;0.25;2\n",
}


@pytest.mark.parametrize("text", sorted(HEADERS))
@pytest.mark.parametrize("name", ["log.csv", "log.txt", "log.TSV", "log.csv.gz"])
def test_headers_as_people_write_them(tmp_path, name, text):
    path = tmp_path / name
    path.write_bytes(gzip.compress(text.encode()) if name.endswith(".gz") else text.encode())
    recording = formats.read(path)
    assert recording.time.tolist() == [0.0, 0.25]
    assert recording["link_position"] == pytest.approx([np.pi, np.pi / 2])
    assert recording["motor_velocity"] == pytest.approx([2 * np.pi, np.pi])
    assert recording["current"] == pytest.approx([0.5, 0.25])
    assert any(said.startswith("link_position = ") or said.startswith("time_s = ") for said in formats.taken(path))


def test_a_name_that_fits_twice_and_a_unit_of_another_kind_are_not_guessed(csv):
    with pytest.raises(JointIdError, match=r"'Time \(s\)' and 't' could all be time_s: say which, .*--map 'time_s=T"):
        formats.read(csv("Time (s),t,current\n0,1,2\n"))
    with pytest.raises(JointIdError, match="no known channel among the columns time, Current"):
        formats.read(csv("time,Current (Nm)\n0,1\n"))
    exact = formats.read(csv("time_s,Time (ms),torque,torque (mNm)\n0,5,1,2\n"))
    assert exact.time.tolist() == [0.0] and exact["torque"].tolist() == [1.0]


def test_a_damaged_compressed_file_is_named(tmp_path):
    path = tmp_path / "log.csv.gz"
    path.write_bytes(gzip.compress(b"time_s,current\n0,1\n1,2\n" * 100)[:40])
    with pytest.raises(JointIdError, match=r"log.csv.gz: "):
        formats.read(path)
    path.write_bytes(b"time_s,current\n0,1\n")
    with pytest.raises(JointIdError, match=r"log.csv.gz: cannot be read"):
        formats.read(path)
