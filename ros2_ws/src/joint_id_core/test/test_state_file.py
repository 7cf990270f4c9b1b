"""The file of the identifier: whole or not there at all, whatever happens, and never lost silently."""

import errno
import json
import os
import random
import signal
import time
from pathlib import Path

import pytest

from joint_id_core.errors import JointIdError
from joint_id_core.results.estimate import Estimate, ParameterEstimate, Status, Verdict
from joint_id_core.stored import state_file
from joint_id_core.stored.file_lock import FileLock
from joint_id_core.stored.state_file import Known, StateFile

SETTINGS = {"values": {"J": 1.0}, "fixed": [], "freed": [], "priors": {}}


def known(value=1.0 / 3.0, watched_s=1e9 + 0.1):
    row = ParameterEstimate("J", "kg m^2", value, 0.1, Verdict.ESTIMATED)
    estimate = Estimate("rigid_joint", "innovations", Status.CONVERGED, "well", (row,), start=1.0, end=3.0)
    return Known(estimate, 1_700_000_000_123_456_789, watched_s, SETTINGS)


@pytest.fixture
def file(tmp_path):
    return StateFile(str(tmp_path / "state.json"))


def test_what_is_read_is_what_was_written_to_the_last_bit(file):
    assert file.read() == {}
    both = {"elbow": known(), "wrist": known(2.0, 5.0)}
    file.write(both, 1e9 + 0.2)
    assert StateFile(str(file.path)).read() == both
    assert json.loads(file.path.read_text())["written_s"] == 1e9 + 0.2


def test_a_file_cut_anywhere_is_kept_and_named_and_another_can_be_written(file):
    file.write({"joint": known()}, 0.0)
    whole = file.path.read_bytes()
    kept = file.path.with_name("state.json.damaged")
    for count in range(len(whole) - 1):  # the last byte is the end of the line
        file.path.write_bytes(whole[:count])
        with pytest.raises(JointIdError, match=r"damaged.*It is kept as .*state\.json\.damaged, and identif"):
            file.read()
        assert not file.path.exists() and kept.read_bytes() == whole[:count]
        assert file.read() == {}
        kept.unlink()
    file.write({"joint": known()}, 0.0)
    assert file.path.read_bytes() == whole


def test_a_changed_digit_is_found(file):
    file.write({"joint": known()}, 0.0)
    text = file.path.read_text()
    file.path.write_text(text.replace("0.333333", "0.433333", 1))
    with pytest.raises(JointIdError, match="damaged: its checksum is another one"):
        file.read()


@pytest.mark.parametrize(
    ("content", "text"),
    [
        (b"", "damaged"),
        (b"\xff\xfe\x00", "damaged"),
        (b"[]", "no state file"),
        (b'{"format": "joint_id estimate", "version": 1}', "no state file"),
        (b'{"format": "joint_id knowledge", "version": 2}', "is of version 2, and this node reads up to 1: update"),
        (b'{"format": "joint_id knowledge", "version": 1, "joints": []}', "damaged"),
    ],
)
def test_another_file_is_kept_and_said_to_be_so(file, content, text):
    file.path.write_bytes(content)
    file.path.with_name("state.json.damaged").write_text("an older one")
    with pytest.raises(JointIdError, match=text):
        file.read()
    assert file.path.with_name("state.json.damaged").read_text() == "an older one"
    assert file.path.with_name("state.json.damaged2").read_bytes() == content


def test_content_of_an_old_library_without_some_part_is_damaged(file):
    joints = {"joint": {"estimate": known().estimate.to_dict()}}
    head = {"format": state_file.FORMAT, "version": state_file.VERSION, "sha256": state_file._checksum(joints)}
    file.path.write_text(json.dumps({**head, "joints": joints}))
    with pytest.raises(JointIdError, match="damaged: KeyError: 'origin_ns'"):
        file.read()


def test_a_full_disk_leaves_the_old_file_and_no_draft(file, monkeypatch):
    file.write({"joint": known(1.0)}, 0.0)

    def full(_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(JointIdError, match="cannot be written: No space left on device: what is known is lost if"):
        file.write({"joint": known(2.0)}, 0.0)
    monkeypatch.undo()
    assert file.read() == {"joint": known(1.0)}
    assert [path.name for path in file.path.parent.iterdir()] == ["state.json"]
    file.write({"joint": known(2.0)}, 0.0)
    assert file.read() == {"joint": known(2.0)}


def test_a_folder_that_is_not_there_or_cannot_be_written_is_said(tmp_path, monkeypatch):
    file = StateFile(str(tmp_path / "nowhere" / "state.json"))
    FileLock(file.path).take()
    assert file.read() == {}
    with pytest.raises(JointIdError, match=r"nowhere/state.json cannot be written: No such file or directory"):
        file.write({"joint": known()}, 0.0)

    def forbidden(*_, **__):  # tests may run as root, who may write anywhere
        raise PermissionError(errno.EACCES, "Permission denied")

    file = StateFile(str(tmp_path / "state.json"))
    file.path.write_text("{")
    with monkeypatch.context() as patch:
        patch.setattr(os, "open", forbidden)
        patch.setattr(Path, "rename", forbidden)
        with pytest.raises(JointIdError, match=r"It cannot be renamed \(Permission denied\): move it away"):
            file.read()
    with pytest.raises(JointIdError, match="is not overwritten, as it could not be read"):
        file.write({"joint": known()}, 0.0)
    assert file.path.read_text() == "{"
    file.path.unlink()
    assert file.read() == {}
    file.write({"joint": known()}, 0.0)


def test_a_folder_in_its_place_is_not_touched(file):
    file.path.mkdir()
    with pytest.raises(JointIdError, match="cannot be read: Is a directory"):
        file.read()
    with pytest.raises(JointIdError, match="is not overwritten"):
        file.write({"joint": known()}, 0.0)


def test_a_number_that_json_cannot_hold_leaves_the_old_file(file):
    file.write({"joint": known()}, 0.0)
    with pytest.raises(JointIdError, match="cannot be written"):
        file.write({"joint": known(watched_s=float("nan"))}, 0.0)
    assert file.read() == {"joint": known()}


def test_one_process_at_a_time(file):
    one, other = FileLock(file.path), FileLock(file.path)
    one.take()
    with pytest.raises(JointIdError, match="is in use by another node: nothing is stored"):
        other.take()
    one.release()
    other.take()


def write_for_ever(path, pipe):
    """Write the file again and again, and say after each time which one it was."""
    file = StateFile(path)
    for number in range(1, 10**9):
        file.write({f"joint{k}": known(float(number)) for k in range(6)}, float(number))
        os.write(pipe, number.to_bytes(8, "little"))


@pytest.mark.parametrize("times", [5, pytest.param(50, marks=pytest.mark.long)])
def test_kill_9_at_random_moments_leaves_a_whole_file_of_the_last_write(file, times):
    """A file of six joints; the kill falls into any part of a write."""
    rng = random.Random()
    for _ in range(times):
        reader, writer = os.pipe()
        child = os.fork()
        if child == 0:
            write_for_ever(str(file.path), writer)
        os.close(writer)
        os.read(reader, 8)  # at least one was written
        time.sleep(rng.uniform(0.0, 0.02))
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        with os.fdopen(reader, "rb") as told:
            last = int.from_bytes(told.read()[-8:] or b"\x01", "little")
        found = StateFile(str(file.path)).read()
        assert len(found) == 6
        assert all(last <= one.estimate["J"].value <= last + 1 for one in found.values())
