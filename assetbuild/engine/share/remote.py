"""A cache that machines share: what a step made, by its key, at `ac/<key>` and `cas/<sha256>`.

Whatever goes wrong is a miss: a build never fails, and never waits long, because of the cache.
What the cache has evicted, an entry or any of its objects, is a plain miss; only a server that
fails or sends wrong bytes counts as a fault. Objects are verified by their digest. Action entries
cannot be, so with a key they are signed, and others are refused. How names are read and written is
a matter of the place: HTTP or S3.
"""

from __future__ import annotations

import hmac
import json
import shutil
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from assetbuild.engine.actions import Made, made_from_json
from assetbuild.engine.digest import canonical_json
from assetbuild.engine.store import LostObjectError, Store
from assetbuild.errors import UsageError

if TYPE_CHECKING:
    from assetbuild.engine.share.remote_http import HttpPlace
    from assetbuild.engine.share.remote_s3 import S3Place

    Place = HttpPlace | S3Place
    """Where names are read and written, each within its time and size. Threads may share it."""

ENTRY_FORMAT = 1
ENTRY_BYTES = 16 << 20
"""No action entry is larger."""

FAULTS = (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError)
"""What a server that misbehaves can cause."""


@dataclass(frozen=True)
class Budget:
    """What the shared cache may cost one build.

    request_s: for one request, on top of the time that its size allows. lost_s: for requests
    that failed, all together; errors: so many requests; then the cache is left alone.
    object_bytes: of one action.
    """

    request_s: float = 10.0
    lost_s: float = 20.0
    object_bytes: int = 4 << 30
    errors: int = 3


def place_of(url: str, request_s: float) -> Place:
    """The place that an address names. UsageError; MachineError when a library is missing."""
    try:
        parts = urlsplit(url)
        _ = parts.port
        if parts.scheme in ("http", "https") and parts.hostname:
            from assetbuild.engine.share.remote_http import HttpPlace

            return HttpPlace(parts, request_s)
        if parts.scheme == "s3" and parts.hostname:
            from assetbuild.engine.share.remote_s3 import S3Place

            return S3Place(parts, request_s)
    except ValueError:
        pass
    raise UsageError(
        "`--remote` takes the address of an HTTP cache or of an S3 bucket",
        hint="as in `https://cache.example.org:8080` or `s3://bucket/prefix`",
    )


class Remote:
    """The shared cache of one build. Threads may share it.

    url: `http://host:port/prefix`, with `user:password@` if the server wants them, or
    `s3://bucket/prefix`. UsageError.
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
        self._budget = budget or Budget()
        self._place = place_of(url, self._budget.request_s)
        self._key = key.encode()
        self._write = write
        self._warn = warn
        self._lock = threading.Lock()
        self._warned = False
        self.forget()

    def forget(self) -> None:
        """Nothing is known of the cache any more: it may have evicted what was there."""
        self._asked: set[str] = set()
        self._there: set[str] = set()
        self._wrong: set[str] = set()
        self._errors = 0
        self._lost_s = 0.0

    @property
    def is_given_up(self) -> bool:
        """Did it fail so often or cost so much that this build leaves it alone?"""
        return self._errors >= self._budget.errors or self._lost_s >= self._budget.lost_s

    @property
    def address(self) -> str:
        """The address without credentials."""
        return self._place.name

    def get(self, key: str, store: Store, *, again: bool = False) -> Made | None:
        """What a step with this key made elsewhere, all its objects now in the store, or None.

        Each key is asked for once in a build, unless `again`. MachineError when the store cannot
        take it.
        """
        with self._lock:
            if self.is_given_up or (key in self._asked and not again):
                return None
            self._asked.add(key)
        with self._tolerant("read"):
            data = self._place.get(f"ac/{key}", ENTRY_BYTES)
            if data is None:
                return None
            result, objects = self._checked(key, json.loads(data))
            if sum(objects.values()) > self._budget.object_bytes:
                raise ValueError("a result is larger than its budget")
            if self._download(objects, store):
                self._there.add(key)
                return made_from_json(result)
        return None

    def put(self, key: str, made: Made, store: Store) -> bool:
        """Send what a step with this key made: objects first, then the action. Is it there?"""
        if key in self._there:
            return True
        if not self._write or self.is_given_up:
            return False
        with self._tolerant("write"):
            objects = store.sizes(made.outputs)
            self._upload(objects, store)
            entry = {
                "format": ENTRY_FORMAT,
                "key": key,
                "result": made.to_json(),
                "objects": objects,
            }
            if self._key:
                entry["signature"] = self._signature(entry)
            self._place.put(f"ac/{key}", canonical_json(entry))
            return True
        return False

    def send(self, objects: Mapping[str, int], store: Store) -> bool:
        """Upload those objects (digest -> size in bytes) that are not there yet. Are all there?"""
        if self._write and not self.is_given_up:
            with self._tolerant("write"):
                self._upload(objects, store)
                return True
        return False

    def fetch(self, objects: Mapping[str, int], store: Store) -> bool | None:
        """Download those objects that the store lacks. Are all there? None = the cache fails."""
        if not self.is_given_up:
            with self._tolerant("read"):
                return self._download(objects, store)
        return None

    # -- one exchange

    def _upload(self, objects: Mapping[str, int], store: Store) -> None:
        for digest in sorted(set(objects) - self._there):
            name = f"cas/{digest}"
            if digest in self._wrong or not self._place.has(name, objects[digest]):
                self._place.put(name, store.path(digest))
            self._there.add(digest)

    def _download(self, objects: Mapping[str, int], store: Store) -> bool:
        """Fetch what the store lacks; False when the cache has not all of it."""
        folder = store.scratch()
        try:
            for digest, size in sorted(objects.items()):
                if store.has(digest):
                    continue
                beside = folder / "object"
                if not self._place.save(f"cas/{digest}", size, beside):
                    return False
                if store.put_file(beside, move=True) != digest:
                    self._wrong |= set(objects)
                    raise ValueError("an object has not the bytes of its name")
            return True
        finally:
            shutil.rmtree(folder, ignore_errors=True)

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

    @contextmanager
    def _tolerant(self, what: str) -> Iterator[None]:
        """A fault of the server ends what is done here; all are counted, the first is reported."""
        began = time.monotonic()
        try:
            yield
        except LostObjectError:
            pass  # of our own store
        except FAULTS as error:
            with self._lock:
                self._errors += 1
                self._lost_s += time.monotonic() - began
                first, self._warned = not self._warned, True
            if first:
                reason = getattr(error, "strerror", None) or str(error) or type(error).__name__
                place = f"the shared cache {self._place.name}"
                self._warn(f"warning: cannot {what} {place}: {reason}; going on without")
