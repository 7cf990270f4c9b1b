"""Error handling of commands: bad input gives exit code 2 and one line on stderr, without a traceback."""

from __future__ import annotations

import io
import multiprocessing
import os
import signal
import sys
from typing import Any

import typer
from typer.core import TyperGroup

from joint_id_core.errors import JointIdError

# Some versions of typer contain their own copy of click. In both cases this is the base class of all usage errors.
UsageError: type[Exception] = typer.BadParameter.__mro__[1]

BAD_INPUT = 2
OF_NODES = ("fleet", "record", "watch")  # commands of joint_id_ros


class OneLineErrors(TyperGroup):
    """A group of commands that reports misuse and unusable data in one line."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return the command that is named; one that only comes with the nodes is no typing error."""
        if args and args[0] in OF_NODES and self.get_command(ctx, args[0]) is None:
            raise JointIdError(
                f"{args[0]} comes with the nodes (joint_id_ros), which are not installed here: make setup, or colcon "
                "build in ros2_ws, and source its setup.bash; joint-id doctor tells what is missing"
            )
        return super().resolve_command(ctx, args)

    def invoke(self, ctx: Any) -> Any:
        """Run the chosen command."""
        for stream in (sys.stdout, sys.stderr):
            if isinstance(stream, io.TextIOWrapper):
                stream.reconfigure(errors="replace")  # an encoding that lacks a character must not lose a result
        try:
            return super().invoke(ctx)
        except JointIdError as error:
            complain(str(error))
        except UsageError as error:
            misused = getattr(error, "ctx", None) or ctx  # also a command within a group
            said, help_ = str(error), " ".join(("joint-id", *misused.command_path.split()[1:], "--help"))
            if said.startswith("Usage:"):  # a group of commands without a command shows its help
                print(said, file=sys.stderr)
            else:
                complain(f"{error.format_message()} See {help_}")  # type: ignore[attr-defined]  # see UsageError
        except ImportError as error:
            complain(f"a library cannot be loaded ({error}): joint-id doctor tells which, and what mends it")
        except MemoryError:
            complain("not enough memory: take less of the recording (--start, --end), or a computer with more of it")
        except BrokenPipeError:  # a reader such as head has seen enough
            raise
        except OSError as error:
            not_written(error)
        raise typer.Exit(BAD_INPUT)


def not_written(error: OSError) -> None:
    """Say what could not be read or written."""
    if error.errno is None:  # from a library that loads its parts, as where memory is short
        complain(f"a part of a library cannot be loaded ({error}): is there too little memory? See joint-id doctor")
        return
    if isinstance(error, FileNotFoundError) and error.filename is None:
        complain("the folder in which this command runs is gone: change to another one (cd)")
        return
    place = error.filename if error.filename is not None else "the output, or a temporary file"
    complain(f"{place}: {error.strerror or error}: check the path, its permissions and the space")


def end_on_interrupt(number: int, _: object) -> None:
    """End on Ctrl-C, with the processes that were started.

    An exception would be lost where a library is being loaded: the command would run on, or end in a traceback.
    """
    for child in multiprocessing.active_children():
        child.terminate()
    if sys.stderr.isatty():
        os.write(sys.stderr.fileno(), b"\r\x1b[K")  # the line of progress
    signal.signal(number, signal.SIG_DFL)
    signal.raise_signal(number)


def complain(message: str) -> None:
    """Write one line to stderr."""
    print(f"joint-id: {' '.join(message.split())}", file=sys.stderr)
