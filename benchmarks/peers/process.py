"""A peer in a process of its own: one core, a limit of time, and libraries that may be missing."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Mapping
from importlib import import_module
from multiprocessing.connection import Connection
from typing import Any

from cpu_time import cpu_s

from peers.model2 import FREE, MODEL, Data, processor_s
from peers.results import Run

# For the environment of the processes: libraries read it when they are imported.
SINGLE_CORE = {
    **dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1"),
    "JAX_PLATFORMS": "cpu",
    "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1",
}
SETUP_LIMIT_S = 120.0  # processor time that a peer may take for compilation beside the limit of a run


def serve(connection: Connection, name: str, limit_s: float) -> None:
    """What the process does: import a peer, say what that took in s, then fit (data, start) until None comes."""
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    begun = processor_s()
    try:
        fit = import_module(f"peers.{name}").fit
    except ImportError as error:
        connection.send(f"not installed: {error.name or error}")
        return
    connection.send(processor_s() - begun)
    while (task := connection.recv()) is not None:
        connection.send(fit(*task, limit_s))


class Peer:
    """The process, seen from outside. It is killed when a fit does not end by itself.

    Attributes:
        import_s: processor time of its import in s.
        missing: why it cannot run; empty when it can.
    """

    def __init__(self, name: str, limit_s: float) -> None:
        self.name, self.limit_s = name, limit_s
        started = self._start()
        self.missing = started if isinstance(started, str) else ""
        self.import_s = 0.0 if self.missing else float(started)

    def run(self, data: Data, torque_noise: float, start: int, values: Mapping[str, float]) -> Run:
        """Fit once from `values`, SI units."""
        if self.missing:
            return Run(self.name, torque_noise, start, note=self.missing)
        if not self._process.is_alive():
            self._start()
        self._connection.send((data, values))
        fit = self._answer()
        if isinstance(fit, str):
            return Run(self.name, torque_noise, start, note=fit)
        truth = MODEL.values()
        errors = {name: fit.values[name] / truth[name] - 1.0 for name in FREE}
        note = "" if fit.finished else "stopped at the time limit" if fit.seconds >= self.limit_s else "no minimum"
        return Run(self.name, torque_noise, start, fit.seconds, fit.setup_s, fit.iterations, fit.finished, errors, note)

    def close(self) -> None:
        """End the process."""
        if self._process.is_alive() and not self.missing:
            self._connection.send(None)
        self._process.join()

    def _start(self) -> Any:
        context = multiprocessing.get_context("spawn")
        self._connection, theirs = context.Pipe()
        self._process = context.Process(target=serve, args=(theirs, self.name, self.limit_s), daemon=True)
        self._process.start()
        theirs.close()
        return self._answer()

    def _answer(self) -> Any:
        """What the process answers, or in words why it does not."""
        pid = self._process.pid
        assert pid is not None
        allowed_s = self.limit_s + SETUP_LIMIT_S
        end_s = cpu_s(pid) + allowed_s
        while not self._connection.poll(0.2):
            if self._process.is_alive() and cpu_s(pid) > end_s:
                self._process.kill()
                self._process.join()
                return f"killed after {allowed_s:g} s"
        try:
            return self._connection.recv()
        except EOFError:
            self._process.join()
            return f"ended with exit code {self._process.exitcode}"
