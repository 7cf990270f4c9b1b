"""A server of pages for the browsers of this computer alone.

It listens on 127.0.0.1. A page of another site that is open in the same browser could still send requests there, or
reach it under a name of its own (DNS rebinding): requests for another host or from another origin are refused.
"""

from __future__ import annotations

import json
import sys
import threading
from collections.abc import Callable, Mapping
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qsl, urlsplit

from joint_id_core.errors import JointIdError

HOST = "127.0.0.1"
BEAT_S = 5.0  # longest silence of the events
MOST_EVENTS = 20  # readers of the events at the same time
LARGEST = 1000  # bytes of a request's body
MARK = "X-Joint-Id"  # a header that a page of another origin cannot send without asking, which is refused
Query = Mapping[str, str]


class Feed:
    """The newest state, for readers that wait for it. A slow reader misses states, and nothing piles up."""

    def __init__(self) -> None:
        self._changed, self._number, self._text = threading.Condition(), 0, ""

    def publish(self, state: Any) -> None:
        """Give a new state to all readers."""
        text = json.dumps(state, allow_nan=False, separators=(",", ":"))
        with self._changed:
            self._number, self._text = self._number + 1, text
            self._changed.notify_all()

    def newer(self, number: int, timeout_s: float) -> tuple[int, str]:
        """Return number and text of a state newer than that with a number; text is empty if none came in time."""
        with self._changed:
            self._changed.wait_for(lambda: self._number > number, timeout_s)
            return self._number, self._text if self._number > number else ""


class PageServer:
    """Serves pages (HTML), answers (JSON), the events of a feed, and actions that a button asks for.

    Args:
        port: 0 takes any that is free.
        pages, answers, actions: by path, what makes the answer from the query of the address. What they raise as
            `JointIdError` is the answer.
        feed: at the path `/events`, as server-sent events.

    Raises:
        JointIdError: the port is in use, or not allowed.
    """

    def __init__(
        self,
        port: int,
        pages: Mapping[str, Callable[[Query], str]],
        answers: Mapping[str, Callable[[Query], Any]],
        actions: Mapping[str, Callable[[Query], str]],
        feed: Feed,
    ) -> None:
        self.pages, self.answers, self.actions, self.feed = pages, answers, actions, feed
        self.closed, self.readers = threading.Event(), threading.BoundedSemaphore(MOST_EVENTS)
        try:
            self._server = _Quiet((HOST, port), _handler(self))
        except OSError as error:
            raise JointIdError(f"port {port} cannot be used ({error.strerror}): choose another one") from error
        self.port = int(self._server.server_address[1])
        self._thread = threading.Thread(target=self._server.serve_forever, name="pages", daemon=True)
        self._thread.start()

    @property
    def address(self) -> str:
        """Of the first page."""
        return f"http://{HOST}:{self.port}/"

    def close(self) -> None:
        """End the server and its connections."""
        self.closed.set()
        self.feed.publish({})
        self._server.shutdown()
        self._server.server_close()


class _Quiet(ThreadingHTTPServer):
    """A server that says nothing of connections that the browser closed."""

    daemon_threads = True

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say what went wrong, if it was not the connection."""
        if not isinstance(sys.exc_info()[1], OSError):
            super().handle_error(request, client_address)


def _handler(server: PageServer) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        """One request."""

        protocol_version = "HTTP/1.1"
        timeout = 30.0

        def log_message(self, format: str, *args: Any) -> None:
            """Say nothing of requests."""

        def do_GET(self) -> None:  # the name that http.server calls
            """Answer with a page, with JSON, or with events."""
            if not self._own():
                return
            address = urlsplit(self.path)
            query = dict(parse_qsl(address.query))
            if address.path == "/events":
                self._events()
            elif address.path in server.pages:
                self._made(lambda: (server.pages[address.path](query), "text/html; charset=utf-8"))
            elif address.path in server.answers:
                self._made(lambda: (_json(server.answers[address.path](query)), "application/json"))
            else:
                self._send(HTTPStatus.NOT_FOUND, "no such page", "text/plain")

        def do_POST(self) -> None:
            """Do what a button asks for."""
            if not self._own():
                return
            length = self.headers.get("Content-Length", "0")
            if not length.isdigit() or int(length) > LARGEST:
                self._send(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, "too long", "text/plain")
                return
            self.rfile.read(int(length))
            address = urlsplit(self.path)
            if self.headers.get(MARK) != "1":
                self._send(HTTPStatus.FORBIDDEN, f"only for the page of this server (header {MARK})", "text/plain")
            elif address.path not in server.actions:
                self._send(HTTPStatus.NOT_FOUND, "no such action", "text/plain")
            else:
                action = server.actions[address.path]
                self._made(lambda: (_json({"message": action(dict(parse_qsl(address.query)))}), "application/json"))

        def _own(self) -> bool:
            """Return whether a request is for this host and comes from it; refuse others."""
            names = {f"{HOST}:{server.port}", f"localhost:{server.port}"}
            origin = self.headers.get("Origin")
            if self.headers.get("Host") in names and (origin is None or urlsplit(origin).netloc in names):
                return True
            self.close_connection = True
            self._send(HTTPStatus.FORBIDDEN, "only for browsers of this computer", "text/plain")
            return False

        def _made(self, make: Callable[[], tuple[str, str]]) -> None:
            try:
                text, kind = make()
            except JointIdError as error:
                self._send(HTTPStatus.CONFLICT, str(error), "text/plain; charset=utf-8")
                return
            self._send(HTTPStatus.OK, text, kind)

        def _send(self, status: HTTPStatus, text: str, kind: str) -> None:
            body = text.encode()
            self.send_response(status)
            self._headers(kind)
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        def _headers(self, kind: str) -> None:
            self.send_header("Content-Type", kind)
            self.send_header("Cache-Control", "no-store")
            self.send_header("X-Content-Type-Options", "nosniff")
            self.send_header("X-Frame-Options", "DENY")

        def _events(self) -> None:
            if not server.readers.acquire(blocking=False):
                self._send(HTTPStatus.SERVICE_UNAVAILABLE, "too many pages are open", "text/plain")
                return
            self.close_connection = True
            try:
                self.send_response(HTTPStatus.OK)
                self._headers("text/event-stream")
                self.end_headers()
                number = 0
                while not server.closed.is_set():
                    number, text = server.feed.newer(number, BEAT_S)
                    self.wfile.write(f"data: {text}\n\n".encode() if text else b": still here\n\n")
                    self.wfile.flush()
            except OSError:
                pass  # the page was closed
            finally:
                server.readers.release()

    return Handler


def _json(answer: Any) -> str:
    return json.dumps(answer, allow_nan=False, separators=(",", ":"))
