"""A shape that is lost on the way is counted as missing, and a number differs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from robot_files import about, checked, configured, figures, run_step
from urdfs import read

from assetbuild.checks.counts import Counts
from assetbuild.findings import Finding
from assetbuild.robot.codec import encode
from assetbuild.robot.model import Body, Inertial, Joint, Limits, Mimic, Tree
from assetbuild.robot.shapes import Box, Material, Shape, Shapes, Sphere

BALL = '<geometry><sphere radius="1"/></geometry>'
SOURCE = f"""<robot name="r">
  <link name="trunk"><visual>{BALL}</visual><visual>{BALL}</visual>
    <collision>{BALL}</collision></link>
  <link name="foot"><visual>{BALL}</visual></link>
  <link name="frame"/>
</robot>"""
WHOLE = Shapes(
    (
        Shape("a", "trunk", "visual", Box((1.0, 1.0, 1.0)), material="skin"),
        Shape("b", "trunk", "visual", Box((1.0, 1.0, 1.0))),
        Shape("c", "trunk", "collision", Box((1.0, 1.0, 1.0))),
        Shape("d", "foot", "visual", Sphere(1.0)),
        Shape("e", "foot", "collision", Sphere(1.0)),
    ),
    (Material("skin", texture="skin-1.png"), Material("unused", texture="other-1.png")),
)


AUTO = (".*", "auto", "auto")


def check(
    tmp_path: Path, shapes: Shapes, source: str = SOURCE, **fields: object
) -> tuple[list[Finding], dict[str, object]]:
    inputs = tmp_path / "in"
    inputs.mkdir(parents=True)
    (inputs / "source.urdf").write_text(source)
    (inputs / "shapes.json").write_bytes(encode(shapes))
    links = Tree("r", "fixed", (Body("trunk"), Body("foot"), Body("frame")), ())
    (inputs / "links.json").write_bytes(encode(links))
    step = Counts.model_validate({"robot": "r", "rules": (AUTO,)} | fields)
    return checked(step, inputs, tmp_path / "out")


def without(name: str) -> Shapes:
    return replace(WHOLE, shapes=tuple(s for s in WHOLE.shapes if s.name != name))


@pytest.mark.parametrize(
    ("lost", "rules", "told"),
    [
        ("a", (AUTO,), [("count.visual", "link trunk")]),
        ("d", (AUTO,), [("count.visual", "link foot")]),
        ("c", (AUTO,), [("count.collision", "link trunk")]),
        ("e", (AUTO,), [("count.collision", "link foot")]),  # taken from what is seen
        ("e", (("foot", "none", "auto"), AUTO), []),
        ("e", ((".*", "hull", "collision"),), []),  # from collision shapes alone
    ],
)
def test_a_lost_shape_is_an_error_unless_the_recipe_does_not_want_it(
    tmp_path: Path, lost: str, rules: tuple, told: list[tuple[str, str]]
):
    findings, _ = check(tmp_path, without(lost), rules=rules)
    assert [(f.rule, f.subject) for f in findings] == told
    assert all(f.severity == "error" for f in findings)


def test_a_whole_robot_passes_with_its_counts(tmp_path: Path):
    """Nor is a shape missed whose size was taken away, as `read_urdf` leaves a sphere of 0 m."""
    nothing = "<visual><geometry/></visual><collision><geometry/></collision>"
    sized = SOURCE.replace('name="foot">', f'name="foot">{nothing}')
    counts = {"facts": 6, "visual_source": 3, "visual_built": 3}
    counts |= {"collision_source": 1, "collision_built": 2}
    for number, source in enumerate((SOURCE, sized)):
        findings, figures = check(tmp_path / str(number), WHOLE, source=source)
        assert (findings, figures) == ([], counts)


def test_a_visual_that_is_stated_as_missing_is_not_missed(tmp_path: Path):
    mesh = '<visual><geometry><mesh filename="package://r/meshes/a.dae"/></geometry></visual>'
    source = SOURCE.replace('name="foot">', f'name="foot">{mesh}')
    assert check(tmp_path, WHOLE, source=source, absent=("meshes/a.dae",))[0] == []
    for number, absent in enumerate(((), ("meshes/b.dae",))):
        findings, _ = check(tmp_path / str(number), WHOLE, source=source, absent=absent)
        assert [f.rule for f in findings] == ["count.visual"]


# --- links and joints of the source -------------------------------------------------------------

ROBOTS = Path(__file__).parents[1] / "robots"
HELD = """<robot name="r"><link name="a"/><link name="b"/><link name="c"/><link name="d"/>
<joint name="still" type="fixed"><parent link="a"/><child link="b"/></joint>
<joint name="half" type="continuous"><parent link="a"/><child link="c"/>
<mimic joint="still" multiplier="2" offset="0.5"/></joint>
<joint name="twice" type="prismatic"><parent link="a"/><child link="d"/>
<limit lower="-3" upper="3"/><mimic joint="half" multiplier="4" offset="-1"/></joint></robot>"""


def held_against_its_source(
    urdf: str, folder: Path, change: Callable[[Tree], Tree] = lambda tree: tree
) -> list[Finding]:
    """What the check says of links that the build read, changed on the way."""
    inputs = folder / "in"
    links = read(urdf, inputs, packages={"robot_pkg": "."}, file="urdf/r.urdf").tree
    (inputs / "links.json").write_bytes(encode(change(links)))
    (inputs / "shapes.json").write_bytes(encode(Shapes()))
    rules = ((".*", "none", "auto"),)
    found = run_step(Counts(robot="r", rules=rules), inputs, folder / "out")
    return [f for f in found if f.rule != "count.visual"]


def with_joint(name: str, change: Callable[[Joint], Joint]) -> Callable[[Tree], Tree]:
    return lambda tree: replace(
        tree, joints=tuple(change(j) if j.name == name else j for j in tree.joints)
    )


@pytest.mark.parametrize(
    "file", ["every_kind", "four_legs", "inertia_rotated_origin", "placeholder_root", ""]
)
def test_every_number_of_the_source_is_in_the_robot(file: str, tmp_path: Path):
    text = (ROBOTS / f"{file}.urdf").read_text() if file else HELD
    assert held_against_its_source(text, tmp_path) == []
    assert figures(tmp_path / "out")["facts"] >= 4


@pytest.mark.parametrize(
    ("quantity", "subject", "change"),
    [
        ("mass", "body arm", lambda tree: replace(tree, bodies=tuple(
            replace(b, inertial=Inertial(2.0, (0, 0, 0), (1, 1, 1, 0, 0, 0)))
            if b.name == "arm" else b for b in tree.bodies))),
        ("mimic_multiplier", "joint spin",
         with_joint("spin", lambda j: replace(j, mimic=Mimic("slide", 2.0, 0.5)))),
        ("extra", "joint spin", lambda tree: replace(tree, bodies=tree.bodies[:-1],
            joints=tuple(j for j in tree.joints if j.name != "spin"))),
        ("upper", "joint twice", with_joint("twice", lambda j: replace(j, limits=Limits(0, 0)))),
    ],
)  # fmt: skip
def test_a_number_lost_after_the_source_is_an_error(
    quantity: str, subject: str, change: Callable[[Tree], Tree], tmp_path: Path
):
    """A joint that mimics a fixed one is where that puts it."""
    text = HELD if subject == "joint twice" else (ROBOTS / "every_kind.urdf").read_text()
    found = held_against_its_source(text, tmp_path, change)
    assert (f"equal.source_urdf.{quantity}", subject) in about(found)


@pytest.mark.parametrize("key", ["mjcf", "edits"])
def test_a_description_that_we_wrote_is_not_counted(key: str):
    edits = [{"set_mass": {"link": "a", "mass": 1}}] if key == "edits" else []
    source = {"path": ".", "mjcf" if key == "mjcf" else "urdf": "r.xml"}
    assert configured(Counts, source=source, edits=edits) is None
