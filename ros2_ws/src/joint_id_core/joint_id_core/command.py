"""Where the console script `joint-id` begins: Ctrl-C ends it while it still loads, without a traceback."""

from __future__ import annotations

import signal
import sys


def main() -> None:
    """Run the command line; `cli.main` says more."""
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:  # as shells have it for jobs in the background
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        from joint_id_core.cli import main as run  # a fifth of a second
    except ModuleNotFoundError as error:  # not even what shows messages
        print(f"joint-id: a library cannot be loaded ({error}): pip install {error.name}", file=sys.stderr)
        sys.exit(2)
    run()
