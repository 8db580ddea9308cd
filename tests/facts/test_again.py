"""Each comparer names a planted change, and takes a file that is only written differently."""

from __future__ import annotations

from pathlib import Path

import pytest
from PIL import Image
from robot_files import edit

from assetbuild.facts.again.files import rows_of
from assetbuild.facts.again.tree import NotParsedError, Row, row_findings

URDF = """<robot name="arm">
  <link name="base"/>
  <joint name="turn" type="revolute"><origin xyz="0 0 1.5"/><limit effort="30"/></joint>
</robot>
"""
MJCF = """<mujoco>
  <default><default class="arm"><position kp="80" kv="4"/></default></default>
  <worldbody>
    <body name="a"><joint name="turn"/><geom name="box" size="1" mass="1"/>
      <body name="b" pos="0 0 1"><joint name="lift"/><geom size="1"/></body></body>
  </worldbody>
  <actuator>
    <position class="arm" name="turn" joint="turn"/><position class="arm" name="lift" joint="lift"/>
  </actuator>
</mujoco>
"""
MODULE = '''"""A robot."""
def cfg():
    """Its drives."""
    return Entity(joints={"turn": 0.5}, actuators=[Drive(stiffness=80.0, delay=2)])
'''
RANGES = "robot: arm\nlinks:\n  base:\n    mass: {nominal: 3.5, range: [3, 4]}\n"
MESH = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\n"
STAGE = """#usda 1.0
(
    defaultPrim = "arm"
)

def Xform "arm" (
    prepend variantSets = "Physics"
    variants = {
        string Physics = "on"
    }
)
{
    def PhysicsRevoluteJoint "turn"
    {
        float physics:upperLimit = 90
        quatf physics:localRot0 = (0.6, 0.8, 0, 0)
    }
    variantSet "Physics" = {
        "off" {
            float mass = 1
        }
        "on" {
            float mass = 2
        }
    }
}
"""


def compared(folder: Path, name: str, text: str, *edits: tuple[str, str]) -> list[Row]:
    """The rows of a file in which some words were replaced."""
    again, there = folder / "again" / name, folder / "there" / name
    for path in (again, there):
        path.parent.mkdir(parents=True)
        path.write_text(text)
    edit(there, *edits)
    return rows_of(again, there, (again,))


@pytest.mark.parametrize(
    ("name", "text", "edit", "row"),
    [
        ("a.urdf", URDF, ('effort="30"', 'effort="33"'),
         Row("joint", "turn", "limit effort", 30.0, 33.0, 3)),
        ("a.urdf", URDF, ('<link name="base"/>', ""),
         Row("link", "base", "missing", 'name=base', None, 1)),
        ("a.xml", MJCF, ("<default><default", '<size memory="20K"/><default><default'),
         Row("size", "", "extra", None, "memory=20K", 2)),
        ("a.xml", MJCF, ('name="box" size="1"', 'name="box" size="2"'),
         Row("geom", "box", "size", 1.0, 2.0, 4)),
        ("a.py", "from robots import Drive\n" + MODULE, ("import Drive", "import Loose as Drive"),
         Row("module", "", "import Drive", "robots.Drive", "robots.Loose", 1)),
        ("a.py", "from __future__ import annotations\n" + MODULE,
         ("from __future__ import annotations", ""),
         Row("module", "", "import annotations", "__future__.annotations", None, 0)),
        ("a.py", MODULE, ("80.0", "88.0"),
         Row("function", "cfg", "return actuators[0] stiffness", 80.0, 88.0, 4)),
        ("a.py", MODULE, ('"turn": 0.5', '"turn": 0.6'),
         Row("function", "cfg", "return joints['turn']", 0.5, 0.6, 4)),
        ("a.py", MODULE, ("delay=2", "delay=2.0"),
         Row("function", "cfg", "return actuators[0] delay", "2", "2.0", 4)),
        ("dr.yaml", RANGES, ("3.5", "3.6"),
         Row("links", "base", "mass nominal", 3.5, 3.6, 4)),
        ("dr.yaml", RANGES, ("[3, 4]", "[3, 5]"),
         Row("links", "base", "mass range", (3.0, 4.0), (3.0, 5.0), 4)),
        ("a.json", '{"a": {"b": 1.0}}', ("1.0", "2.0"), Row("a", "", "b", 1.0, 2.0, 1)),
        ("calf.obj", MESH, ("v 0 1 0", "v 0 2 0"),
         Row("mesh", "calf", "v[2]", (0.0, 1.0, 0.0), (0.0, 2.0, 0.0), 3)),
        ("a.usda", STAGE, ("upperLimit = 90", "upperLimit = 91"),
         Row("prim", "/arm/turn", "physics:upperLimit", 90.0, 91.0, 15)),
        ("a.usda", STAGE, ("mass = 1", "mass = 3"),
         Row("prim", "/arm{Physics=off}", "mass", 1.0, 3.0, 20)),
        ("a.usda", STAGE, ('Physics = "on"', 'Physics = "off"'),
         Row("prim", "/arm", "variantSelection Physics", "on", "off", 6)),
        ("a.usda", STAGE, ("float physics", "token visibility.timeSamples = {0: \"invisible\"}\n"
                           "float physics"),
         Row("prim", "/arm/turn", "visibility extra", None, "custom=False "
             "timeSamples=0.0=invisible typeName=token variability=Sdf.VariabilityVarying", 15)),
        ("a.usda", STAGE, ("quatf", "quatd"),
         Row("prim", "/arm/turn", "physics:localRot0 typeName", "quatf", "quatd", 16)),
    ],
    ids=lambda value: value if isinstance(value, str) and len(value) < 9 else "",
)  # fmt: skip
def test_a_change_is_named_with_both_values(
    name: str, text: str, edit: tuple[str, str], row: Row, tmp_path: Path
):
    assert compared(tmp_path, name, text, edit) == [row]


@pytest.mark.parametrize(
    ("name", "text", "edit"),
    [
        ("a.urdf", URDF, ('"0 0 1.5"', '"0  0.0 1.5000000000001"')),
        ("a.urdf", URDF, ('name="turn" type="revolute"', 'type="revolute" name="turn"')),
        ("a.urdf", URDF, ("<limit", '<axis xyz="1 0 0"/><dynamics damping="0"/><limit lower="0"')),
        ("a.urdf", URDF, ('"0 0 1.5"', '"0 0 1.5" rpy="0 6.283185307179586 0"')),
        ("a.xml", MJCF, ('<position kp="80" kv="4"/>', '<!-- no --><position kv="4.0" kp="80"/>')),
        ("a.xml", MJCF, ("<joint name=", '<joint axis="0 0 2" name=')),
        ("a.py", MODULE, ('"""Its drives."""', "# the drives")),
        ("a.py", MODULE, ("def cfg():", "import math\ndef cfg() -> Entity:")),
        ("a.py", "from robots import Drive, Entity\n" + MODULE,
         ("import Drive, Entity", "import Entity\nfrom robots import Drive")),
        ("a.py", MODULE + "DELAY = 2\n", ("DELAY", "DELAY: int")),
        ("dr.yaml", RANGES, ("{nominal: 3.5, range: [3, 4]}", "\n      range: [3, 4]\n"
                             "      nominal: 3.5")),
        ("calf.obj", MESH, ("v 0 0 1\n", "\n# a corner\nv 0.0 0 1\n")),
        ("a.usda", STAGE, ("float mass = 2", "float mass = 2.0  # kg")),
        ("a.usda", STAGE, ("float physics", "bool physics:jointEnabled = 1\nfloat physics")),
    ],
)  # fmt: skip
def test_what_is_only_written_differently_is_the_same(
    name: str, text: str, edit: tuple[str, str], tmp_path: Path
):
    assert compared(tmp_path, name, text, edit) == []


def test_a_default_class_is_called_by_what_it_drives(tmp_path: Path):
    rows = compared(tmp_path, "a.xml", MJCF, ('kp="80"', 'kp="88"'))
    assert {(row.subject, row.attribute, row.expected, row.found) for row in rows} == {
        ("actuator turn", "kp", 80.0, 88.0), ("actuator lift", "kp", 80.0, 88.0),
    }  # fmt: skip
    (finding,) = row_findings(rows, "mjcf", "mjcf/a.xml")
    assert finding.rule == "equal.mjcf.kp"
    assert finding.where == "mjcf/a.xml:2"
    assert finding.data["subjects"] == ("actuator turn", "actuator lift")


def moved(kp: int) -> tuple[tuple[str, str], ...]:
    """The gains of the default class, in its two actuators; the first has another kp."""
    return (
        ('<position kp="80" kv="4"/>', ""),
        ('name="turn" joint', f'name="turn" kp="{kp}" kv="4" joint'),
        ('name="lift" joint', 'name="lift" kp="80" kv="4" joint'),
    )


def test_a_default_moved_into_its_elements_leaves_only_what_the_model_says(tmp_path: Path):
    """Five texts differ, and of one actuator the gain and the bias."""
    assert compared(tmp_path / "same", "a.xml", MJCF, *moved(80)) == []
    rows = compared(tmp_path, "a.xml", MJCF, *moved(88))
    assert {(row.subject, row.attribute, row.found) for row in rows} == {
        ("actuator turn", "biasprm[1]", -88.0), ("actuator turn", "gainprm[0]", 88.0),
    }  # fmt: skip


@pytest.mark.parametrize(
    ("name", "text", "edit", "line"),
    [
        ("a.urdf", URDF, ("</joint>", ""), 4),
        ("a.py", MODULE, ("return Entity(", "return Entity)"), 4),
        ("dr.yaml", RANGES, ("{nominal", "}nominal"), 4),
        ("a.usda", STAGE, ("= 90", "= ="), 15),
    ],
)
def test_what_does_not_parse_is_reported_with_its_line(
    name: str, text: str, edit: tuple[str, str], line: int, tmp_path: Path
):
    with pytest.raises(NotParsedError) as error:
        compared(tmp_path, name, text, edit)
    assert error.value.line == line


def test_an_encoding_that_mujoco_and_urdfdom_do_not_read_is_reported(tmp_path: Path):
    there = tmp_path / "there.urdf"
    again = tmp_path / "again.urdf"
    again.write_text(URDF)
    there.write_bytes(URDF.encode("utf-16"))
    with pytest.raises(NotParsedError, match="not UTF-8"):
        rows_of(again, there)


def test_a_layer_of_other_units_differs_although_no_stage_does(tmp_path: Path):
    """USD takes the units of the root layer; Isaac Sim scales what a layer of others adds."""
    for side, metre in (("again", 1), ("there", 0.01)):
        (tmp_path / side).mkdir()
        words = f'#usda 1.0\n(\n    defaultPrim = "arm"\n    metersPerUnit = {metre}\n)\n'
        (tmp_path / side / "base.usda").write_text(f'{words}def Xform "arm"\n{{\n}}\n')
        (tmp_path / side / "arm.usda").write_text(
            '#usda 1.0\n(\n    defaultPrim = "arm"\n)\n'
            'def "arm" (\n    payload = @./base.usda@\n)\n{\n}\n'
        )
    again, there = (tmp_path / side / "base.usda" for side in ("again", "there"))
    (row,) = rows_of(again, there, (tmp_path / "again" / "arm.usda",))
    assert (row.subject, row.attribute, row.expected, row.found) == (
        "prim /",
        "metersPerUnit",
        1.0,
        0.01,
    )


def test_a_picture_is_its_pixels(tmp_path: Path):
    again, packed, other = (tmp_path / name / "a.png" for name in "abc")
    for file in (again, packed, other):
        file.parent.mkdir()
    picture = Image.new("RGB", (3, 2), (10, 20, 30))
    picture.save(again)
    picture.save(packed, compress_level=1)
    picture.putpixel((2, 1), (10, 20, 33))
    picture.save(other)
    assert rows_of(again, packed) == []
    expected, found = (10.0, 20.0, 30.0), (10.0, 20.0, 33.0)
    assert rows_of(again, other) == [Row("picture", "a.png", "pixels[1][2]", expected, found)]


def test_a_yaml_file_whose_aliases_make_it_endless_is_not_parsed(tmp_path: Path) -> None:
    lines = [f"a{i}: &a{i} {{p: *a{i - 1}, q: *a{i - 1}}}" for i in range(1, 26)]
    endless = "\n".join(["a0: &a0 {x: 1}", *lines])
    with pytest.raises(NotParsedError, match="alias") as refused:
        compared(tmp_path, "dr.yaml", "a: 1", ("a: 1", endless))
    assert refused.value.line == 2
