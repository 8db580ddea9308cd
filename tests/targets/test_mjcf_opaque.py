"""What only MJCF can say is written where it belongs, and nothing else changes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import pytest
from tiny import TinyRobot, run_step, tiny_quadruped, write_robot_ports

from assetbuild.robot.model import MjcfOnly
from assetbuild.targets.mjcf import Mjcf


def emit(robot: TinyRobot, folder: Path) -> None:
    write_robot_ports(folder / "in", robot)
    run_step(Mjcf(robot="robot"), folder / "in", folder / "out")


def written(folder: Path, *items: MjcfOnly) -> tuple[mujoco.MjModel, str]:
    robot = tiny_quadruped()
    robot = replace(robot, control=replace(robot.control, mjcf_only=items))
    emit(robot, folder)
    path = folder / "out/mjcf/robot.xml"
    return mujoco.MjModel.from_xml_path(str(path)), path.read_text()


def first(kind: str, model: mujoco.MjModel, index: int = 0) -> str:
    return str(getattr(model, kind)(index).name)


def test_without_anything_nothing_changes(tmp_path: Path):
    _, plain = written(tmp_path / "a")
    emit(tiny_quadruped(), tmp_path / "b")
    assert plain == (tmp_path / "b/out/mjcf/robot.xml").read_text()


def test_attributes_are_added_to_what_they_belong_to(tmp_path: Path):
    model, _ = written(tmp_path / "plain")
    joint, body, geom = first("joint", model, 1), first("body", model, 1), first("geom", model)
    model, _ = written(
        tmp_path / "more",
        MjcfOnly("joint", '<joint stiffness="3" springref="0.5"/>', joint),
        MjcfOnly("body", '<body gravcomp="0.5"/>', body),
        MjcfOnly("root", '<body pos="0 0 2"/>', body),
        MjcfOnly("shape", '<geom group="5"/>', geom),
        MjcfOnly("option", '<option iterations="7"><flag eulerdamp="disable"/></option>'),
        MjcfOnly("freejoint", '<freejoint name="loose"/>'),
    )
    assert model.joint(joint).stiffness[0] == 3
    assert model.qpos_spring[model.joint(joint).qposadr[0]] == 0.5
    assert model.body_gravcomp[model.body(body).id] == 0.5
    assert model.body(body).pos[2] == 2
    assert model.geom(geom).group[0] == 5
    assert model.opt.iterations == 7
    assert model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_EULERDAMP
    assert first("joint", model) == "loose"


def test_elements_land_in_their_sections_and_bodies(tmp_path: Path):
    model, _ = written(tmp_path / "plain")
    joints, body = [first("joint", model, i) for i in (1, 2)], first("body", model, 2)
    model, text = written(
        tmp_path / "more",
        MjcfOnly("body", '<light name="lamp" pos="0 0 1"/>', body),
        MjcfOnly("body", '<light name="sun" pos="0 0 3"/>'),
        MjcfOnly("equality", f'<joint name="tie" joint1="{joints[0]}" joint2="{joints[1]}"/>'),
        MjcfOnly("tendon", f'<fixed name="t"><joint joint="{joints[0]}" coef="2"/></fixed>'),
        MjcfOnly("actuator", '<general name="pull" tendon="t"/>'),
        MjcfOnly("sensor", '<tendonpos name="length" tendon="t"/>'),
        MjcfOnly(
            "contact", f'<exclude name="no" body1="{body}" body2="{first("body", model, 5)}"/>'
        ),
    )
    assert first("body", model, int(model.light("lamp").bodyid[0])) == body
    assert int(model.light("sun").bodyid[0]) == 0
    assert (model.neq, model.ntendon, model.nsensor) == (1, 1, 1)
    assert first("actuator", model, model.nu - 1) == "pull", "after the robot's own drives"
    order = [text.index(f"<{tag}") for tag in ("worldbody", "contact", "equality", "tendon")]
    order += [text.index(f"<{tag}>") for tag in ("actuator", "sensor")]
    assert order == sorted(order)


def test_an_empty_value_takes_an_attribute_away(tmp_path: Path):
    model, text = written(tmp_path / "plain")
    name = first("actuator", model)
    joint = first("joint", model, int(model.actuator(0).trnid[0]))
    assert f'name="{name}"' in text
    lens = MjcfOnly("drive", '<position inheritrange="0" group="3"/>', joint)
    model, _ = written(tmp_path / "more", lens)
    assert model.actuator(name).group[0] == 3
    assert not model.actuator(name).ctrllimited[0]
    _, text = written(tmp_path / "less", MjcfOnly("freejoint", '<freejoint name=""/>'))
    assert "<freejoint/>" in text


def test_commands_of_a_keyframe_follow_the_names_of_the_drives(tmp_path: Path):
    model, _ = written(tmp_path / "plain")
    key, last = first("key", model), first("actuator", model, model.nu - 1)
    said = f'<key><ctrl actuator="{last}" value="0.25"/></key>'
    changed, _ = written(tmp_path / "more", MjcfOnly("keyframe", said, key))
    assert changed.key_ctrl[0][-1] == 0.25
    assert list(changed.key_ctrl[0][:-1]) == list(model.key_ctrl[0][:-1])


@pytest.mark.parametrize("name", ["world", "robot"])
def test_a_body_called_world_is_renamed_in_what_names_it(name: str, tmp_path: Path):
    robot = tiny_quadruped()
    root = robot.tree.root
    tree = replace(
        robot.tree,
        bodies=tuple(replace(b, name=name) if b.name == root else b for b in robot.tree.bodies),
        joints=tuple(replace(j, parent=name) if j.parent == root else j for j in robot.tree.joints),
        frames=tuple(replace(f, body=name) if f.body == root else f for f in robot.tree.frames),
    )
    shapes = replace(
        robot.shapes,
        shapes=tuple(replace(s, link=name) if s.link == root else s for s in robot.shapes.shapes),
    )
    other = robot.tree.bodies[2].name
    item = MjcfOnly("contact", f'<exclude name="no" body1="{name}" body2="{other}"/>')
    control = replace(robot.control, mjcf_only=(item,), excludes=(), sensors=(), cameras=())
    emit(replace(robot, links=tree, tree=tree, shapes=shapes, control=control), tmp_path)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out/mjcf/robot.xml"))
    assert model.nexclude == 1
