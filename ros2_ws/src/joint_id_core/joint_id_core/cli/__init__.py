"""The command line `joint-id`: a thin layer that converts options to calls of the library.

Only light modules are imported here, so that `joint-id --help` is fast. Other packages add commands through the
entry-point group `joint_id.commands` (joint_id_ros: record). Commands that are not installed are not shown.
"""

from __future__ import annotations

import os
import signal
import sys
from importlib.metadata import entry_points, version
from typing import Annotated

import typer

from joint_id_core.cli.arm import arm
from joint_id_core.cli.batch import batch
from joint_id_core.cli.compare import compare
from joint_id_core.cli.design import design
from joint_id_core.cli.diff import diff
from joint_id_core.cli.doctor import doctor
from joint_id_core.cli.export import export
from joint_id_core.cli.fit import fit
from joint_id_core.cli.group import BAD_INPUT, OneLineErrors, end_on_interrupt, not_written
from joint_id_core.cli.history import history
from joint_id_core.cli.info import info
from joint_id_core.cli.many import bootstrap, many_starts
from joint_id_core.cli.report import report
from joint_id_core.cli.robot_emulator import EPILOG, robot_emulator
from joint_id_core.cli.simulate import simulate

GROUP = "joint_id.commands"

app = typer.Typer(
    cls=OneLineErrors,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(wanted: bool) -> None:
    if wanted:
        print(f"joint-id {version('joint-id-core')}")
        raise typer.Exit


@app.callback()
def _group(
    _: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True, help="print it and leave")] = False,
) -> None:
    """Identify the dynamics of robot joints: inertia, friction, stiffness, each with its uncertainty."""


app.add_typer(arm, name="arm")
app.command()(simulate)
app.command()(info)
app.command()(fit)
app.command()(batch)
app.command()(compare)
app.command()(design)
app.command()(report)
app.command()(diff)
app.command()(history)
app.command()(export)
app.command()(many_starts)
app.command()(bootstrap)
app.command()(doctor)
app.command(epilog=EPILOG)(robot_emulator)


def _add_commands_of_other_packages() -> None:
    for entry in sorted(entry_points(group=GROUP), key=lambda e: e.name):
        try:
            app.command(entry.name)(entry.load())
        except ImportError as error:
            print(f"joint-id: command {entry.name} is left out, {entry.value} does not load: {error}", file=sys.stderr)


def main() -> None:
    """Run the console script `joint-id`. Exit code 0: success, 1: the fit is not good, 2: bad input."""
    _add_commands_of_other_packages()
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:  # as shells have it for jobs in the background
        signal.signal(signal.SIGINT, end_on_interrupt)
    try:
        app(prog_name="joint-id")
    except BrokenPipeError:  # a reader such as head has seen enough
        raise
    except OSError as error:  # of --help and --version, which no command runs
        not_written(error)
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # else Python complains again at its end
        sys.exit(BAD_INPUT)
