"""A driver that crashes or hangs costs the pictures, never the build."""

from __future__ import annotations

import faulthandler
import os
import signal
import time
from pathlib import Path

import pytest

from assetbuild.errors import StepError
from assetbuild.simulators.offscreen import run_apart


def crash() -> None:
    faulthandler.disable()  # pytest's would print a page about this crash, which is meant
    os.kill(os.getpid(), signal.SIGSEGV)


def refuse() -> None:
    raise StepError("no context")


def test_what_is_done_is_done(tmp_path: Path) -> None:
    assert run_apart(lambda: (tmp_path / "made").touch(), 20.0) == ""
    assert (tmp_path / "made").exists()


@pytest.mark.parametrize(
    ("work", "told"),
    [
        (crash, "the driver crashed (SIGSEGV)"),
        (lambda: time.sleep(60), "not done after 0.3 s"),
        (refuse, "no context"),
        (lambda: 1 / 0, "ZeroDivisionError"),
    ],
)
def test_what_went_wrong_is_told(work, told: str) -> None:
    assert told in run_apart(work, 0.3 if "0.3" in told else 20.0)
