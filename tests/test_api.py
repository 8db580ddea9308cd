"""Five lines of Python build a robot, or load a bundle, and say what it is."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

import assetbuild
from assetbuild.errors import AssetBuildError, UsageError

LEGS = Path(__file__).parent / "robots/four_legs.urdf"
RECIPE = """\
schema: assetbuild/v1
robot: legs
source: {path: ., urdf: four_legs.urdf, license: MIT}
base: floating
collision: {default: {method: keep}}
actuators: [{joints: ".*", model: pd, kp: 20, kd: 1, effort: 10, velocity: 20}]
targets: [urdf, mjcf]
"""


@pytest.fixture(scope="module")
def bundle(tmp_path_factory: pytest.TempPathFactory) -> assetbuild.Bundle:
    """Four legs, built once."""
    folder = tmp_path_factory.mktemp("api")
    shutil.copy(LEGS, folder)
    (folder / "legs.yaml").write_text(RECIPE)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MUJOCO_GL", "disable")
        return assetbuild.build(folder / "legs.yaml", folder / "out")


def test_a_built_bundle_loads_in_mujoco_and_has_the_mass_that_its_facts_state(bundle):
    import mujoco

    model = mujoco.MjModel.from_xml_path(str(bundle.mjcf_path))
    assert sum(model.body_mass) == pytest.approx(bundle.facts.mass_kg, rel=1e-9)
    assert model.nu == len(bundle.facts.actuators) == len(bundle.facts.joints)


def test_a_bundle_is_loaded_again_from_its_folder(bundle):
    again = assetbuild.load_bundle(bundle.path)
    assert again.facts == bundle.facts
    assert again.facts.robot == "legs"
    assert again.urdf_path.is_file()
    assert "report/report.json" in again.files


def test_a_file_that_the_bundle_lacks_is_named_with_the_target_that_writes_it(bundle):
    with pytest.raises(UsageError, match=r"no file `usd/legs\.usda`") as told:
        _ = bundle.usd_path
    assert "`usd`" in told.value.hint


def test_a_folder_that_is_no_bundle_and_a_recipe_that_is_not_there_are_refused(tmp_path: Path):
    with pytest.raises(UsageError, match=r"no manifest\.json"):
        assetbuild.load_bundle(tmp_path)
    with pytest.raises(AssetBuildError):
        assetbuild.build(tmp_path / "none.yaml")
