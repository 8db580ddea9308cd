"""Each variant of `Physics` has the words of its own engines, and all of them."""

from __future__ import annotations

from pathlib import Path

import pytest
from pxr import Usd
from tiny import check_inputs, tiny_quadruped

from assetbuild.targets.usd import Usd as UsdTarget

OWN = {"physx": ("physx",), "newton": ("newton", "mjc"), "mujoco": ("newton", "mjc")}
ENGINES = ("physx", "newton", "mjc")


def words(stage: Usd.Stage) -> set[str]:
    """Path and name of all that is authored on a stage."""
    return {
        f"{prim.GetPath()} {name}"
        for prim in stage.Traverse()
        for name in (*prim.GetPrimTypeInfo().GetAppliedAPISchemas(),
                     *prim.GetAuthoredPropertyNames())
    }  # fmt: skip


@pytest.mark.parametrize("variant", OWN)
def test_a_variant_has_the_words_of_its_engines_and_all_of_them(tmp_path: Path, variant: str):
    inputs = check_inputs(tmp_path, tiny_quadruped(), UsdTarget(robot="robot"), "usd")
    stage = Usd.Stage.Open(str(inputs / "usd/robot.usda"))
    whole = words(stage)
    stage.GetDefaultPrim().GetVariantSet("Physics").SetVariantSelection(variant)
    left_out = tuple(engine for engine in ENGINES if engine not in OWN[variant])
    assert words(stage) == {
        word for word in whole if not word.partition(" ")[2].lower().startswith(left_out)
    }
