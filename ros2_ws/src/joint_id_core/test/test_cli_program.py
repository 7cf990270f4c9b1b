"""The program `joint-id` around its commands: commands of other packages, help, version, completion, a quick start."""

import importlib.metadata
import inspect
import os
import subprocess
import sys
import types
import typing

import pytest

from joint_id_core import cli, formats
from joint_id_core.cli import app

from .online_motion import motion
from .quick import first_quick


def test_commands_of_other_packages_appear_when_installed_and_a_broken_one_is_left_out(monkeypatch, capsys):
    class Good:
        name, value = "wave", "other:wave"

        def load(self):
            def wave():
                """Wave a hand."""
                print("waved")

            return wave

    class Broken(Good):
        name, value = "broken", "other:broken"

        def load(self):
            raise ImportError("no module named other")

    monkeypatch.setattr(cli, "entry_points", lambda group: [Good(), Broken()] if group == cli.GROUP else [])
    monkeypatch.setattr(sys, "argv", ["joint-id", "wave"])
    monkeypatch.setattr(app, "registered_commands", list(app.registered_commands))
    with pytest.raises(SystemExit) as end:
        cli.main()
    out, err = capsys.readouterr()
    assert (end.value.code, out) == (0, "waved\n")
    assert "command broken is left out" in err


def test_help_of_the_real_command_loads_nothing_heavy():
    code = (
        "import sys, atexit\n"
        "atexit.register(lambda: print(*sorted({m.split('.')[0] for m in sys.modules}), file=sys.stderr))\n"
        "from joint_id_core.cli import main\n"
        "sys.argv = ['joint-id', '--help']\n"
        "main()"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0
    for command in ("simulate", "info", "fit"):
        assert command in done.stdout
    assert not {"numpy", "numba", "torch", "scipy", "sympy", "matplotlib", "rclpy", "rosbags"} & set(
        done.stderr.split()
    )


@pytest.mark.parametrize(
    ("command", "library"),
    first_quick([("fit", "numba"), ("doctor", "numba"), ("fit", "scipy"), ("doctor", "scipy")]),
)
def test_a_library_that_is_missing_is_named_in_one_line(tmp_path, library, command):
    formats.write(tmp_path / "log.csv", motion(4.0))
    code = f"import sys; sys.modules[{library!r}] = None; from joint_id_core.cli import main; main()"
    words = ["fit", "log.csv", "--model", "rigid_joint"] if command == "fit" else ["doctor"]
    done = subprocess.run(
        [sys.executable, "-c", code, *words], capture_output=True, text=True, timeout=120, check=False, cwd=tmp_path
    )
    if command == "fit":
        (line,) = [line for line in done.stderr.splitlines() if "loading" not in line and "compiling" not in line]
        assert done.returncode == 2 and library in line and "joint-id doctor" in line
    else:
        assert done.returncode == 1 and f"pip install {library}" in done.stdout and not done.stderr


def test_a_missing_library_that_shows_messages_is_named_in_one_line():
    code = "import sys; sys.modules['typer'] = None; from joint_id_core.command import main; main()"
    done = subprocess.run([sys.executable, "-c", code, "fit"], capture_output=True, text=True, timeout=120, check=False)
    (line,) = done.stderr.splitlines()
    assert done.returncode == 2 and line.startswith("joint-id: ") and line.endswith("pip install typer")


@pytest.mark.parametrize("entry", importlib.metadata.entry_points(group=cli.GROUP), ids=lambda entry: entry.name)
def test_help_of_commands_of_other_packages_tells_no_exceptions(entry):
    assert "Raises" not in entry.load().__doc__


def test_version_and_short_help(run):
    code, out, _ = run("--version")
    assert code == 0 and out == f"joint-id {importlib.metadata.version('joint-id-core')}\n"
    assert run("fit", "-h")[1] == run("fit", "--help")[1]


def test_annotations_are_those_that_typer_of_ubuntu_reads():
    """Typer 0.9 knows Optional[X], not X | None."""
    for command in app.registered_commands:
        for parameter in inspect.signature(command.callback, eval_str=True).parameters.values():
            kind = typing.get_args(parameter.annotation)[0]
            assert not isinstance(kind, types.UnionType), f"{command.callback.__name__}: {parameter}"


@pytest.mark.parametrize(
    ("words", "offered"),
    [
        ("joint-id fi", {"fit"}),
        ("joint-id fit --model ha", {"harmonic_drive"}),
        ("joint-id fit --friction ", {"coulomb_viscous", "stribeck", "eyring"}),
        ("joint-id report --estimator ", {"innovations", "regression", "hpinn"}),
        ("joint-id simulate el", {"electromechanical"}),
        ("joint-id fit --actu", {"--actuation"}),
    ],
)
def test_the_tab_key_completes_commands_options_and_their_values(monkeypatch, run, words, offered):
    """As bash asks for it."""
    for name, value in asked_for(words).items():
        monkeypatch.setenv(name, value)
    assert set(run()[1].split()) == offered


def asked_for(words: str) -> dict[str, str]:
    """What bash sets to ask for words that continue these."""
    return {"_JOINT_ID_COMPLETE": "complete_bash", "COMP_WORDS": words, "COMP_CWORD": str(words.count(" "))}


def test_so_does_the_real_program():
    command = [sys.executable, "-c", "from joint_id_core.cli import main; main()"]
    env = os.environ | asked_for("joint-id fit --model ha")
    done = subprocess.run(command, env=env, capture_output=True, text=True, check=False)
    assert done.stdout.split() == ["harmonic_drive"], done.stderr
