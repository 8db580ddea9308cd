"""The shared cache over HTTP: GET, HEAD and PUT of /ac/<key> and /cas/<sha256>.

The protocol of bazel-remote and of Bazel's own HTTP cache, so servers exist. Redirects are not
followed: what is sent goes to the host that the user named, and to no other.
"""

from __future__ import annotations

import base64
import http.client
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from assetbuild.engine.digest import CHUNK

SLOWEST = 128 << 10
"""Bytes per second below which a transfer is given up."""
ANSWER_BYTES = 1 << 20
"""No answer to an upload is read further."""


class HttpPlace:
    """A server. parts: of its address, whose port may raise ValueError (urllib's SplitResult)."""

    def __init__(self, parts: Any, request_s: float) -> None:  # Any: urllib's SplitResult
        host = parts.netloc.rpartition("@")[2]
        self.name = f"{parts.scheme}://{host}{parts.path.rstrip('/')}"  # without credentials
        self._parts = parts
        self._headers = _credentials(parts.username, parts.password)
        self._request_s = request_s

    def exchange(self) -> HttpExchange:
        """A connection of its own."""
        return HttpExchange(self._parts, self._headers, self._request_s)


class HttpExchange:
    """A few requests over one connection; each within its time, each body within its size."""

    def __init__(self, parts: Any, headers: Mapping[str, str], request_s: float) -> None:
        # Any: urllib's SplitResult, whose port may raise ValueError
        is_https = parts.scheme == "https"
        kind = http.client.HTTPSConnection if is_https else http.client.HTTPConnection
        self._connection = kind(parts.hostname, parts.port, timeout=request_s)
        self._prefix = parts.path.rstrip("/")
        self._headers = dict(headers)
        self._request_s = request_s

    def get(self, name: str, limit: int) -> bytes | None:
        """A small body; None when the server has none of this name."""
        with self._within(self._request_s), self._ask("GET", name) as response:
            if response.status == 404:
                return None
            data = response.read(limit + 1)
            if len(data) > limit:
                raise ValueError("a body is larger than it may be")
            return bytes(data)

    def save(self, name: str, size: int, dest: Path) -> None:
        """Write a body of exactly `size` bytes to a file."""
        with self._within(self._request_s):
            response = self._ask("GET", name)
        began = time.monotonic()
        with response, dest.open("wb") as file:
            if response.status != 200:
                raise ValueError("an object is missing")
            left = size
            while left and (chunk := response.read1(min(CHUNK, left))):
                file.write(chunk)
                left -= len(chunk)
                if time.monotonic() - began > self._request_s + (size - left) / SLOWEST:
                    raise TimeoutError("it is too slow")
            if left or response.read(1):
                raise ValueError("an object has not the size of its entry")

    def has(self, name: str) -> bool:
        """Does the server have it already?"""
        with self._within(self._request_s), self._ask("HEAD", name) as response:
            response.read()
            return bool(response.status == 200)

    def put(self, name: str, body: bytes | Path) -> None:
        """Upload bytes or a file."""
        size = len(body) if isinstance(body, bytes) else body.stat().st_size
        with self._within(self._request_s + size / SLOWEST):
            if isinstance(body, bytes):
                response = self._ask("PUT", name, body, size)
            else:
                with body.open("rb") as file:
                    response = self._ask("PUT", name, file, size)
            with response:
                response.read(ANSWER_BYTES)

    def _ask(self, verb: str, name: str, body: Any = None, size: int = 0) -> Any:  # Any: a file
        headers = dict(self._headers)
        if body is not None:
            headers |= {"Content-Length": str(size), "Content-Type": "application/octet-stream"}
        self._connection.request(verb, f"{self._prefix}/{name}", body=body, headers=headers)
        response = self._connection.getresponse()
        if response.status not in (200, 201, 204, 404) or (
            verb == "PUT" and response.status == 404
        ):
            raise ValueError(f"it answered {response.status}")
        return response

    @contextmanager
    def _within(self, allowed_s: float) -> Iterator[None]:
        """Cut the connection when the time of a request is over: a server may trickle for ever."""
        over = threading.Event()

        def cut() -> None:
            over.set()
            sock = self._connection.sock
            if sock is not None:
                with suppress(OSError):
                    sock.shutdown(2)

        timer = threading.Timer(allowed_s, cut)
        timer.daemon = True
        timer.start()
        try:
            yield
        finally:
            timer.cancel()
        if over.is_set():
            raise TimeoutError("it is too slow")

    def close(self) -> None:
        """Close the connection."""
        self._connection.close()


def _credentials(user: str | None, password: str | None) -> dict[str, str]:
    if user is None:
        return {}
    pair = f"{unquote(user)}:{unquote(password or '')}".encode()
    return {"Authorization": f"Basic {base64.b64encode(pair).decode()}"}
