"""Error handling of commands: bad input gives exit code 2 and one line on stderr, without a traceback."""

from __future__ import annotations

import io
import signal
import sys
import threading
from typing import Any

import typer
from typer.core import TyperGroup

from joint_id_core.errors import JointIdError

# Some versions of typer contain their own copy of click. In both cases this is the base class of all usage errors.
UsageError: type[Exception] = typer.BadParameter.__mro__[1]

BAD_INPUT = 2


class OneLineErrors(TyperGroup):
    """A group of commands that reports misuse and unusable data in one line."""

    def invoke(self, ctx: Any) -> Any:
        """Run the chosen command."""
        if signal.getsignal(signal.SIGINT) is signal.SIG_DFL and threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGINT, signal.default_int_handler)  # the launcher lets Ctrl-C end the imports
        for stream in (sys.stdout, sys.stderr):
            if isinstance(stream, io.TextIOWrapper):
                stream.reconfigure(errors="replace")  # an encoding that lacks a character must not lose a result
        try:
            return super().invoke(ctx)
        except JointIdError as error:
            complain(str(error))
        except UsageError as error:
            help_ = " ".join(filter(None, ("joint-id", ctx.invoked_subcommand, "--help")))
            complain(f"{error.format_message()} See {help_}")  # type: ignore[attr-defined]  # see UsageError
        except MemoryError:
            complain("not enough memory: take less of the recording (--start, --end), or a computer with more of it")
        except BrokenPipeError:  # a reader such as head has seen enough
            raise
        except OSError as error:
            place = f"{error.filename}: " if error.filename is not None else ""
            complain(f"{place}{error.strerror or error}: check the path, its permissions and the space")
        raise typer.Exit(BAD_INPUT)


def complain(message: str) -> None:
    """Write one line to stderr."""
    print(f"joint-id: {' '.join(message.split())}", file=sys.stderr)
