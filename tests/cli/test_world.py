"""A build that is asked again: whatever changed in the world, it is noticed; nothing else is."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from PIL import Image
from urdfs import joint, link, robot

from assetbuild.engine.world import World
from assetbuild.rendering.plan import renderer

from .conftest import Place


def part(name: str) -> str:
    """A xacro to include: a link on the base."""
    return robot(link(name), joint(f"{name}_joint", "base", name, "continuous"))


TILE = """mtllib tile.mtl
v 0 0 0
v 1 0 0
v 0 1 0
vt 0 0
vt 1 0
vt 0 1
usemtl skin
f 1/1 2/2 3/3
"""
WHOLE = robot(link("base"), '<xacro:include filename="parts/*.xacro"/>').replace(
    'name="r"', 'name="r" xmlns:xacro="http://www.ros.org/wiki/xacro"'
)


def heavier(urdf: Path) -> None:
    """Six kilograms become seven."""
    text = urdf.read_text()
    assert 'mass value="6"' in text
    urdf.write_text(text.replace('mass value="6"', 'mass value="7"'))


def retarget(link: Path, target: str) -> None:
    """What `ln -sfn` does."""
    beside = link.with_name("beside")
    beside.symlink_to(target)
    beside.replace(link)


def settled(legs: Place) -> Callable[[], bool]:
    """Build, so that a second build is answered by the record alone; then: is the next as well?"""
    legs.edit("effort: 10", "effort: 30")
    log = legs.folder / "build/legs.run.json"
    legs.ran()

    def is_null() -> bool:
        log.unlink(missing_ok=True)
        again = legs.build()
        assert again.returncode == 0, again.stdout + again.stderr
        return not log.exists()

    assert is_null()
    return is_null


def mass_built(legs: Place) -> str:
    return "7" if 'mass value="7' in (legs.bundle / "urdf/legs.urdf").read_text() else "6"


@pytest.mark.slow
def test_a_source_behind_a_link_that_leads_elsewhere_now_is_built(warm_legs: Place):
    folder = warm_legs.folder
    for name in ("old", "new"):
        shutil.copytree(folder / "robot", folder / name / "robot")
    heavier(folder / "new/robot/four_legs.urdf")
    shutil.rmtree(folder / "robot")
    (folder / "above").symlink_to("old")
    warm_legs.edit("path: robot", "path: above/robot")
    is_null = settled(warm_legs)
    retarget(folder / "above", "new")
    assert not is_null()
    assert mass_built(warm_legs) == "7"


@pytest.fixture
def parts(legs: Place) -> Place:
    """A xacro that includes whatever lies in a folder: one part now."""
    (legs.folder / "robot/parts").mkdir()
    (legs.folder / "robot/r.xacro").write_text(WHOLE)
    (legs.folder / "robot/parts/a.xacro").write_text(part("a"))
    legs.edit("urdf: four_legs.urdf", "xacro: r.xacro")
    return legs


def joints_built(legs: Place) -> int:
    return (legs.bundle / "urdf/legs.urdf").read_text().count('type="continuous"')


@pytest.mark.slow
def test_a_part_that_appears_where_a_xacro_includes_a_folder_is_built(parts: Place):
    is_null = settled(parts)
    assert joints_built(parts) == 1
    (parts.folder / "robot/parts/b.xacro").write_text(part("b"))
    assert not is_null()
    assert joints_built(parts) == 2
    (parts.folder / "robot/parts/notes.md").write_text("no xacro reads this")
    (parts.folder / "robot/parts/.git").mkdir()
    assert is_null()


def test_a_licence_that_appears_beside_the_urdf_is_in_the_bundle(warm_legs: Place):
    is_null = settled(warm_legs)
    (warm_legs.folder / "robot/LICENSE").write_text("MIT")
    assert not is_null()
    assert (warm_legs.bundle / "LICENSES/LICENSE").read_text() == "MIT"
    (warm_legs.folder / "robot/notes.txt").write_text("nobody asks for it")
    assert is_null()


@pytest.mark.slow
@pytest.mark.parametrize("before", ["red.png", "nowhere.png"])
def test_the_link_of_a_texture_that_leads_elsewhere_now_is_followed(warm_legs: Place, before: str):
    robot = warm_legs.folder / "robot"
    for name, colour in (("red", "red"), ("blue", "blue"), ("../outside", "green")):
        Image.new("RGB", (4, 4), colour).save(robot / f"{name}.png")
    (robot / "tile.obj").write_text(TILE)
    (robot / "tile.mtl").write_text("newmtl skin\nmap_Kd skin.png\n")
    text = warm_legs.urdf.read_text()
    shape = '<visual><geometry><mesh filename="tile.obj"/></geometry></visual>'
    at = text.index("</inertial>") + len("</inertial>")
    warm_legs.urdf.write_text(text[:at] + shape + text[at:])
    (robot / "skin.png").symlink_to(before)
    is_null = settled(warm_legs)
    retarget(robot / "skin.png", "blue.png")
    assert not is_null()
    colours = [Image.open(p).getpixel((0, 0))[:3] for p in warm_legs.bundle.rglob("*.png")]
    assert (0, 0, 255) in colours


@pytest.mark.slow
def test_pictures_come_back_when_the_variable_goes_that_forbade_them(
    warm_legs: Place, monkeypatch: pytest.MonkeyPatch
):
    warm_legs.edit("targets: [urdf]", "targets: [mjcf]")
    monkeypatch.setenv("MUJOCO_GL", "disable")
    is_null = settled(warm_legs)
    assert not list(warm_legs.bundle.glob("report/images/*"))
    monkeypatch.delenv("MUJOCO_GL")
    assert not is_null()
    if renderer(World()) != "none":
        assert list(warm_legs.bundle.glob("report/images/*.png"))


def test_a_xacro_beside_its_recipe_is_built_and_its_bundle_is_no_part_of_it(
    legs: Place, tmp_path_factory: pytest.TempPathFactory
):
    """Whatever lies in the folder could be included: the recipe, too, but not what is built."""
    (legs.folder / "parts").mkdir()
    (legs.folder / "parts/arm.xacro").write_text(part("arm"))
    (legs.folder / "r.xacro").write_text(WHOLE)
    legs.recipe.write_text(
        "schema: assetbuild/v1\nrobot: legs\nsource: {path: ., xacro: r.xacro, license: MIT}\n"
        "actuators: []\ntargets: [urdf]\n"
    )
    place = Place(legs.folder, tmp_path_factory.mktemp("store"))
    assert place.ran()
    assert not place.ran()
    assert set(place.steps().values()) == {"cached"}
