"""A method in a process of its own: one core, a limit of time, and libraries that may be missing."""

from __future__ import annotations

import multiprocessing
import os
import warnings
from collections.abc import Sequence
from importlib import import_module, metadata
from multiprocessing.connection import Connection

from cpu_time import cpu_s

from robots.arm_peers.found import Found, Method
from robots.arm_peers.logs import Log

START_S = 60.0  # processor time that importing a library may take


def serve(connection: Connection, module: str, urdf: str, logs: Sequence[Log]) -> None:
    """What the process does: import a method, say which package it is, then send a fit of each log."""
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    warnings.simplefilter("ignore")
    try:
        method = import_module(module)
    except ImportError as error:
        connection.send(f"not installed: {error.name or error}")
        return
    package = method.PACKAGE
    connection.send((f"{package} {metadata.version(package)}" if package else "",))
    for log in logs:
        others = [other for other in logs if other is not log]
        try:
            connection.send(method.fit(urdf, log, others))
        except Exception as error:  # whatever a library raises is told in its row
            connection.send(f"{log.name}: {type(error).__name__}: {' '.join(str(error).split())}")


def fitted(name: str, module: str, urdf: str, logs: Sequence[Log], limit_s: float) -> Method:
    """Fit all logs by the method of a module.

    A fit that takes longer than `limit_s` of processor time ends it; that is told, and so is a library that is missing.
    """
    context = multiprocessing.get_context("spawn")
    mine, theirs = context.Pipe()
    process = context.Process(target=serve, args=(theirs, module, urdf, logs), daemon=True)
    process.start()
    theirs.close()
    fits, failed = [], ""
    try:
        for k in range(len(logs) + 1):
            answer = _answer(process, mine, limit_s if k else START_S)
            if isinstance(answer, Found):
                fits.append(answer)
            elif isinstance(answer, tuple):
                name = f"{name} ({answer[0]})" if answer[0] else name
            else:
                failed = str(answer)
                break
    finally:
        process.kill()
        process.join()
    return Method(name, tuple(fits), failed)


def _answer(process: multiprocessing.process.BaseProcess, connection: Connection, limit_s: float) -> object:
    """What the process answers, or in words why it does not."""
    assert process.pid is not None
    end_s = cpu_s(process.pid) + limit_s
    while not connection.poll(0.2):
        if process.is_alive() and cpu_s(process.pid) > end_s:
            return f"stopped after {limit_s:g} s of a fit"
    try:
        return connection.recv()
    except EOFError:
        process.join()
        return f"ended with exit code {process.exitcode}"
