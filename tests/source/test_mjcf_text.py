"""An element is known by where it stands, and by the version of MuJoCo that knows its words.

Expected numbers are those of MuJoCo's own compilation of the same text.
"""

from __future__ import annotations

from pathlib import Path

import mujoco
import pytest
from mjcfs import TET, arm, compared, read, same_motion, write

from assetbuild.cli import main
from assetbuild.errors import SourceError

FINGER = """<body name="f" pos=".1 0 0"><joint name="j" axis="0 1 0" range="-1 1" limited="true"/>
  <geom name="g" size=".02"/><site name="s" pos="0 0 .05"/></body>"""
RING = f'<replicate count="3" euler="0 0 2">{FINGER}</replicate>'
HUB = (
    '<body name="hub"><geom name="drum" type="cylinder" size=".03 .1"/><site name="side"/>{}</body>'
)
FIXED = """<tendon><fixed name="t"><joint joint="j0" coef="1"/><joint joint="j1" coef=".5"/></fixed>
  </tendon><actuator><position name="m" tendon="t" kp="5"/></actuator>"""
WRAPPED = """<tendon><spatial name="t"><site site="s0"/><geom geom="drum" sidesite="side"/>
  <site site="s1"/><pulley divisor="2"/><site site="s1"/><site site="s2"/></spatial></tendon>"""
COUPLED = """<equality><joint name="j1" joint1="j1" joint2="j2"/>
  <weld body1="f0" body2="f2" active="false"/></equality>"""
CONTACTS = """<contact><exclude body1="f0" body2="f1"/><pair geom1="g0" geom2="g2"/></contact>"""
PROGRAM = """<custom><numeric name="n" data="1 2"/><tuple name="x"><element objtype="body"
  objname="f1"/></tuple></custom><keyframe><key qpos=".1 .2 .3"/></keyframe>"""
CLASSES = """<default><joint damping=".1"/><geom condim="4"/><tendon width=".004"/><site/>
  <default class="c"><joint armature=".1"/><default class="d"><geom rgba="1 0 0 1"/></default>
  </default></default>"""


def model(body: str, rest: str = "", head: str = "") -> str:
    return f"<mujoco>{head}<worldbody>{body}</worldbody>{rest}</mujoco>"


@pytest.mark.parametrize(
    ("rest", "head"),
    [
        (FIXED, ""),
        (WRAPPED, ""),
        (FIXED + COUPLED, CLASSES),
        (WRAPPED + PROGRAM, CLASSES),
        (FIXED + '<sensor><tendonpos tendon="t"/><touch site="s1"/></sensor>', ""),
        (CONTACTS + WRAPPED, ""),
    ],
    ids=["fixed", "wrapped", "coupled", "programs", "sensors", "contacts"],
)  # fmt: skip
def test_copies_beside_a_tendon_are_written_out(rest: str, head: str, tmp_path: Path):
    text = model(HUB.format(RING), rest, head)
    reading = read(text, tmp_path)
    moving = len(reading.links.moving_joints)
    kept = [item.place for item in reading.control.mjcf_only]
    theirs = mujoco.MjModel.from_xml_string(text)
    assert (moving, kept.count("tendon")) == (theirs.njnt, theirs.ntendon)
    assert len([b for b in reading.links.bodies if b.inertial]) == theirs.nbody - 1


def test_an_attached_hand_brings_its_tendon(tmp_path: Path):
    hand = model(
        HUB.format(FINGER), FIXED.replace("j0", "j").replace('<joint joint="j1" coef=".5"/>', "")
    )
    arm = model(
        '<body name="arm"><joint name="a"/><geom size=".1"/><frame pos="0 0 1">'
        '<attach model="h" body="hub" prefix="l_"/></frame></body>',
        '<tendon><fixed name="t"><joint joint="a" coef="2"/></fixed></tendon>',
        '<asset><model name="h" file="hand.xml"/></asset>',
    )  # fmt: skip
    reading = read(arm, tmp_path, hand_xml=hand)
    tendons = [i.element for i in reading.control.mjcf_only if i.place == "tendon"]
    assert [name in text for name, text in zip(('"t"', '"l_t"'), tendons, strict=True)] == [
        True
    ] * 2
    assert [joint.name for joint in reading.links.moving_joints] == ["a", "l_j"]


MESHED = """<default><default class="v"><geom type="mesh" mesh="tet"/></default>{}</default>
  <asset><mesh name="tet" file="tet.obj"/></asset>"""


@pytest.mark.parametrize(
    "main", ['<geom type="mesh" mesh="tet"/>', '<geom type="hfield"/>', ""], ids=str
)
def test_what_a_tendon_runs_over_has_no_class_of_shapes(main: str, tmp_path: Path):
    """The class of all shapes speaks for shapes, not for the <geom> of a tendon."""
    body = HUB.format(
        '<body name="f" pos=".1 0 0"><joint name="j" axis="0 1 0"/><geom class="v" name="g"/>'
        '<site name="s0"/></body><site name="s1" pos="-.1 0 0"/>'
    )
    over = '<site site="s0"/><geom geom="drum"/><site site="s1"/>'
    rest = f'<tendon><spatial name="t">{over}</spatial></tendon>'
    reading = read(model(body, rest, MESHED.format(main)), tmp_path, tet_obj=TET)
    (tendon,) = [i.element for i in reading.control.mjcf_only if i.place == "tendon"]
    assert '<geom geom="drum"' in tendon


def test_copies_that_mujoco_refuses_are_refused_in_its_name(tmp_path: Path):
    text = model(HUB.format(RING), FIXED.replace("j1", "nobody"))
    with pytest.raises(SourceError, match="MuJoCo does not write <replicate> out"):
        read(text, tmp_path)


# --- words that one version of MuJoCo knows ----------------------------------------------------


NEWER = {
    "`springyield`": arm(joint='stiffness="3" springyield="1"'),
    "`castshadow`": arm(geom='castshadow="false"'),
    "`pid`": arm(drive='<pid name="m" joint="j" kp="3" ki="1"/>'),
    '`integrator="discrete"`': arm(head='\n<option integrator="discrete"/>'),
    "`inheritrange`": arm('range="-1 1"', '<general name="m" joint="j" inheritrange="1" '
                                          'biastype="affine" gainprm="2" biasprm="0 -2"/>'),
}  # fmt: skip
KNOWN = [
    '<motor name="m" joint="j" delay=".01" nsample="3"/>',
    '<motor name="m" joint="j" damping="1" armature=".1" gear="2"/>',
    '<dcmotor name="m" joint="j" motorconst=".1" resistance="1"/>',
]
"""Actuators that 3.11 knows and no law of a joint can be."""


@pytest.mark.parametrize("word", NEWER)
def test_a_newer_word_is_refused_with_its_place_and_the_key_that_keeps_it(
    word: str, tmp_path: Path
):
    with pytest.raises(SourceError) as caught:
        read(NEWER[word], tmp_path)
    assert word in caught.value.message
    assert caught.value.where is not None
    assert caught.value.where.line > 1
    assert "mjcf: {grammar: 4.0}" in caught.value.hint


@pytest.mark.parametrize(
    "text", [*NEWER.values(), *(arm(drive=drive) for drive in KNOWN)], ids=[*NEWER, *"123"]
)
def test_what_is_kept_moves_as_in_the_source(text: str, tmp_path: Path):
    done = write(read(text, tmp_path / "read", grammar=4.0), tmp_path / "out")
    assert compared(done) == set()
    same_motion(text, done.xml)


def test_init_writes_the_key_where_it_is_needed(tmp_path: Path):
    file, recipe = tmp_path / "arm.xml", tmp_path / "arm.yaml"
    file.write_text(NEWER["`castshadow`"])
    assert main(["init", str(file), "-o", str(recipe)]) == 0
    assert "\n  grammar: 4.0" in recipe.read_text()
    recipe.unlink()
    file.write_text(arm())
    assert main(["init", str(file), "-o", str(recipe)]) == 0
    assert "grammar" not in recipe.read_text()


def test_an_element_keeps_its_own_line_beside_one_of_that_name_elsewhere(tmp_path: Path):
    text = model(HUB.format("\n" + RING), "\n\n" + COUPLED)
    lines = read(text, tmp_path).lines
    assert lines["joint j1"] == 2
    assert lines["equality j1"] == 5


@pytest.mark.parametrize("masks", ['contype="0" conaffinity="0"', 'contype="0"'])
def test_a_shape_that_only_a_pair_holds_on_the_floor_stands_on_any_floor(
    masks: str, tmp_path: Path
):
    """The geom takes the numbers of its pair, and a priority so that the floor's do not win."""
    text = f"""<mujoco><worldbody><geom name="ground" type="plane" size="1 1 1"/>
    <body name="base" pos="0 0 .1"><freejoint/><geom name="hull" size=".1" {masks}/></body>
    </worldbody><contact><pair geom1="ground" geom2="hull" condim="4" friction=".3 .3 .02"/>
    </contact></mujoco>"""
    done = read(text, tmp_path / "read")
    found = [f for f in done.findings if f.rule == "mjcf.no_floor"]
    assert [f.data["shapes"] for f in found] == ([("hull",)] if "aff" in masks else [])
    dropped = [f.severity for f in done.findings if f.rule == "mjcf.dropped"]
    assert set(dropped) == {"info"}, "nothing is lost"
    xml = write(done, tmp_path / "out").xml
    geom = mujoco.MjModel.from_xml_path(str(xml)).geom("hull")
    assert (geom.contype, geom.conaffinity) == (0, 1)
    if found:
        assert (geom.condim, geom.priority) == (4, 1)
        assert list(geom.friction[:2]) == [0.3, 0.02]


@pytest.mark.parametrize(
    ("thigh", "masks", "severity"),
    [
        ("", (0, 3), "warning"),  # the thigh's masks of (1, 1) meet those of any foot that stands
        ('contype="2" conaffinity="4"', (2, 5), "info"),
        ('contype="1" conaffinity="0"', (3, 4), "info"),
    ],
)
def test_a_shape_that_meets_the_floor_of_its_scene_alone_stands_on_any_floor(
    thigh: str, masks: tuple[int, int], severity: str, tmp_path: Path
):
    """One bit more, in the mask by which it still meets no other shape."""
    foot = 'contype="2" conaffinity="4"' if thigh else 'contype="0" conaffinity="2"'
    floor = 'contype="2" conaffinity="2"'
    text = f"""<mujoco><worldbody><geom type="plane" size="1 1 1" {floor}/>
    <body name="base" pos="0 0 .5"><freejoint/><geom name="thigh" size=".1" {thigh}/>
    <body name="foot" pos="0 0 -.4"><joint name="j"/><geom name="foot" size=".1" {foot}/></body>
    </body></worldbody></mujoco>"""
    done = read(text, tmp_path / "read")
    assert [f.severity for f in done.findings if f.rule == "mjcf.no_floor"] == [severity]
    geom = mujoco.MjModel.from_xml_path(str(write(done, tmp_path / "out").xml)).geom("foot")
    assert (geom.contype[0], geom.conaffinity[0]) == masks
