"""Reports of other people's linters become findings; a linter that breaks is told."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from tiny import check_inputs, run_step, tiny_quadruped

from assetbuild.checks import mjcf_doctor, simcheck
from assetbuild.targets.mjcf import Mjcf

DOCTOR = [{"file": "scene.xml", "findings": [
    {"level": "WARN", "code": "timestep_large", "subject": "<option>", "message": "0.005 s"}]}]  # fmt: skip # noqa: E501
SIMCHECK = {"results": [
    {"id": "inertia.density", "status": "fail", "findings": [
        {"severity": "error", "message": "3e5 kg/m3", "target": "foot"}]},
    {"id": "joints.axis", "status": "pass", "findings": []}]}  # fmt: skip


@pytest.fixture
def inputs(tmp_path: Path) -> Path:
    return check_inputs(tmp_path, tiny_quadruped(), Mjcf(robot="robot"), "mjcf")


def a_linter_that_prints(folder: Path, name: str, text: str, monkeypatch) -> None:
    """A module of that name whose `python -m` prints a text."""
    (folder / f"{name}.py").write_text(f"print({text!r})")
    monkeypatch.setenv("PYTHONPATH", str(folder))


def test_the_doctor_s_json_follows_its_page(inputs, tmp_path: Path, monkeypatch) -> None:
    page = "mjcf-doctor v0.2.1\nscene.xml - 1 warning\n" + json.dumps(DOCTOR, indent=2)
    a_linter_that_prints(tmp_path, "mjcf_doctor", page, monkeypatch)
    (found,) = run_step(mjcf_doctor.MjcfDoctor(), inputs, tmp_path / "out")
    assert (found.rule, found.severity) == ("doctor.timestep_large", "warning")


def test_simcheck_s_results_keep_their_ids(inputs, tmp_path: Path, monkeypatch) -> None:
    a_linter_that_prints(tmp_path, "simcheck", json.dumps(SIMCHECK), monkeypatch)
    (found,) = run_step(simcheck.Simcheck(robot="robot"), inputs, tmp_path / "out")
    assert (found.rule, found.severity) == ("simcheck.inertia.density", "error")
    assert json.loads((tmp_path / "out/figures.json").read_text()) == {"checks": 2, "passed": 1}


def test_a_linter_that_says_nothing_is_told(inputs, tmp_path: Path, monkeypatch) -> None:
    for name in ("simcheck", "mjcf_doctor"):
        a_linter_that_prints(tmp_path, name, "oops", monkeypatch)
    (a,) = run_step(simcheck.Simcheck(robot="robot"), inputs, tmp_path / "a")
    (b,) = run_step(mjcf_doctor.MjcfDoctor(), inputs, tmp_path / "b")
    assert (a.rule, b.rule) == ("simcheck.broken", "doctor.broken")
