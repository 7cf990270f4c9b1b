"""Start, spin and stop any of the nodes.

While a node starts, which takes about a second for imports, a signal ends the process at once. Afterwards a signal only
sets a flag, which is checked between callbacks. The handlers of rclpy would shut the context down in the middle of a
callback, and Python's would raise KeyboardInterrupt there.
"""

from __future__ import annotations

import gc
import os
import signal
import sys
import time
from collections.abc import Sequence
from functools import partial
from importlib import import_module
from typing import Any, Protocol

from joint_id_core.errors import JointIdError
from joint_id_ros.own_arguments import helped

BAD_INPUT = 2  # exit code
ENDED_EARLY = 3  # exit code
# Signals so far; a callback that takes long ends early when there is one. A list and not a threading.Event: its lock is
# taken in the handler, and the handler of a second signal, which interrupts the first, would wait for it for ever.
SIGNALS: list[int] = []
POLL_S = 0.1  # longest time until a signal is noticed in an idle node
TURN_S = 0.05  # time between two turns of the executor in a node that reads streams
TURN_LASTS_S = 0.004  # of such a turn, mostly


class EndedEarlyError(JointIdError):
    """The input ended before its end, after a part of it was used."""


class Read(Protocol):
    """Interface of what the main loop reads."""

    read_s: float  # time until the next reading is due

    def read(self) -> None:
        """Read and pass on what has arrived."""


class Runnable(Protocol):
    """Interface that `run` needs of a node, in addition to rclpy's Node."""

    finished: Any  # rclpy Future, set when there is nothing more to do; its result is None or a JointIdError
    streams: Read | None  # read here, and not by the executor

    def close(self) -> None:
        """Stop threads and close files; called once, however the node ended."""


def node_module(name: str) -> Any:
    """Return the module `nodes/<name>.py`."""
    return import_module(f"joint_id_ros.nodes.{name}")


def node_class(name: str) -> Any:
    """Return the class of the node `name`, such as `ArmIdentifierNode` of `nodes/arm_identifier.py`."""
    return getattr(node_module(name), f"{name.title().replace('_', '')}Node")


def run(name: str, arguments: Sequence[str] | None = None) -> int:
    """Run the node of `nodes/<name>.py` until SIGINT, SIGTERM or its own end; return the exit code.

    The arguments are those of ROS; None takes those of the command line, which may ask for help.

    The exit code is 0 after a signal or a normal end, 2 after bad input, and 3 after input that turned bad later. Bad
    input is reported in one line on stderr.
    """
    spinning = False

    def note(number: int, _: object) -> None:
        SIGNALS.append(number)
        if not spinning:
            # An exception may be lost in an import, or leave an incomplete DDS participant that never ends.
            os._exit(0)

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, note)

    import rclpy
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.signals import SignalHandlerOptions

    from joint_id_ros.parameters import PARAMETER_ERRORS
    from joint_id_ros.transport import without_shared_memory

    without_shared_memory()
    node = executor = None
    try:
        if arguments is None and helped(name, sys.argv[1:], lambda: node_module(name)):
            return 0
        make = node_class(name)
        rclpy.init(args=None if arguments is None else list(arguments), signal_handler_options=SignalHandlerOptions.NO)
        node = make()
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        spinning, next_turn, next_reading = True, 0.0, 0.0
        while not SIGNALS and not node.finished.done():
            streams = node.streams
            if streams is None:
                executor.spin_once(timeout_sec=POLL_S)
                continue
            streams.read()
            now = time.monotonic()
            next_reading = max(next_reading + streams.read_s, now)
            if now >= next_turn:
                # Late in the pause: what was read has woken threads that compute; the executor would keep them waiting.
                time.sleep(max(0.0, next_reading - TURN_LASTS_S - now))
                executor.spin_once(timeout_sec=0.0)
                next_turn = now + TURN_S
            time.sleep(max(0.0, next_reading - time.monotonic()))
        if node.finished.done() and node.finished.result() is not None:
            raise node.finished.result()
        return 0
    except (JointIdError, *PARAMETER_ERRORS) as error:
        print(f"{name}: {error}", file=sys.stderr)
        return ENDED_EARLY if isinstance(error, EndedEarlyError) else BAD_INPUT
    finally:
        gc.unfreeze()  # the end of the process finds everything as without `spare_the_collector`
        if node is not None:
            node.close()
            node.destroy_node()
        if executor is not None:
            executor.shutdown()  # before the context: an executor that is deleted after it reports an error
        rclpy.try_shutdown()


def spare_the_collector() -> None:
    """Exempt all objects that exist from garbage collection.

    Modules and kernels stay as long as the process. To look through them again and again took an eighth of the
    processor time of an identifier.
    """
    gc.collect()
    gc.freeze()


# Entry points of the nodes: console scripts of setup.py.
arm_identifier = partial(run, "arm_identifier")
driver = partial(run, "driver")
emulated_motion = partial(run, "emulated_motion")
filter = partial(run, "filter")
fleet = partial(run, "fleet")
identifier = partial(run, "identifier")
identify = partial(run, "identify")
player = partial(run, "player")
sim = partial(run, "sim")
watch = partial(run, "watch")
watch_fleet = partial(run, "watch_fleet")
