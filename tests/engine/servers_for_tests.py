"""A small cache server, and ones that misbehave on purpose."""

from __future__ import annotations

import random
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer


class CacheServer(ThreadingHTTPServer):
    """Keeps `/ac/...` and `/cas/...` in memory. fault: how it misbehaves, "" = well.

    forgets: the share of requests after which it forgets a file, chosen at random.
    connections: how many it has accepted.
    """

    daemon_threads = True
    block_on_close = False

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), Handler)
        self.files: dict[str, bytes] = {}
        self.asked: list[tuple[str, str]] = []
        self.headers_seen: list[dict[str, str]] = []
        self.fault = ""
        self.elsewhere = ""
        self.forgets = 0.0
        self.forgotten = 0
        self.connections = 0
        self.random = random.Random(0)
        self.changing = threading.Lock()
        self.stopping = threading.Event()

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.server_address[1]}"

    def process_request(self, *request: object) -> None:
        self.connections += 1
        super().process_request(*request)

    def forget(self, count: int) -> None:
        with self.changing:
            for name in self.random.sample(sorted(self.files), min(count, len(self.files))):
                del self.files[name]
                self.forgotten += 1

    def handle_error(self, *_: object) -> None:
        """The client cut the connection; that is the test."""


class Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server: CacheServer

    def log_message(self, *_: object) -> None: ...

    def do_HEAD(self) -> None:
        self.answer(with_body=False)

    def do_GET(self) -> None:
        self.answer(with_body=True)

    def do_PUT(self) -> None:
        self.note()
        body = self.rfile.read(int(self.headers["Content-Length"]))
        if self.server.fault == "500":
            self.plain(500, b"")
            return
        with self.server.changing:
            self.server.files[self.path] = body
        self.plain(200, b"")

    def do_CONNECT(self) -> None:
        self.note()
        self.plain(502, b"")

    def note(self) -> None:
        if self.server.random.random() < self.server.forgets:
            self.server.forget(1)
        self.server.asked.append((self.command, self.path))
        self.server.headers_seen.append(dict(self.headers.items()))

    def plain(self, status: int, body: bytes, **headers: str) -> None:
        self.send_response(status)
        for name, value in headers.items():
            self.send_header(name, value)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(body)

    def answer(self, *, with_body: bool) -> None:
        self.note()
        body = self.server.files.get(self.path)
        fault = self.server.fault
        if (
            fault
            and fault != "forgets_connections"
            and with_body
            and (not fault.startswith("cas") or self.path.startswith("/cas"))
        ):
            with suppress(OSError):
                getattr(self, f"do_fault_{fault.removeprefix('cas_')}")(body or b"x" * 100)
            self.close_connection = True
        elif body is None:
            self.plain(404, b"")
        else:
            self.plain(200, body)
        if fault == "forgets_connections":  # and does not say so
            self.close_connection = True

    def do_fault_500(self, body: bytes) -> None:
        self.plain(500, b"sorry")

    def do_fault_wrong_bytes(self, body: bytes) -> None:
        self.plain(200, bytes([body[0] ^ 1]) + body[1:])

    def do_fault_short(self, body: bytes) -> None:
        self.plain(200, body[:-1])

    def do_fault_huge_length(self, body: bytes) -> None:
        self.send_response(200)
        self.send_header("Content-Length", str(1 << 60))
        self.end_headers()
        self.wfile.write(body)
        self.server.stopping.wait(30)

    def do_fault_endless(self, body: bytes) -> None:
        self.send_response(200)
        self.end_headers()
        while not self.server.stopping.is_set():
            self.wfile.write(b"x" * 65536)

    def do_fault_slow(self, body: bytes) -> None:
        self.send_response(200)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.trickle(body)

    def do_fault_slow_headers(self, body: bytes) -> None:
        self.trickle(b"HTTP/1.1 200 OK\r\nX-Long: " + b"x" * 1000)

    def trickle(self, data: bytes) -> None:
        for byte in data:
            if self.server.stopping.is_set():
                return
            self.wfile.write(bytes([byte]))
            self.wfile.flush()
            time.sleep(0.2)

    def do_fault_redirect(self, body: bytes) -> None:
        self.plain(302, b"", Location=f"{self.server.elsewhere}{self.path}")

    def do_fault_garbage(self, body: bytes) -> None:
        self.plain(200, b"[" * 100_000)

    def do_fault_hang_up(self, body: bytes) -> None:
        self.connection.close()


@contextmanager
def serving() -> Iterator[CacheServer]:
    with CacheServer() as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True)
        thread.start()
        try:
            yield server
        finally:
            server.stopping.set()
            server.shutdown()
            thread.join()
