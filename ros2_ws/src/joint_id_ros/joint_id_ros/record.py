"""`joint-id record`: write live topics to an mcap bag.

Messages are written as the bytes that were received. rclpy and rosbags load slowly, so they are imported only when
recording starts: `joint-id --help`, which imports this module, stays fast.
"""

from __future__ import annotations

import signal
import sys
import time
from pathlib import Path
from typing import Annotated, Optional

import typer

from joint_id_core.errors import JointIdError


def record(
    output: Annotated[Path, typer.Argument(help="bag directory to create")],
    topics: Annotated[Optional[list[str]], typer.Argument(help="topics (default: all)")] = None,
    duration: Annotated[Optional[float], typer.Option(help="stop after this many s (default: at Ctrl-C)")] = None,
    namespace: Annotated[str, typer.Option(help="of the robot whose topics are recorded, such as /left")] = "",
) -> None:
    """Record live topics to an mcap bag until Ctrl-C, SIGTERM or the end of --duration.

    Topics may appear at any time. Nothing is overwritten.
    """
    if output.exists():
        raise JointIdError(f"{output} exists already: remove it or choose another name")
    if not output.absolute().parent.is_dir():
        raise JointIdError(f"{output}: its folder {output.absolute().parent} does not exist: create it")
    if duration is not None and not duration > 0.0:
        raise JointIdError(f"--duration {duration:g}: give more than 0 s")

    import rclpy
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.signals import SignalHandlerOptions

    from joint_id_ros.recorder import Recorder, drain
    from joint_id_ros.transport import without_shared_memory

    without_shared_memory()
    # Own signal handlers: those of rclpy would shut the context down before all messages are written.
    stopped: list[int] = []
    previous = {s: signal.signal(s, lambda number, _: stopped.append(number)) for s in (signal.SIGINT, signal.SIGTERM)}
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    recorder = None
    try:
        recorder = Recorder(output, topics or [], namespace)
        executor = SingleThreadedExecutor()
        executor.add_node(recorder)
        begin = shown = time.monotonic()
        while not stopped and (duration is None or time.monotonic() - begin < duration):
            executor.spin_once(timeout_sec=0.1)
            if sys.stderr.isatty() and time.monotonic() - shown > 1.0:
                shown = time.monotonic()
                print(f"\r\x1b[K{recorder.summary}", end="", file=sys.stderr, flush=True)
        drain(recorder, executor)
    finally:
        if recorder is not None:
            recorder.close()
            recorder.destroy_node()
        rclpy.try_shutdown()
        for number, handler in previous.items():
            signal.signal(number, handler)
    if sys.stderr.isatty():
        print("\r\x1b[K", end="", file=sys.stderr, flush=True)
    if recorder.count == 0:
        wanted = ", ".join(topics) if topics else f"any topic in {namespace}" if namespace else "any topic"
        raise JointIdError(f"no message arrived on {wanted}, nothing was written: check the names and ROS_DOMAIN_ID")
    print(f"{output}: {recorder.summary}")
    if recorder.silent:
        print(f"joint-id: no message arrived on {', '.join(recorder.silent)}", file=sys.stderr)
