"""Start, spin and stop of a node, the same for all."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable
from typing import Protocol

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.task import Future

from joint_id_core.errors import JointIdError
from joint_id_ros.parameters import PARAMETER_ERRORS

BAD_INPUT = 2  # exit code


class Runnable(Protocol):
    """What `run` needs of a node beside rclpy's Node."""

    finished: Future  # set when the node has nothing more to do; its result is None or a JointIdError

    def close(self) -> None:
        """Stop threads and close files; called once, whatever ended the node."""


def run(name: str, make: Callable[[], Runnable]) -> int:
    """Run a node until SIGINT, SIGTERM or its own end and return the exit code.

    0 after a signal or a normal end, 2 after bad input, told in one line on stderr.
    """
    # rclpy shuts the context down on both signals; without this Python adds a KeyboardInterrupt anywhere.
    signal.signal(signal.SIGINT, lambda *_: None)
    node: Runnable | None = None
    code = 0
    try:
        rclpy.init()
        node = make()
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        executor.spin_until_future_complete(node.finished)
        if node.finished.done() and node.finished.result() is not None:
            raise node.finished.result()
    except ExternalShutdownException:
        pass
    except (JointIdError, *PARAMETER_ERRORS) as error:
        print(f"{name}: {error}", file=sys.stderr)
        code = BAD_INPUT
    finally:
        if node is not None:
            node.close()
            node.destroy_node()  # type: ignore[attr-defined]  # rclpy's
        rclpy.try_shutdown()
    return code
