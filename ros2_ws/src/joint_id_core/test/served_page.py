"""A server of a live page whose joints change, for tests."""

from __future__ import annotations

import http.client
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from joint_id_core.errors import JointIdError
from joint_id_core.pages.live import ACTIONS, LiveView, Seen, live_page
from joint_id_core.pages.server import Feed, PageServer
from joint_id_core.results.estimate import Estimate, Predictions

JOINTS = tuple(f"joint_{k}" for k in range(6))
RATE = 500  # Hz


def at(estimate: Estimate, seconds: float) -> Estimate:
    """The same estimate, a little different, with a window that ends then."""
    rows = tuple(replace(p, value=p.value * (1.0 + 0.001 * np.sin(seconds))) for p in estimate.parameters)
    return replace(estimate, parameters=rows, end=seconds)


def window(seconds: float) -> Predictions:
    """Four seconds of 500 Hz."""
    time_ = np.arange(4 * RATE) / RATE
    measured = np.sin(3.0 * time_ + seconds)
    return Predictions(time_, {"link_position": measured}, {"link_position": measured + 1e-4})


@contextmanager
def served(estimate: Estimate, period: float = 0.5) -> Iterator[tuple[PageServer, list[str]]]:
    """A server of a live page of six joints, whose state changes every `period`, and the actions asked for."""
    view, feed, asked, ended, lock = LiveView(), Feed(), list[str](), threading.Event(), threading.Lock()

    def act(name: str) -> str:
        asked.append(name)
        if name == "reset":
            raise JointIdError("not now")
        return f"{name} is done"

    def go_on() -> None:
        begin = time.monotonic()
        while not ended.wait(period):
            now = time.monotonic() - begin
            with lock:
                view.take({joint: Seen(at(estimate, now)) for joint in JOINTS})
                nodes = [{"name": "/driver", "level": 1, "message": "late", "values": [["rate [Hz]", "499.9"]]}]
                feed.publish({"joints": view.joints(), "nodes": nodes, "silent": []})

    def plots(query: dict[str, str]) -> dict[str, object]:
        with lock:
            return {**view.plots(query.get("name", ""), window(time.monotonic())), "told": "of this moment"}

    actions = {f"/action/{name}": (lambda _, name=name: act(name)) for name in ACTIONS}
    pages: dict[str, Callable[..., str]] = {"/": lambda _: live_page("robot"), "/report": lambda q: q["joint"]}
    server = PageServer(0, pages, {"/joint": plots}, actions, feed)
    thread = threading.Thread(target=go_on)
    thread.start()
    try:
        yield server, asked
    finally:
        ended.set()
        thread.join()
        server.close()


def ask(server: PageServer, path: str, method: str = "GET", **headers: str) -> tuple[int, str]:
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=10.0)
    connection.request(method, path, headers={name.replace("_", "-"): value for name, value in headers.items()})
    answer = connection.getresponse()
    return answer.status, answer.read().decode()
