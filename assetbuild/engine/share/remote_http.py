"""The shared cache over HTTP: GET, HEAD and PUT of /ac/<key> and /cas/<sha256>.

The protocol of bazel-remote and of Bazel's own HTTP cache, so servers exist. Connections are kept
and shared by all threads. Redirects are not followed: what is sent goes to the host that the user
named, and to no other.
"""

from __future__ import annotations

import io
import netrc
import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any
from urllib.parse import SplitResult, unquote, urlsplit
from urllib.request import getproxies, proxy_bypass

import urllib3

from assetbuild.engine.digest import CHUNK
from assetbuild.errors import UsageError

SLOWEST = 128 << 10
"""Bytes per second below which a transfer is given up."""
ANSWER_BYTES = 1 << 20
"""No answer to an upload is read further."""
CONNECTIONS = 16
"""Connections that are kept for the next request."""
ONCE_MORE = urllib3.Retry(
    connect=0, read=1, redirect=0, status=0, other=0, respect_retry_after_header=False
)
"""A server may close a connection that was kept."""


class HttpPlace:
    """A server. Threads may share it.

    Credentials are those of the address, else `$ASSETBUILD_REMOTE_TOKEN` as a bearer token, else
    those of the user's netrc file. Proxies are those of `HTTPS_PROXY` and its kin.
    """

    def __init__(self, parts: SplitResult, request_s: float) -> None:
        host = parts.netloc.rpartition("@")[2]
        self.name = f"{parts.scheme}://{host}{parts.path.rstrip('/')}"  # without credentials
        self._headers = _credentials(parts)
        self._request_s = request_s
        self._manager = _manager(parts.scheme, host)
        pool: Any = self._manager.connection_from_url(self.name)  # Any: of either scheme
        pool.ConnectionCls = type("Connection", (_Cuttable, pool.ConnectionCls), {})

    def get(self, name: str, limit: int) -> bytes | None:
        """A small body; None when the server has none of this name."""
        with self._asked("GET", name) as response:
            if response.status == 404:
                return None
            data = b"".join(self._body(response, limit))
            if len(data) > limit:
                raise ValueError("a body is larger than it may be")
            return data

    def save(self, name: str, size: int, dest: Path) -> bool:
        """Write a body of exactly `size` bytes to a file; False when the server has not all."""
        with self._asked("GET", name) as response, dest.open("wb") as file:
            length = _length(response)
            if response.status == 404 or (length is not None and length < size):
                return False
            for chunk in self._body(response, size):
                file.write(chunk)
            if file.tell() != size:
                raise ValueError("an object has not the size of its entry")
            return True

    def has(self, name: str, size: int | None = None) -> bool:
        """Does the server have it already, of this size if one is given?"""
        with self._asked("HEAD", name) as response:
            response.read()
            return response.status == 200 and (size is None or _length(response) in (None, size))

    def put(self, name: str, body: bytes | Path) -> None:
        """Upload bytes or a file."""
        size = len(body) if isinstance(body, bytes) else body.stat().st_size
        with (
            io.BytesIO(body) if isinstance(body, bytes) else body.open("rb") as file,
            self._asked("PUT", name, file, size) as response,
        ):
            if response.status == 404:
                raise ValueError("it answered 404")
            for _ in self._body(response, ANSWER_BYTES):
                pass

    @contextmanager
    def _asked(self, verb: str, name: str, body: Any = None, size: int = 0) -> Iterator[Any]:
        """The answer, 404 or good; its connection is kept when all of it was read."""
        headers = dict(self._headers)
        if body is not None:
            headers |= {"Content-Length": str(size), "Content-Type": "application/octet-stream"}
        with _plain_errors():
            with _within(self._request_s + size / SLOWEST):
                response = self._manager.urlopen(
                    verb,
                    f"{self.name}/{name}",
                    body=body,
                    headers=headers,
                    redirect=False,
                    retries=ONCE_MORE,
                    preload_content=False,
                    decode_content=False,
                    timeout=urllib3.Timeout(connect=self._request_s, read=self._request_s),
                )
            with response:
                if response.status not in (200, 201, 204, 404):
                    raise ValueError(f"it answered {response.status}")
                yield response
                if response.status == 404:
                    for _ in self._body(response, ANSWER_BYTES):
                        pass

    def _body(self, response: Any, limit: int) -> Iterator[bytes]:
        """The body in chunks, and one byte beyond the limit if it is larger than that."""
        began, got = time.monotonic(), 0
        while got <= limit and (chunk := response.read1(min(CHUNK, limit + 1 - got))):
            got += len(chunk)
            yield chunk
            if time.monotonic() - began > self._request_s + got / SLOWEST:
                raise TimeoutError("it is too slow")
        if got <= limit:
            response.read(1)  # all is read: the connection is free


class _Cuttable:
    """A connection that is known to the thread that uses it, so that `_within` can cut it."""

    def connect(self) -> None:
        _note(self)
        super().connect()  # type: ignore[misc]  # urllib3's

    def request(self, *words: Any, **options: Any) -> None:  # Any: as urllib3 has it
        _note(self)
        super().request(*words, **options)  # type: ignore[misc]  # urllib3's


class _Deadline:
    """Ends one request in time. connection: the one that the request uses now."""

    def __init__(self) -> None:
        self.is_over = False
        self.connection: Any = None  # Any: urllib3's

    def cut(self) -> None:
        self.is_over = True
        with suppress(OSError, AttributeError):
            self.connection.sock.shutdown(2)


_mine = threading.local()


def _note(connection: object) -> None:
    _mine.deadline.connection = connection
    if _mine.deadline.is_over:
        raise TimeoutError("it is too slow")


@contextmanager
def _within(allowed_s: float) -> Iterator[None]:
    """Cut the connection when the time of a request is over: a server may trickle for ever."""
    deadline = _mine.deadline = _Deadline()
    timer = threading.Timer(allowed_s, deadline.cut)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
    if deadline.is_over:
        raise TimeoutError("it is too slow")


@contextmanager
def _plain_errors() -> Iterator[None]:
    """urllib3's errors in one short line: its own name objects of ours."""
    try:
        yield
    except urllib3.exceptions.HTTPError as error:
        cause: BaseException = error
        while isinstance(cause, urllib3.exceptions.HTTPError):
            inner = cause.__cause__ or cause.__context__
            if inner is None:
                break
            cause = inner
        text = getattr(cause, "strerror", None) or str(cause) or type(cause).__name__
        raise OSError(text[:200]) from None


def _length(response: Any) -> int | None:
    text = response.headers.get("Content-Length")
    return int(text) if text is not None else None


def _manager(scheme: str, host: str) -> urllib3.PoolManager:
    """Connections to a host, through the proxy that the environment names for it. UsageError."""
    proxies = getproxies()
    proxy = proxies.get(scheme) or proxies.get("all")
    if not proxy or proxy_bypass(host):
        return urllib3.PoolManager(maxsize=CONNECTIONS)
    parts = urlsplit(proxy if "://" in proxy else f"http://{proxy}")
    headers = None
    if parts.username:
        pair = f"{unquote(parts.username)}:{unquote(parts.password or '')}"
        headers = urllib3.make_headers(proxy_basic_auth=pair)
    try:
        return urllib3.ProxyManager(
            f"{parts.scheme}://{parts.netloc.rpartition('@')[2]}",
            proxy_headers=headers,
            maxsize=CONNECTIONS,
        )
    except (ValueError, urllib3.exceptions.HTTPError):
        raise UsageError(
            f"the environment names a proxy of the kind `{parts.scheme}`, which is not known here",
            hint="HTTPS_PROXY, HTTP_PROXY and ALL_PROXY take http:// and https:// addresses",
        ) from None


def _credentials(parts: SplitResult) -> dict[str, str]:
    user, password = parts.username, parts.password
    if user is not None:
        pair = f"{unquote(user)}:{unquote(password or '')}"
    elif token := os.environ.get("ASSETBUILD_REMOTE_TOKEN"):
        return {"Authorization": f"Bearer {token}"}
    else:
        try:
            known = netrc.netrc(os.environ.get("NETRC")).authenticators(parts.hostname or "")
        except (OSError, netrc.NetrcParseError):
            known = None
        if known is None:
            return {}
        pair = f"{known[0]}:{known[2]}"
    return {"Authorization": urllib3.make_headers(basic_auth=pair)["authorization"]}
