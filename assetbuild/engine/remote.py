"""A cache that machines share: GET, HEAD and PUT of /ac/<key> and /cas/<sha256> over HTTP.

The protocol of bazel-remote and of Bazel's own HTTP cache, so servers exist. Whatever goes wrong
is a miss: a build never fails, and never waits long, because of the cache. Objects are verified by
their digest. Action entries cannot be, so with a key they are signed, and others are refused.
Redirects are not followed: what is sent goes to the host that the user named, and to no other.
"""

from __future__ import annotations

import base64
import hmac
import http.client
import json
import shutil
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

from assetbuild.engine.digest import CHUNK, canonical_json
from assetbuild.engine.store import LostObjectError, Store
from assetbuild.errors import UsageError

ENTRY_FORMAT = 1
ENTRY_BYTES = 16 << 20
"""No action entry is larger."""
SLOWEST = 128 << 10
"""Bytes per second below which a transfer is given up."""
TOLERATED_ERRORS = 3

FAULTS = (
    OSError,
    http.client.HTTPException,
    ValueError,
    KeyError,
    TypeError,
    AttributeError,
    RecursionError,
    LostObjectError,
)
"""What a server that misbehaves can cause."""


@dataclass(frozen=True)
class Budget:
    """What the shared cache may cost one build.

    request_s: for one request, on top of the time that its size allows. lost_s: for requests
    that failed, all together; then the cache is left alone. object_bytes: of one action.
    """

    request_s: float = 10.0
    lost_s: float = 20.0
    object_bytes: int = 4 << 30


class Remote:
    """The shared cache of one build. Threads may share it.

    url: `http://host:port/prefix`, with `user:password@` if the server wants them. UsageError.
    key: secret that signs action entries; empty = unsigned. warn: called once, when first
    something goes wrong.
    """

    def __init__(
        self,
        url: str,
        *,
        key: str = "",
        write: bool = False,
        budget: Budget | None = None,
        warn: Callable[[str], None] = lambda _: None,
    ) -> None:
        parts = urlsplit(url)
        if parts.scheme not in ("http", "https") or not parts.hostname:
            raise UsageError(
                "`--remote` takes the address of an HTTP cache",
                hint="as in `https://cache.example.org:8080`",
            )
        self._parts = parts
        self.place = f"{parts.scheme}://{parts.hostname}"  # without credentials
        self._headers = _credentials(parts.username, parts.password)
        self._key = key.encode()
        self._write = write
        self._budget = budget or Budget()
        self._warn = warn
        self._lock = threading.Lock()
        self._asked: set[str] = set()
        self._errors = 0
        self._lost_s = 0.0
        self._warned = False

    @property
    def is_given_up(self) -> bool:
        """Did it fail so often or cost so much that this build leaves it alone?"""
        return self._errors >= TOLERATED_ERRORS or self._lost_s >= self._budget.lost_s

    def get(self, key: str, store: Store) -> dict[str, Any] | None:  # Any: JSON
        """What a step with this key made elsewhere, all its objects now in the store, or None.

        Each key is asked for once in a build. MachineError when the store cannot take it.
        """
        with self._lock:
            if key in self._asked:
                return None
            self._asked.add(key)
        with self._tolerant("read") as exchange:
            if exchange is None:
                return None
            data = exchange.get(f"ac/{key}", ENTRY_BYTES)
            if data is None:
                return None
            entry = json.loads(data)
            result, objects = self._checked(key, entry)
            if sum(objects.values()) > self._budget.object_bytes:
                raise ValueError("a result is larger than its budget")
            self._download(objects, store, exchange)
            return result
        return None

    def put(self, key: str, result: Mapping[str, object], store: Store) -> None:
        """Offer what a step with this key made: objects first, then the action."""
        if not self._write:
            return
        with self._tolerant("write") as exchange:
            if exchange is None:
                return
            objects = _objects_of(result, store)
            for digest in sorted(objects):
                if not exchange.has(f"cas/{digest}"):
                    exchange.put(f"cas/{digest}", store.path(digest))
            entry = {
                "format": ENTRY_FORMAT,
                "key": key,
                "result": dict(result),
                "objects": objects,
            }
            if self._key:
                entry["signature"] = self._signature(entry)
            exchange.put(f"ac/{key}", canonical_json(entry))

    def _checked(self, key: str, entry: Any) -> tuple[dict[str, Any], dict[str, int]]:  # Any: JSON
        """Result and objects of an entry that is for this key, and signed if it must be."""
        if entry["format"] != ENTRY_FORMAT or entry["key"] != key:
            raise ValueError("an entry is not for its key")
        if self._key:
            signed = {name: value for name, value in entry.items() if name != "signature"}
            if not hmac.compare_digest(str(entry.get("signature")), self._signature(signed)):
                raise ValueError("an entry is not signed with our key")
        result, objects = entry["result"], entry["objects"]
        if not isinstance(result, dict) or not isinstance(result["outputs"], dict):
            raise TypeError("an entry holds no result")
        sizes = {str(digest): int(size) for digest, size in objects.items()}
        if any(size < 0 for size in sizes.values()):
            raise ValueError("an entry lists a negative size")
        return result, sizes

    def _signature(self, entry: Mapping[str, object]) -> str:
        text = b"assetbuild action entry\n" + canonical_json(dict(entry))
        return hmac.new(self._key, text, "sha256").hexdigest()

    def _download(self, objects: Mapping[str, int], store: Store, exchange: Exchange) -> None:
        folder = store.scratch()
        try:
            for digest, size in sorted(objects.items()):
                if store.has(digest):
                    continue
                beside = folder / "object"
                exchange.save(f"cas/{digest}", size, beside)
                if store.put_file(beside, move=True) != digest:
                    raise ValueError("an object has not the bytes of its name")
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    @contextmanager
    def _tolerant(self, what: str) -> Iterator[Exchange | None]:
        """An exchange with the server; None when it is given up. Faults are counted, told once."""
        if self.is_given_up:
            yield None
            return
        exchange = Exchange(self._parts, self._headers, self._budget.request_s)
        began = time.monotonic()
        try:
            yield exchange
        except FAULTS as error:
            with self._lock:
                self._errors += 1
                self._lost_s += time.monotonic() - began
                first, self._warned = not self._warned, True
            if first:
                reason = getattr(error, "strerror", None) or str(error) or type(error).__name__
                place = f"the shared cache {self.place}"
                self._warn(f"warning: cannot {what} {place}: {reason}; going on without")
        finally:
            exchange.close()


class Exchange:
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
                response.read(ENTRY_BYTES)

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


def _objects_of(result: Mapping[str, Any], store: Store) -> dict[str, int]:  # Any: JSON
    """Digest -> size of every output, and of every member of those that are folders."""
    found: dict[str, int] = {}
    for name, digest in result["outputs"].items():
        found[digest] = store.path(digest).stat().st_size
        if name.endswith("/"):
            found |= dict(store.tree(digest).values())
    return found
