"""MAT files, and the EMPS benchmark where it is at hand."""

from pathlib import Path

import numpy as np
import pytest
import scipy.io

from joint_id_core import formats
from joint_id_core.errors import JointIdError

DATA = Path(__file__).resolve().parents[4].parent / "shared" / "data" / "emps" / "DATA_EMPS.mat"
TIME = np.arange(5) * 0.1


@pytest.fixture
def mat(tmp_path):
    def write(**variables):
        path = tmp_path / "log.mat"
        scipy.io.savemat(path, variables)
        return path

    return write


def test_known_names_rows_or_columns(mat):
    path = mat(time_s=TIME[:, None], link_position=TIME[None, :] ** 2, model="EMPS", table=np.zeros((100, 200)))
    recording = formats.read(path)
    np.testing.assert_array_equal(recording["link_position"], TIME**2)
    assert formats.contents(path) == ("time_s", "link_position")
    assert formats.joints(path) == ()


def test_signals_in_structures_and_matrices_have_names(mat):
    """Several axes in the rows of a matrix, or in its columns, in a structure."""
    angles = np.arange(15.0).reshape(3, 5)
    path = mat(rec={"t": TIME, "deg": angles, "part": {"q": 2.0 * angles.T}}, u=[100.0, 50.0, 25.0])
    assert formats.contents(path) == (
        "rec.t", "rec.deg.1", "rec.deg.2", "rec.deg.3", "rec.part.q.1", "rec.part.q.2", "rec.part.q.3", "u",
    )  # fmt: skip
    recording = formats.read(path, mapping={"time_s": "rec.t", "link_position": "0.5*rec.part.q.3"})
    np.testing.assert_array_equal(recording["link_position"], angles[2])
    with pytest.raises(JointIdError, match=r"among the columns rec.t, rec.deg.1 to 3, rec.part.q.1 to 3, u: "):
        formats.read(path)


def test_the_vectors_of_one_structure_have_the_names_of_its_fields(mat):
    """It was refused for its time `log.t`, and `rec.q` for its position."""
    for name in ("log", "rec"):
        path = mat(**{name: {"t": TIME, "q": TIME**2, "tau": 3.0 * TIME, "x": TIME}, "Fs": 10.0})
        assert formats.contents(path) == ("t", "q", "tau", "x", "Fs") and formats.joints(path) == ()
        assert formats.taken(path) == ["time_s = t", "link_position = q", "torque = tau"]
        np.testing.assert_array_equal(formats.read(path)["torque"], 3.0 * TIME)
        mapped = formats.read(path, mapping={"link_position": f"Fs * {name}.x", "torque": "tau"})
        np.testing.assert_array_equal(mapped["link_position"], 10.0 * TIME)
    path = mat(log={"t": TIME, "q": np.array([TIME, 2.0 * TIME]), "tau": np.array([TIME, TIME])})
    assert formats.joints(path) == ("joint_1", "joint_2")
    assert formats.joints(path, {"link_position": "log.q.#"}) == ("joint_1", "joint_2")
    assert formats.contents(mat(log={"t": TIME}, t=2.0)) == ("log.t", "t")  # else both would be t
    with pytest.raises(JointIdError, match=r"'foo.x' is neither a column nor a number: the columns are t, q, x"):
        formats.read(mat(log={"t": TIME, "q": TIME, "x": TIME}), mapping={"torque": "foo.x"})


def test_a_constant_is_not_proposed_as_a_signal(mat):
    with pytest.raises(JointIdError, match=r"columns t, phi, n_axis, gtau: .*--map time_s=t --map link_position=phi "):
        formats.read(mat(n_axis=6, gtau=35.0, t=TIME, phi=TIME))


def test_scalars_may_be_factors(mat):
    path = mat(t=TIME, vir=np.arange(5), gtau=35.0)
    recording = formats.read(path, mapping={"time_s": "t", "torque": "gtau*vir*2"})
    np.testing.assert_array_equal(recording["torque"], 70.0 * np.arange(5))


@pytest.mark.parametrize(
    ("torque", "what"),
    [
        (TIME + 1j, "complex numbers: save its real part"),
        (["1.0", "2.0", "3.0", "4.0", "5.0"], "text: save its numbers"),
        (np.array(list("abcde"), dtype=object), "cells: save a vector of numbers"),
    ],
)
def test_what_is_no_real_number_is_named(mat, caplog, torque, what):
    path = mat(time_s=TIME, current=TIME, torque=torque, note="of Monday", voltage="48 V")
    assert list(formats.read(path).channels) == ["current"]
    assert f"'torque' is not read as torque: it holds {what}" in caplog.text and "voltage" not in caplog.text
    with pytest.raises(JointIdError, match=rf"log.mat: current=2\*torque: torque holds {what}"):
        formats.read(path, mapping={"current": "2*torque"})
    with pytest.raises(JointIdError, match=rf"no known channel among the columns time_s: 'torque' .* holds {what}$"):
        formats.read(mat(time_s=TIME, torque=torque))


def test_a_complex_vector_with_another_name_of_a_channel_is_named(mat, caplog):
    assert "torque" not in formats.read(mat(time_s=TIME, q=TIME, tau=TIME + 1j))
    assert "'tau' is not read as torque: it holds complex numbers: save its real part" in caplog.text
    path = mat(log={"t": TIME, "q1": TIME, "q2": TIME, "tau1": TIME, "tau2": TIME + 1j})
    assert "torque" not in formats.read(path, "joint_2") and "'tau2' is not read as torque" in caplog.text


@pytest.mark.parametrize(
    ("variables", "mapping", "message"),
    [
        ({"x": TIME, "q": TIME}, {}, r"log.mat: no known time_s among the columns x, q: .*--map time_s=x"),
        ({"time_s": TIME, "current": TIME[:3]}, {}, r"log.mat: current has 3 values, time_s has 5"),
        (
            {"time_s": TIME, "a": TIME, "b": TIME[:4]},
            {"torque": "a*b"},
            r"log.mat: torque multiplies vectors of different lengths \(a has 5, b has 4\)",
        ),
        ({"time_s": TIME, "g": 2.0}, {"torque": "g"}, r"log.mat: torque has 1 values, time_s has 5"),
        ({"name": "x"}, {}, r"log.mat: no real vector"),
        ({"time_s": TIME[::-1], "current": TIME}, {}, r"log.mat: time goes backwards at sample 1"),
    ],
)
def test_bad_contents(mat, variables, mapping, message):
    with pytest.raises(JointIdError, match=message):
        formats.read(mat(**variables), mapping=mapping)


def test_damaged_files(mat):
    path = mat(time_s=TIME, current=np.random.default_rng(0).normal(size=5))
    whole = path.read_bytes()
    path.write_bytes(whole[:-60])
    with pytest.raises(JointIdError, match=r"log.mat: not a readable MAT file"):
        formats.read(path)
    path.write_text("time_s,current\n" * 50)
    with pytest.raises(JointIdError, match=r"log.mat: not a readable MAT file"):
        formats.read(path)
    path.write_bytes(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + bytes(400))
    with pytest.raises(
        JointIdError, match=r"log.mat: MAT version 7.3 \(HDF5\) is not read: save it in MATLAB with -v7"
    ):
        formats.read(path)


@pytest.mark.skipif(not DATA.exists(), reason="the EMPS benchmark is not at ../shared/data/emps")
def test_emps():
    recording = formats.read(DATA, mapping={"time_s": "t", "link_position": "qm", "torque": "gtau*vir"})
    truth = scipy.io.loadmat(DATA)
    assert len(recording) == 24841
    assert recording.period == pytest.approx(1e-3, rel=1e-4)  # 1 kHz; the stamps themselves are rounded
    assert recording.gaps == 0
    np.testing.assert_array_equal(recording["link_position"], truth["qm"].ravel())
    np.testing.assert_allclose(recording["torque"], (truth["vir"] * truth["gtau"]).ravel(), rtol=1e-15)
