"""A build that is asked again: what appears in the world is noticed; what nobody asked for is not.

`tests/contracts/test_world.py` proves that builds record all that they look at, and
`tests/engine/test_world.py` that every change of what is recorded is noticed.
"""

from __future__ import annotations

from pathlib import Path

from urdfs import joint, link, robot

from .conftest import Place

WHOLE = robot(link("base"), '<xacro:include filename="parts/*.xacro"/>').replace(
    'name="r"', 'name="r" xmlns:xacro="http://www.ros.org/wiki/xacro"'
)


def part(name: str) -> str:
    """A xacro to include: a link on the base."""
    return robot(link(name), joint(f"{name}_joint", "base", name, "continuous"))


def is_null(legs: Place) -> bool:
    """Build; did the record alone answer?"""
    log = legs.folder / "build/legs.run.json"
    log.unlink(missing_ok=True)
    done = legs.build()
    assert done.returncode == 0, done.stdout + done.stderr
    return not log.exists()


def test_a_licence_that_appears_beside_the_urdf_is_in_the_bundle(warm_legs: Place):
    warm_legs.ran()
    assert is_null(warm_legs)
    (warm_legs.robot / "LICENSE").write_text("MIT")
    assert not is_null(warm_legs)
    assert (warm_legs.bundle / "LICENSES/LICENSE").read_text() == "MIT"
    (warm_legs.robot / "notes.txt").write_text("nobody asks for it")
    assert is_null(warm_legs)


def test_a_xacro_beside_its_recipe_is_built_and_its_bundle_is_no_part_of_it(legs: Place):
    """Whatever lies in the folder could be included: the recipe, too, but not what is built."""
    (legs.folder / "parts").mkdir()
    (legs.folder / "parts/a.xacro").write_text(part("a"))
    (legs.folder / "r.xacro").write_text(WHOLE)
    legs.edit("path: robot, urdf: four_legs.urdf", "path: ., xacro: r.xacro")
    place = Place(legs.folder, legs.folder.with_name("store"))
    assert place.ran()
    assert not place.ran()
    assert set(place.steps().values()) == {"cached"}
    (legs.folder / "parts/b.xacro").write_text(part("b"))
    assert not is_null(place)
    assert (legs.bundle / "urdf/legs.urdf").read_text().count('type="continuous"') == 2
    (legs.folder / "notes.md").write_text("no xacro reads this")
    (legs.folder / "parts/.git").mkdir()
    assert is_null(place)


def test_a_file_of_the_bundle_that_stays_the_same_is_taken_over(warm_legs: Place, tmp_path: Path):
    """Not copied again; unless the user has put something else there."""

    def changed(old: str, new: str) -> tuple[str, int, bool]:
        """Change a gain and build: the URDF's text and inode, and whether it is a link."""
        warm_legs.edit(f"kd: {old},", f"kd: {new},")
        assert warm_legs.ran()
        return urdf.read_text(), urdf.lstat().st_ino, urdf.is_symlink()

    urdf, other = warm_legs.bundle / "urdf/legs.urdf", tmp_path / "other.urdf"
    warm_legs.ran()
    text, inode = urdf.read_text(), urdf.stat().st_ino
    assert changed("1", "2") == (text, inode, False)
    assert urdf.stat().st_nlink == 1, "of one bundle alone"
    urdf.rename(other)
    urdf.symlink_to(other)
    assert changed("2", "3")[::2] == (text, False)
    with urdf.open("a") as file:
        file.write("<!-- mine -->")
    assert changed("3", "4")[0] == text
    aside = warm_legs.bundle.with_name("legs.edited") / "urdf/legs.urdf"
    assert "mine" in aside.with_name("legs.urdf.1").read_text(), "after the link"
