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
        ("time_s,phi_deg\n0,1\n", r"among the columns time_s, phi_deg: .*--map 'link_position=0.0174533\*phi_deg'$"),
        ("0,1,2\n1,2,3\n", r"log.csv: no header, line 1 holds numbers only: put column names above it, time_s, motor"),
        ("time_s,current\n", r"log.csv: only a header \(time_s, current\), no samples"),
        ("\n\n", r"log.csv: the file holds no line"),
        ("", r"log.csv: the file is empty"),
        (
            "time_s,current\n0,1\n\n1,high\n",
            r"log.csv: line 4, column current: 'high' is not a number: write one, or leave",
        ),
        ('time_s,current\n0,"1,5"\n', r"line 2, column current: '1,5' is not a number: write one with a decimal point"),
        ("time_s,current\n0,1\n1\n", r"log.csv: line 3 has 1 cells, the header has 2"),
        ("time_s,current,current\n0,1,2\n", r"log.csv: 2 columns are called 'current'"),
        ("time_s,current\n0,1\n2,1\n1,1\n", r"log.csv: time goes backwards at sample 2 \(2 s, then 1 s\)"),
        ("time_s,current\n0,1\n0,1\n", r"log.csv: time repeats at sample 1"),
        ("time_s,current\n0,1\n,1\n", r"log.csv: time of sample 1 is nan"),
        ("time_s,current\n0,inf\n", r"log.csv: current is infinite at sample 0 \(0 s\): write NaN, or in a table"),
        (
            "time_s,torqe [mNm]\n0,1\n",
            r"'torqe \[mNm\]' is not read \(did you mean torque\?\): name it, --map 'torque=0.001\*torqe \[mNm\]'$",
        ),
        (
            "tme_s,torque\n0,1\n",
            r"no known time_s .*: 'tme_s' is not read \(did you mean time_s\?\): .*--map time_s=tme_s$",
        ),
        (
            "time_s,link_position (Nm)\n0,1\n",
            r"no known channel .*: 'Nm' is not known as a unit of link_position, which is in rad: name it, "
            r"--map 'link_position=FACTOR\*link_position \(Nm\)'$",
        ),
        (
            "time_s,0.0,0.1,0.2\nlink_position,1,2,3\ntorque,4,5,6\n",
            r"log.csv: each line holds a name and numbers, so the table is transposed",
        ),
        ("time_s,current\n0,1\n" + 9000 * "\0", r"log.csv: line 3 holds 9,000 NUL bytes, .*: remove this line$"),
        ("time_s,current\n0,1\n1," + 9000 * "x", r"line 3, column current: 'x{40}...' is not a number"),
    ],
)
def test_bad_files_say_what_and_where(csv, text, message):
    with pytest.raises(JointIdError, match=message) as caught:
        formats.read(csv(text))
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 500


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
    with pytest.raises(JointIdError, match=r"photo.csv: byte 7 is not UTF-8 text: save the file as UTF-8"):
        formats.read(path)


@pytest.mark.parametrize("code", ["utf-16", "utf-16-le", "utf-16-be"])
def test_utf_16_is_named(tmp_path, code):
    path = tmp_path / "log.csv"
    path.write_bytes("time_s,current\n0,1\n".encode(code))
    with pytest.raises(JointIdError, match=r"log.csv: this is UTF-16 text: save the file as UTF-8"):
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


@pytest.mark.parametrize(
    "above",
    [
        "sep=,\n",
        '"sep=,"\n',
        "Robot log\n",
        "Robot log, lab 3\n\n",
        "Robot log; joint 1; today\nOperator: me\n",
        "torque\n# a\n",
    ],
)
@pytest.mark.parametrize("names", ["time_s,link_position,torque", "t,q,tau"])
def test_lines_above_the_header_are_skipped(csv, above, names):
    own = dict(zip(("time_s", "link_position", "torque"), names.split(","), strict=True))
    recording = formats.read(csv(f"{above}{names}\n0,1,2\n1,,4\n"), mapping=own)
    np.testing.assert_array_equal(recording["link_position"], [1, np.nan])
    assert recording.time.tolist() == [0, 1] and recording["torque"].tolist() == [2, 4]


def test_names_that_are_numbers_are_no_transposed_table(csv):
    assert formats.read(csv("time_s,0,1\n0,5,6\n1,7,8\n"), mapping={"torque": "1"})["torque"].tolist() == [6, 8]


@pytest.mark.parametrize(
    ("column", "factor"), [("time_ns", 1e-9), ("Time (ns)", 1e-9), ("t_us", 1e-6), ("timestamp_s", 1)]
)
def test_the_unit_of_time_may_be_at_the_end_of_its_name(csv, column, factor):
    assert formats.read(csv(f"{column},current\n0,1\n5,2\n")).time.tolist() == [0, 5 * factor]


@pytest.mark.parametrize(
    ("header", "target", "two"),
    [
        ("Time (s),t,current", "time_s", "'Time (s)' and 't'"),
        ("time_s,torque,Torque", "torque", "'torque' and 'Torque'"),
        ("time_s,torque (mNm),torque", "torque", "'torque' and 'torque (mNm)'"),
    ],
)
def test_a_name_that_fits_twice_is_not_guessed(csv, header, target, two):
    path = csv(f"{header}\n0,1,2\n")
    with pytest.raises(JointIdError, match=r"rename all but one, or say which, e\.g\. --map ") as caught:
        formats.read(path)
    assert f"{two} could all be {target}: " in str(caught.value)
    assert formats.read(path, mapping={target: header.split(",")[1]}).channels


@pytest.mark.parametrize(
    ("header", "mapping", "left"),
    [
        ("Time (ms),link_position (deg),torque,temp", {}, ["temp"]),
        ("time,link_position,torque,temp,n", {"current": "0.5*temp"}, ["n"]),
        ("time,time_s,link_position,torque", {}, ["time"]),
        ("time,position,effort,n", {}, ["n"]),
        ("time_ms,joint_angle_deg,torque_Nm", {}, []),
    ],
)
def test_columns_that_are_not_read_are_those_that_nothing_is_made_of(csv, header, mapping, left):
    assert formats.unread(csv(f"{header}\n"), mapping) == left


def test_time_s_may_have_other_times_beside_it(csv):
    assert formats.read(csv("Time (ms),time_s,torque\n5,0,1\n")).time.tolist() == [0.0]


@pytest.mark.parametrize(
    ("column", "said"),
    [
        ("torqe", "'torqe' is not read (did you mean torque?): name it, --map torque=torqe"),
        (
            "torque [Nmm]",
            "'Nmm' is not known as a unit of torque, which is in Nm: name it, --map 'torque=FACTOR*torque [Nmm]'",
        ),
        ("torque_cmd", ""),
        ("Current (rpm)", ""),  # the current is there
    ],
)
def test_a_column_that_seems_to_be_meant_is_named(csv, caplog, column, said):
    path = csv(f"time_s,current,{column}\n0,1,2\n1,2,3\n")
    assert dict(formats.read(path).channels).keys() == {"current"}
    assert said in caplog.text if said else not caplog.text
    caplog.clear()
    assert formats.read(path, mapping={"torque": column})["torque"].tolist() == [2, 3]
    assert not caplog.text


def test_an_empty_column_is_named(csv, caplog):
    assert "torque" in formats.read(csv("time_s,current,torque\n0,1,\n1,2,nan\n"))
    assert "log.csv: torque is empty, no sample has a value" in caplog.text and "current" not in caplog.text


def test_a_damaged_compressed_file_is_named(tmp_path):
    path = tmp_path / "log.csv.gz"
    path.write_bytes(gzip.compress(b"time_s,current\n0,1\n1,2\n" * 100)[:40])
    with pytest.raises(JointIdError, match=r"log.csv.gz: "):
        formats.read(path)
    path.write_bytes(b"time_s,current\n0,1\n")
    with pytest.raises(JointIdError, match=r"log.csv.gz: not compressed"):
        formats.read(path)
