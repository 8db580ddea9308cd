"""Patterns that would take forever."""

from __future__ import annotations

import re
import signal
import time
from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
from pathlib import Path

import pytest

from assetbuild.errors import RecipeError
from assetbuild.plan.patience import patience

ENDLESS = "(a*)*b"


@pytest.fixture(autouse=True)
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    # The package names the function as its module is named.
    monkeypatch.setattr(import_module("assetbuild.plan.patience"), "PATIENCE_S", 0.2)


def burn(seconds: float) -> bool:
    end = time.process_time() + seconds
    while time.process_time() < end:
        pass
    return True


def test_a_pattern_that_takes_forever_is_named_with_its_line(tmp_path: Path):
    recipe = tmp_path / "dog.yaml"
    recipe.write_text(f"robot: dog\nactuators: [{{joints: {ENDLESS}}}]\n")
    with pytest.raises(RecipeError) as info, patience(recipe):
        re.fullmatch(ENDLESS, 40 * "a")
    assert info.value.where is not None
    assert str(info.value.where) == f"{recipe}:2"
    assert f"`{ENDLESS}` takes more than" in info.value.message


def test_a_plan_that_takes_long_by_itself_is_let_be(tmp_path: Path):
    with patience(tmp_path):
        assert burn(0.5)
    assert burn(0.3), "nothing is left of it"
    assert signal.getsignal(signal.SIGVTALRM) == signal.SIG_DFL


def test_a_thread_of_a_program_that_plans_may_do_so(tmp_path: Path):
    def plan() -> bool:
        with patience(tmp_path):
            return burn(0.0)

    with ThreadPoolExecutor(1) as threads:
        assert threads.submit(plan).result()
