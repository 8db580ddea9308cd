"""The shared cache in a bucket of S3 or of a server that speaks its protocol, through obstore.

Credentials, region and endpoint come from the usual `AWS_...` variables, or from the machine's
own role; an address cannot hold any.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import timedelta
from pathlib import Path
from typing import Any
from urllib.parse import SplitResult

from assetbuild.errors import MachineError, UsageError

PART = 1 << 20
"""Bytes that are asked for at once, each within its own time."""
SLOWEST = 128 << 10
"""Bytes per second below which a transfer is given up."""


class S3Place:
    """A bucket and a prefix. Threads may share it. UsageError; MachineError without obstore."""

    def __init__(self, parts: SplitResult, request_s: float) -> None:
        if parts.username or parts.port:
            raise UsageError(
                "the address of a bucket holds no credentials and no port",
                hint="set AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY and AWS_ENDPOINT_URL",
            )
        try:
            from obstore.store import S3Store
        except ImportError:
            raise MachineError(
                "a cache in S3 needs the Python package `obstore`",
                hint="pip install 'assetbuild[remote]'",
            ) from None
        prefix = parts.path.strip("/")
        self.name = f"s3://{parts.hostname}/{prefix}".rstrip("/")
        self._store: Any = S3Store(  # Any: obstore is imported late
            parts.hostname,
            prefix=prefix or None,
            client_options={
                "connect_timeout": timedelta(seconds=request_s),
                "timeout": timedelta(seconds=request_s + PART / SLOWEST),
                "allow_http": os.environ.get("AWS_ENDPOINT_URL", "").startswith("http://"),
            },
            retry_config={"max_retries": 1, "retry_timeout": timedelta(seconds=request_s)},
        )

    def get(self, name: str, limit: int) -> bytes | None:
        """A small body; None when the bucket has none of this name."""
        size = self._size(name)
        if size is None:
            return None
        if size > limit:
            raise ValueError("a body is larger than it may be")
        return self._part(name, 0, size)

    def save(self, name: str, size: int, dest: Path) -> bool:
        """Write a body of exactly `size` bytes to a file; False when the bucket has not all."""
        stored_size = self._size(name)
        if stored_size is None or stored_size < size:
            return False
        if stored_size > size:
            raise ValueError("an object has not the size of its entry")
        with dest.open("wb") as file:
            for start in range(0, size, PART):
                part = self._part(name, start, min(PART, size - start))
                if part is None:
                    return False
                file.write(part)
        return True

    def has(self, name: str, size: int | None = None) -> bool:
        """Is it in the bucket already, of this size if one is given?"""
        stored_size = self._size(name)
        return stored_size is not None and size in (None, stored_size)

    def put(self, name: str, body: bytes | Path) -> None:
        """Upload bytes or a file; a large one in parts, which appear together."""
        with _plain_errors():
            self._store.put(name, body, chunk_size=5 * PART, max_concurrency=2)

    def _size(self, name: str) -> int | None:
        with _plain_errors():
            try:
                return int(self._store.head(name)["size"])
            except FileNotFoundError:
                return None

    def _part(self, name: str, start: int, length: int) -> bytes | None:
        if not length:
            return b""
        with _plain_errors():
            try:
                return bytes(self._store.get_range(name, start=start, length=length))
            except FileNotFoundError:
                return None


@contextmanager
def _plain_errors() -> Iterator[None]:
    """obstore's errors in one short line: its own run over many."""
    from obstore.exceptions import BaseError

    try:
        yield
    except FileNotFoundError:
        raise
    except BaseError as error:
        lines = [line.strip() for line in str(error).splitlines() if line.strip()]
        raise OSError(lines[0][:200] if lines else type(error).__name__) from None
