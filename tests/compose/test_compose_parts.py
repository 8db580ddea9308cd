"""Parts on a base: names, masses and motion are those of the parts, moved to their place."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from robot_files import run_step, write_source_ports
from tiny import TinyRobot, pendulum, tiny_quadruped
from urdfs import read

from assetbuild.compose.compose_parts import ComposeParts
from assetbuild.compose.composed_control import MountedPart
from assetbuild.errors import RecipeError
from assetbuild.findings import Finding
from assetbuild.robot.codec import decode, encode
from assetbuild.robot.files import SourceControl
from assetbuild.robot.model import Base, Control, MjcfOnly, Tree
from assetbuild.robot.pose import Pose, quat_of_rpy
from assetbuild.robot.sections import At, Mount
from assetbuild.robot.shapes import SourceShapes
from assetbuild.robot.tree import forward_kinematics, sample_positions

AT = At(link="trunk", xyz=(0.1, 0.0, 0.2), rpy=(0.3, -0.2, 1.0))
ARM = MountedPart(prefix="arm_", at=AT)


def put(folder: Path, robot: TinyRobot, *said: MjcfOnly) -> None:
    """The files of a robot that is composed; said: what its MJCF says besides."""
    write_source_ports(folder, robot)
    lines = {f"link {body.name}": 7 for body in robot.links.bodies}
    (folder / "source_map.json").write_text(json.dumps({"file": "r.urdf", "lines": lines}))
    if said:
        control = SourceControl(Control(mjcf_only=said))
        (folder / "source_control.json").write_bytes(encode(control))


def composed(tmp_path: Path, *parts: MountedPart) -> tuple[Tree, SourceShapes, list[Finding]]:
    """The quadruped with pendulums on it."""
    put(tmp_path / "base", tiny_quadruped())
    for part in parts:
        put(tmp_path / part.prefix, pendulum())
    findings = run_step(ComposeParts(parts=parts), tmp_path, tmp_path / "out")
    out = tmp_path / "out"
    return (
        decode(Tree, (out / "links.json").read_bytes()),
        decode(SourceShapes, (out / "shapes.json").read_bytes()),
        findings,
    )


def total_mass(tree: Tree) -> float:
    return sum(body.inertial.mass_kg for body in tree.bodies if body.inertial)


def test_a_part_moves_as_alone_seen_from_its_place(tmp_path):
    tree, *_ = composed(tmp_path, ARM)
    alone = pendulum().links
    place = Pose(AT.xyz, quat_of_rpy(*AT.rpy))
    for positions in sample_positions(tree, 5, seed=1):
        whole = forward_kinematics(tree, positions)
        part = forward_kinematics(alone, {n[4:]: q for n, q in positions.items()})
        for body in alone.bodies:
            wanted = (whole["trunk"] @ place @ part[body.name]).matrix()
            assert np.allclose(whole[f"arm_{body.name}"].matrix(), wanted, atol=1e-14)


def test_nothing_is_lost_and_the_mount_adds_its_mass(tmp_path):
    plate = Mount(mass=0.3, size=(0.1, 0.1, 0.01), at=(0, 0, -0.005))
    tree, shapes, findings = composed(tmp_path, ARM.model_copy(update={"mount": plate}))
    quadruped, arm = tiny_quadruped(), pendulum()
    assert total_mass(tree) == pytest.approx(
        total_mass(quadruped.links) + total_mass(arm.links) + 0.3
    )
    assert len(tree.joints) == len(quadruped.links.joints) + len(arm.links.joints) + 2
    own = len(quadruped.shapes.shapes) + len(arm.shapes.shapes)
    assert len(shapes.shapes) == own + 2  # the plate is seen and hit
    (told,) = findings
    assert told.data["mount_kg"] == 0.3


def test_two_equal_parts_need_two_prefixes(tmp_path):
    place = At(link="trunk", xyz=(-0.1, 0, 0.2))
    tree, *_ = composed(tmp_path, ARM, MountedPart(prefix="second_", at=place))
    assert {"arm_mount", "second_mount"} <= set(tree.by_joint)
    with pytest.raises(RecipeError, match="two parts have a"):
        composed(tmp_path / "again", ARM, MountedPart(prefix="arm_", at=place))


def test_a_place_that_is_no_link_is_refused(tmp_path):
    with pytest.raises(RecipeError, match="no link `trnk`") as caught:
        composed(tmp_path, ARM.model_copy(update={"at": At(link="trnk")}))
    assert "trunk" in str(caught.value)


def test_b1_with_z1_is_the_robot_that_somebody_merged_by_hand(tmp_path, go1_root):
    """Against example-robot-data's own b1-z1.urdf: every link, joint and pose."""
    folder = go1_root / "robots"

    def robot(name: str, to: str, base: Base = "floating") -> Tree:
        text = (folder / name).read_text()
        return read(text, tmp_path / to, base=base, packages={"example-robot-data": "."}).tree

    by_hand = robot("b1_description/urdf/b1-z1.urdf", "hand")
    robot("b1_description/urdf/b1.urdf", "base")
    robot("z1_description/urdf/z1.urdf", "arm_", "fixed")
    place = MountedPart(prefix="arm_", at=At(link="trunk", xyz=(0.35, 0, 0.09)))
    run_step(ComposeParts(parts=(place,)), tmp_path, tmp_path / "out")
    ours = decode(Tree, (tmp_path / "out/links.json").read_bytes())

    assert total_mass(ours) == pytest.approx(total_mass(by_hand), rel=1e-12)
    names = {body.name: body.name.removeprefix("arm_") for body in ours.bodies}
    extra = {name for name, plain in names.items() if plain not in by_hand.by_body}
    assert extra == {"arm_world"}  # the arm's own placeholder root
    for body in ours.bodies:
        if body.name not in extra:
            assert body.inertial == by_hand.by_body[names[body.name]].inertial, body.name
    moving = {joint.name.removeprefix("arm_") for joint in ours.moving_joints}
    assert moving == {joint.name for joint in by_hand.moving_joints}
    for positions in sample_positions(by_hand, 10, seed=2):
        theirs = forward_kinematics(by_hand, positions)
        mine = forward_kinematics(ours, positions | {f"arm_{n}": q for n, q in positions.items()})
        for name, plain in names.items():
            if name not in extra:
                assert np.allclose(mine[name].matrix(), theirs[plain].matrix(), atol=1e-12), name
    for joint in ours.moving_joints:
        assert joint.limits == by_hand.by_joint[joint.name.removeprefix("arm_")].limits
