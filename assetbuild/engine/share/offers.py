"""Work that goes on beside a build, and ends soon after it."""

from __future__ import annotations

import random
import threading
from collections.abc import Callable


class Offers:
    """Does one thing after the other in a thread of its own, in any order.

    Any order, so that builds that end before all is done get on with different ones.
    """

    def __init__(self) -> None:
        self._left: list[Callable[[], None]] = []
        self._changed = threading.Condition()
        self._thread: threading.Thread | None = None
        self._is_closed = False

    def add(self, offer: Callable[[], None]) -> None:
        """Do it when its turn comes. It must not raise."""
        with self._changed:
            self._left.append(offer)
            self._changed.notify()
            if self._thread is None:
                self._thread = threading.Thread(target=self._serve, daemon=True)
                self._thread.start()

    def close(self, wait_s: float) -> int:
        """Wait until all is done, or so many seconds; how many are left, which are given up."""
        if self._thread is None:
            return 0
        with self._changed:
            self._is_closed = True
            self._changed.notify()
        self._thread.join(wait_s)
        with self._changed:
            left = len(self._left) + self._thread.is_alive()
            self._left.clear()
        return left

    def _serve(self) -> None:
        while True:
            with self._changed:
                while not self._left and not self._is_closed:
                    self._changed.wait()
                if not self._left:
                    return
                offer = self._left.pop(random.randrange(len(self._left)))  # noqa: S311 - no secret
            offer()
