"""Copies, attached models and what refers to them are written out exactly, or told to be lost."""

# ruff: noqa: E501 # one robot per line reads better than wrapped XML

from __future__ import annotations

import math
from pathlib import Path

import pytest
from mjcfs import TET, read
from source.test_read_mjcf import robot

from assetbuild.robot.model import Limits
from assetbuild.robot.tree import forward_kinematics


def test_replicated_bodies_are_written_out_exactly_with_what_refers_to_them(tmp_path: Path):
    head = '<compiler angle="radian" fusestatic="true"/>'
    body = '<body name="hub"><geom size=".1"/>\n<replicate count="3" euler="0 0 2.0943951023931953">\n<body name="r" pos=".3 0 0"><joint name="j"/><geom size=".01"/></body></replicate><body name="rim"><geom size=".1"/></body></body>'
    more = '<actuator>\n<motor name="m" joint="j"/></actuator>'
    reading = read(robot(body, more, head), tmp_path)
    assert [j.name for j in reading.links.moving_joints] == ["j0", "j1", "j2"]
    assert "rim" in {body.name for body in reading.links.bodies}, "MuJoCo would merge it"
    poses = forward_kinematics(reading.links, {})
    assert poses["r1"].xyz == pytest.approx((-0.15, 0.3 * math.sqrt(0.75), 0.0), abs=1e-15)
    assert [a.name for a in reading.control.actuators] == ["m0", "m1", "m2"]
    assert (reading.lines["link r2"], reading.lines["actuator j2"]) == (3, 4)


def test_an_attached_model_keeps_its_units_names_files_and_lines(tmp_path: Path):
    child = '<mujoco model="hand"><compiler angle="radian" meshdir="m"/><asset><mesh name="t" file="t.obj"/></asset><worldbody>\n<body name="palm"><joint name="turn" range="-1 1"/><geom type="mesh" mesh="t"/></body></worldbody></mujoco>'
    head = '<asset><model name="h" file="parts/hand.xml"/></asset>'
    body = '<body name="arm"><geom size=".1"/><frame pos="0 0 1"><attach model="h" body="palm" prefix="l_"/></frame></body>'
    reading = read(robot(body, head=head), tmp_path, parts__hand_xml=child, parts__m__t_obj=TET)
    joint = reading.links.by_joint["l_turn"]
    assert (joint.limits, joint.X_parent_joint.xyz) == (Limits(-1.0, 1.0), (0.0, 0.0, 1.0))
    assert [m["path"] for m in reading.meshes] == ["arm/parts/m/t.obj"]
    assert reading.lines["link l_palm"] == "arm/parts/hand.xml:2"


PLUGIN = '<extension><plugin plugin="mujoco.sensor.touch_grid"/></extension>'


def test_a_sensor_of_a_plugin_is_left_out_and_told(tmp_path: Path):
    grid = '<plugin name="grid" plugin="mujoco.sensor.touch_grid" objtype="site" objname="s"><config key="size" value="7 7"/></plugin>'
    body = '<body name="a"><geom size=".1"/><site name="s"/></body>'
    found = read(robot(body, f"<sensor>{grid}<gyro name='w' site='s'/></sensor>", PLUGIN), tmp_path)
    (told,) = [f for f in found.findings if f.subject == "sensor grid"]
    assert (told.rule, told.severity) == ("mjcf.dropped", "warning")
    assert [sensor.name for sensor in found.control.sensors] == ["w"]


PULLED = """\
<site name="anchor" pos="0 0 2"/><body name="a"{0}>{1}<geom size=".1"/><site name="s"/></body>"""
PULLING = '<tendon><spatial name="t"><site site="anchor"/><site site="s"/></spatial></tendon><actuator><muscle name="m" tendon="t" lengthrange="1 2"/></actuator><sensor><tendonpos name="p" tendon="t"/></sensor>'


def test_what_acts_through_a_lost_tendon_is_lost_too(tmp_path: Path):
    reading = read(robot(PULLED.format("", "<freejoint/>"), PULLING), tmp_path)
    told = {f.message.split(" was")[0]: f for f in reading.findings if f.rule == "mjcf.dropped"}
    assert list(told) == ["<spatial> `t`", "<muscle> `m`", "<tendonpos> `p`"]
    assert {f.severity for f in told.values()} == {"warning"}
    assert not {i.place for i in reading.control.mjcf_only} & {"tendon", "actuator"}


def test_what_belongs_to_another_robot_of_the_scene_is_no_warning(tmp_path: Path):
    one = '<body name="{0}"><freejoint/><geom size=".1"/><body><joint name="{0}_j"/><geom size=".1"/></body></body>'
    acting = '<motor name="{0}_m" joint="{0}_j"/>'
    sensing = '<actuatorfrc name="{0}_f" actuator="{0}_m"/>'
    both = '<distance name="gap" body1="ant" body2="bee"/>'
    words = [
        "".join(word.format(name) for name in ("ant", "bee")) for word in (one, acting, sensing)
    ]
    text = robot(words[0], f"<actuator>{words[1]}</actuator><sensor>{words[2]}{both}</sensor>")
    found = [f for f in read(text, tmp_path, body="ant").findings if f.rule == "mjcf.dropped"]
    told = [(f.message.split(" was")[0], f.severity) for f in found]
    lost = [("<motor> `bee_m`", "info"), ("<actuatorfrc> `bee_f`", "info")]
    assert told == [*lost, ("<distance> `gap`", "warning")]


def test_models_with_classes_of_one_name_are_attached_without_a_prefix(tmp_path: Path):
    sized = '<default><default class="c"><geom size="{}"/></default></default>'
    child = f'<mujoco>{sized.format(".3")}<worldbody><body name="palm" childclass="c"><geom/></body></worldbody></mujoco>'
    head = sized.format(".1") + '<asset><model name="h" file="hand.xml"/></asset>'
    body = '<body name="arm" childclass="c"><geom/><frame><attach model="h" body="palm" prefix=""/></frame></body>'
    reading = read(robot(body, head=head), tmp_path, hand_xml=child)
    assert [s.geometry.radius for s in reading.shapes.shapes] == [0.1, 0.3] * 2  # type: ignore[union-attr] # spheres


def test_a_tendon_to_the_world_makes_the_world_the_root(tmp_path: Path):
    reading = read(robot(PULLED.format("", ""), PULLING), tmp_path)
    assert reading.links.root == "world"
    assert {i.place for i in reading.control.mjcf_only} >= {"tendon", "actuator"}
