"""A bundle that lost a file is found out by its manifest."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from assetbuild.engine.digest import digest_bytes
from assetbuild.pipeline.validating import (
    GRAVITY,
    TIMESTEP_S,
    Wish,
    _fell,
    lost_files,
    tried,
    validate,
)
from assetbuild.simulators.experiments import Motion, Outcome, Setting


def test_a_lost_file_is_named_and_an_edited_one_of_a_plug_in_that_is_not_installed(tmp_path: Path):
    files = ("mjcf/lost.xml", "mjcf/crate.xml", "sdf/crate.sdf", "sdf/same")
    rows = [{"path": name, "sha256": digest_bytes(b"")} for name in files]
    (tmp_path / "manifest.json").write_text(json.dumps({"files": rows}))
    for name in files[1:]:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("" if name == "sdf/same" else "edited")
    lost = ("equal.lost", "mjcf/lost.xml")
    assert [(found.rule, found.where) for found in lost_files(tmp_path)] == [lost]
    (edited,) = (found for found in lost_files(tmp_path, {"sdf"}) if found.where != lost[1])
    assert (edited.where, "was edited" in edited.message) == ("sdf/crate.sdf", True)
    values = {
        "attribute": "sha256",
        "expected": digest_bytes(b""),
        "found": digest_bytes(b"edited"),
    }
    assert (edited.subject, edited.data) == ("file sdf/crate.sdf", values)


def test_a_bundle_without_its_robot_lost_it(tmp_path: Path):
    rows = [{"path": "report/robot.json", "sha256": digest_bytes(b"")}]
    (tmp_path / "manifest.json").write_text(json.dumps({"files": rows}))
    (tmp_path / "mjcf").mkdir()
    (tmp_path / "mjcf/crate.xml").write_text("<mujoco/>")
    wish = Wish(False, lambda robot, out: None, lambda event: None)
    found = [finding for one in validate(tmp_path, wish) for finding in one.findings]
    assert ("equal.lost", "file report/robot.json") in {(f.rule, f.subject) for f in found}


SECONDS = 0.5
IDEAL_M = 9.81 / 2 * SECONDS**2


def fallen(drop_m: float, sideways_m: float = 0.0) -> Outcome:
    """Two samples of a centre of mass."""
    com = np.array([[0.0, 0.0, 1.0], [sideways_m, 0.0, 1.0 - drop_m]])
    turn = np.tile((1.0, 0.0, 0.0, 0.0), (2, 1))
    return Outcome(None, Motion(np.array([0.0, SECONDS]), {}, com, turn, com))


@pytest.mark.parametrize("iterations", [1, 4, 255])
def test_what_falls_as_a_solver_of_any_iterations_must_is_no_finding(iterations: int) -> None:
    drop = 9.81 / 2 * SECONDS * (SECONDS + TIMESTEP_S / iterations)
    assert list(_fell(fallen(drop), Setting(TIMESTEP_S, GRAVITY))) == []


@pytest.mark.parametrize(
    ("drop", "sideways"), [(0.0, 0.0), (0.9 * IDEAL_M, 0.0), (1.1 * IDEAL_M, 0.0), (IDEAL_M, 0.2)]
)
def test_what_is_welded_damped_or_pushed_is_told(drop: float, sideways: float) -> None:
    (finding,) = _fell(fallen(drop, sideways), Setting(TIMESTEP_S, GRAVITY))
    assert finding.rule == "physx.free_fall"


WHOLE = {"articulations": 1, "fixed_base": False, "loose": []}
AIR = Setting(TIMESTEP_S, GRAVITY)
FALL = fallen(9.81 / 2 * SECONDS * (SECONDS + TIMESTEP_S))


@pytest.mark.parametrize(
    ("held", "failure", "found"),
    [
        (WHOLE, "", []),
        (None, "PhysX crashed", [("physx.load", "error")]),
        (WHOLE | {"articulations": 0}, "", [("physx.load", "error")]),
        (WHOLE, "it lost its numbers", [("physx.finite", "error")]),
        (WHOLE | {"articulations": 2}, "", [("physx.articulation", "warning")]),
        (WHOLE | {"loose": ["lid"]}, "", [("physx.loose_body", "warning")]),
    ],
)
def test_what_physx_does_not_load_hold_or_keep_is_told(
    held: dict[str, object] | None, failure: str, found: list[tuple[str, str]]
) -> None:
    """The failure is that of loading where nothing was loaded, else that of the floor."""
    load = Outcome(held, None, failure * (held is None))
    done = {"load": load, "fall": FALL, "floor": replace(FALL, failure=failure)}
    assert [(finding.rule, finding.severity) for finding in tried(done, AIR)] == found
