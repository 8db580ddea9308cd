"""An element is known by where it stands: a <joint> of a tendon is no joint of a body.

Expected numbers are those of MuJoCo's own compilation of the same text.
"""

from __future__ import annotations

from pathlib import Path

import mujoco
import pytest
from mjcfs import TET, read

from assetbuild.errors import SourceError, StepError
from assetbuild.source.mjcf import copies
from assetbuild.source.mjcf.text import path_of

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


def counts(text: str) -> tuple[int, ...]:
    """Bodies, joints, tendons, actuators, equalities of MuJoCo's own compilation."""
    m = mujoco.MjModel.from_xml_string(text)
    return m.nbody - 1, m.njnt, m.ntendon, m.nu, m.neq


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
    bodies, joints, tendons, _, _ = counts(text)
    assert (moving, kept.count("tendon")) == (joints, tendons)
    assert len([b for b in reading.links.bodies if b.inertial]) == bodies


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


def test_an_element_keeps_its_own_line_beside_one_of_that_name_elsewhere(tmp_path: Path):
    text = model(HUB.format("\n" + RING), "\n\n" + COUPLED)
    lines = read(text, tmp_path).lines
    assert lines["joint j1"] == 2
    assert lines["equality j1"] == 5


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


def test_places_are_those_of_the_schema():
    from lxml import etree

    root = etree.fromstring(model(HUB.format(f"<frame>{RING}</frame>"), FIXED, CLASSES))
    places = {path_of(element)[1:] for element in root.iter("joint")}
    body, tendon = ("(world)body", "joint"), ("tendon", "fixed", "joint")
    assert places == {body, tendon, ("default", "joint")}


# --- whose fault it is ------------------------------------------------------------------------


def test_what_mujoco_refuses_is_said_in_its_name(tmp_path: Path):
    text = model(HUB.format(RING), FIXED.replace("j1", "nobody"))
    with pytest.raises(SourceError, match="MuJoCo does not"):
        read(text, tmp_path)


def test_what_we_made_of_a_sound_text_is_our_own_fault(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(copies, "_takes_name", lambda element: True)
    with pytest.raises(StepError, match="a bug in assetbuild") as caught:
        read(model(HUB.format(RING), FIXED), tmp_path)
    assert "report it" in caught.value.hint
