"""Fixtures that several test files use."""

from __future__ import annotations

import pytest

from joint_id_core.cli import app


@pytest.fixture
def run(capsys):
    """Run a command in this process: (exit code, stdout, stderr)."""

    def call(*arguments):
        with pytest.raises(SystemExit) as end:
            app([str(a) for a in arguments], prog_name="joint-id")
        out, err = capsys.readouterr()
        return end.value.code, out, err

    return call
