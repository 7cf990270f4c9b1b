"""Kernels are compiled once a computer: processes that need the same one wait for the first of them."""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import pytest

COMPILED = """
import joint_id_core as jid
from numba.core import event


def count(barrier_port):
    import socket

    socket.create_connection(("127.0.0.1", barrier_port)).recv(1)  # all begin at once
    with event.install_recorder("numba:compile") as recorder:
        from joint_id_core.cell.kernel import compile_model

        module = compile_model(jid.build("rigid_joint")).module
    assert callable(module.innovations)
    return len(recorder.buffer)
"""


@pytest.mark.long
def test_two_processes_that_begin_at_once_compile_once(tmp_path, monkeypatch):
    import importlib
    import socket

    (tmp_path / "compiled_here.py").write_text(COMPILED)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("JOINT_ID_CACHE_DIR", str(tmp_path / "cache"))
    count = importlib.import_module("compiled_here").count
    with socket.create_server(("127.0.0.1", 0)) as gate, ProcessPoolExecutor(2, get_context("spawn")) as pool:
        port = gate.getsockname()[1]
        waiting = [pool.submit(count, port) for _ in range(2)]
        lines = [gate.accept()[0] for _ in range(2)]
        for line in lines:
            line.sendall(b"!")
        both = [future.result() for future in waiting]
        again = pool.submit(count, port)
        line = gate.accept()[0]
        line.sendall(b"!")
        assert again.result() == 0, "a third use compiles nothing"
    modules = [folder for folder in (tmp_path / "cache").iterdir() if folder.is_dir()]
    kept = sum(len(list(folder.rglob("*.nbc"))) for folder in modules)
    assert sum(both) == 2 * kept > 0, "each function is compiled by one process: an event at begin and at end"
