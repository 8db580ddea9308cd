"""A variant of `Physics` that lacks a word, has one too many or another value is a finding."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from pxr import Sdf, Usd
from tiny import check_inputs, run_step, tiny_quadruped

from assetbuild.facts.readers.usd import UsdReader
from assetbuild.simulators.usd_options import UsdOptions
from assetbuild.targets.usd import Usd as UsdTarget

HIP = "/robot/Joints/FR_hip_joint"
OWN = {"physx": ("physx",), "newton": ("newton:", "mjc:"), "mujoco": ("newton:", "mjc:")}


def built(folder: Path) -> Path:
    return check_inputs(folder, tiny_quadruped(), UsdTarget(robot="robot"), "usd")


def told(inputs: Path, folder: Path) -> dict[str, str]:
    options = {"usd": UsdOptions().model_dump(mode="json")}
    findings = run_step(UsdReader(robot="robot", options=options), inputs, folder / "out")
    return {finding.rule: finding.message for finding in findings}


@pytest.mark.parametrize("variant", OWN)
def test_a_variant_has_the_words_of_its_engines_and_all_of_them(tmp_path: Path, variant: str):
    inputs = built(tmp_path)
    assert not told(inputs, tmp_path)
    stage = Usd.Stage.Open(str(inputs / "usd/robot.usda"))
    names = {p.GetName() for prim in stage.Traverse() for p in prim.GetAuthoredProperties()}
    stage.GetDefaultPrim().GetVariantSet("Physics").SetVariantSelection(variant)
    left = {p.GetName() for prim in stage.Traverse() for p in prim.GetAuthoredProperties()}
    all_own = tuple(word for words in OWN.values() for word in words)
    assert {name for name in names - left if not name.startswith(all_own)} == set()
    assert {name for name in names if name.startswith(OWN[variant])} <= left
    assert left <= names
    assert names - left


def foreign(folder: Path) -> None:
    layer = Sdf.Layer.FindOrOpen(str(folder / "payloads/newton.usda"))
    joint = layer.GetPrimAtPath(HIP)
    Sdf.AttributeSpec(joint, "physxJoint:armature", Sdf.ValueTypeNames.Float).default = 1.0
    layer.Save()


def without_payload(folder: Path) -> None:
    file = folder / "robot.usda"
    text = file.read_text()
    start = text.index('"physx" (')
    file.write_text(text[:start] + text[start:].replace("@./payloads/physx.usda@", "", 1))


def heavier(folder: Path) -> None:
    file = folder / "robot.usda"
    text = file.read_text()
    start = text.index('"mujoco" (')
    said = ') {\nover "trunk" {\nfloat physics:mass = 99\n}\n'
    file.write_text(text[:start] + text[start:].replace(") {\n", said, 1))


def another(folder: Path) -> None:
    file = folder / "robot.usda"
    text = file.read_text()
    mine = 'variantSet "Physics" = {'
    file.write_text(
        text.replace(mine, f'{mine}\n"bullet" (payload = @./payloads/physx.usda@) {{}}')
    )


@pytest.mark.parametrize(
    ("spoil", "rule", "said"),
    [
        (foreign, "amiss_in_physics=newton", f"{HIP} physxJoint:armature"),
        (without_payload, "amiss_in_physics=physx", f"{HIP} physxJoint:armature"),
        (heavier, "amiss_in_physics=mujoco", "/robot/trunk physics:mass"),
        (another, "variants_of_physics", "bullet"),
    ],
)
def test_a_spoilt_variant_is_found(
    tmp_path: Path, spoil: Callable[[Path], None], rule: str, said: str
):
    inputs = built(tmp_path)
    spoil(inputs / "usd")
    assert said in told(inputs, tmp_path)[f"equal.usd.{rule}"]
