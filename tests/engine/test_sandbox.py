"""`--sandbox=strict`: a step that reads what it does not declare fails, and the file is named."""

from __future__ import annotations

import functools
import threading
from pathlib import Path

import pytest
from builds_for_tests import one
from steps_for_tests import (
    Hang,
    MixInChild,
    PreloadedWithThreads,
    Reads,
    ReadsAndDies,
    ReadsWhatIsReplaced,
)

from assetbuild.engine import sandbox
from assetbuild.engine.processes import Processes
from assetbuild.engine.session import Session
from assetbuild.engine.store import Store
from assetbuild.errors import StepError

pytestmark = pytest.mark.skipif(bool(sandbox.why_not()), reason=sandbox.why_not() or "it works")


@pytest.fixture
def confined(tmp_path: Path):
    with Session(Store(tmp_path / "confined"), build="test") as session:
        yield session


@pytest.fixture
def strict(confined: Session):
    """Runs one step that may read its inputs only."""
    with Processes(confined, sandbox=True) as runner:
        yield functools.partial(one, confined, runner=runner)


@pytest.fixture
def secret(tmp_path: Path) -> Path:
    path = tmp_path / "elsewhere" / "mesh.stl"
    path.parent.mkdir()
    path.write_text("undeclared")
    return path


@pytest.mark.parametrize("how", ["open", "native_code", "program", "link", "relative_path"])
def test_an_undeclared_read_fails_the_step_and_names_the_file(strict, secret, how):
    error = strict(Reads(path=str(secret), how=how)).error
    assert isinstance(error, StepError)
    assert f"step `it` reads `{secret}`, which is not among its inputs" in str(error)


@pytest.mark.parametrize("how", ["open", "native_code"])
def test_without_it_the_same_step_reads_the_file(session, secret, how):
    result = one(session, Reads(path=str(secret), how=how))
    assert session.read(result["out"]) == b"undeclared"


def test_an_undeclared_folder_is_not_listed(strict, secret):
    error = strict(Reads(path=str(secret.parent), how="listing")).error
    assert f"`{secret.parent}`" in str(error)


def test_a_crash_after_a_refused_read_is_told_as_the_read(strict, secret):
    error = strict(ReadsAndDies(path=str(secret), how="native_code")).error
    assert f"reads `{secret}`" in str(error)


def test_what_is_not_there_may_be_looked_for(strict, tmp_path):
    assert strict(Reads(path=str(tmp_path / "absent"), how="open")).error is None


@pytest.mark.parametrize("how", ["writing", "input"])
def test_inputs_and_the_own_folder_are_free(confined, strict, source, how):
    result = strict(Reads(path="", how=how), source)
    assert result.error is None
    assert confined.read(result["out"]) == (b"mine" if how == "writing" else b"1['in']")


def test_an_object_that_another_step_makes_meanwhile_stays_readable(confined, strict, source):
    done = threading.Event()

    def make_again() -> None:
        while not done.wait(0.2):
            confined.store.put_bytes(source.read_bytes())

    other = threading.Thread(target=make_again)
    other.start()
    try:
        result = strict(ReadsWhatIsReplaced(), source)
    finally:
        done.set()
        other.join()
    assert result.error is None
    assert confined.read(result["out"]) == source.read_bytes()


def test_ordinary_steps_give_the_same_bytes(strict, session, source, tmp_path):
    free = one(session, MixInChild(), source)
    confined = strict(MixInChild(salt=0), source)
    assert confined.error is None
    assert confined.outputs == free.outputs


def test_an_interpreter_of_its_own_is_confined_too(strict):
    assert strict(PreloadedWithThreads()).error is None


def test_limits_still_hold(strict):
    assert "ran over its time limit of 1 s" in str(strict(Hang()).error)


def test_a_failed_step_is_not_remembered(strict, secret):
    step = Reads(path=str(secret), how="open")
    assert strict(step).error is not None
    assert strict(step).error is not None
