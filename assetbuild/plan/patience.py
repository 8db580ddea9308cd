"""A pattern of a recipe that takes forever is an error."""

from __future__ import annotations

import re
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

from assetbuild.errors import RecipeError, Where

PATIENCE_S = 10.0
"""Processor time; a sound pattern takes a millionth of it for a name."""


@contextmanager
def patience(recipe: Path) -> Iterator[None]:
    """RecipeError with its line when a pattern is still being matched after so long.

    In the main thread alone: others hear no signals.
    """

    def give_up(_: int, frame: FrameType | None) -> None:
        if frame is None or frame.f_globals.get("__name__") != re.__name__:
            return  # the plan of a large robot
        pattern = str(frame.f_locals.get("pattern"))
        lines = recipe.read_text(encoding="utf-8").splitlines()
        number = next((n for n, line in enumerate(lines, 1) if pattern in line), 0)
        raise RecipeError(
            f"the pattern `{pattern}` takes more than {PATIENCE_S:g} s for a name",
            where=Where(str(recipe), number),
            hint="do not repeat a group that repeats what is in it, such as `(a*)*`",
        )

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGVTALRM, give_up)
    signal.setitimer(signal.ITIMER_VIRTUAL, PATIENCE_S, PATIENCE_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
        signal.signal(signal.SIGVTALRM, before)
