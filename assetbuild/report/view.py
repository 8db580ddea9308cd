"""What the report's 3D view knows of the robot beside its geometry: joints, poses, numbers."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import asdict

from assetbuild.report.card import Subject
from assetbuild.report.tables import text_of
from assetbuild.robot.initial import initial_pose
from assetbuild.robot.model import Body, Joint
from assetbuild.robot.pose import Pose


def view_data(subject: Subject) -> str:
    """JSON for `viewer.js`. m, rad, quaternions wxyz; poses of joints are in the parent body."""
    tree, start = subject.tree, initial_pose(subject.tree, subject.control)
    others = [key for key in subject.control.keyframes if key.name != start.name]
    poses: list[object] = [
        {"name": k.name or "initial", "joints": dict(k.joints), **_plain_pose(tree.root_pose(k))}
        for k in (start, *others)
        if k.name or any(value for _, value in k.joints)
    ]
    poses.append({"name": "all joints 0", "joints": {}, **_plain_pose(tree.root_pose(start))})
    content = {
        "robot": subject.recipe.robot,
        "floating": tree.base == "floating",
        "root": tree.root,
        "size": subject.measured.size_m,
        "bodies": [_body(body, subject) for body in tree.bodies],
        "joints": [_joint(joint) for joint in tree.joints],
        "poses": poses,
    }
    return json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)


def _plain_pose(pose: Pose) -> dict[str, object]:
    return {"xyz": list(pose.xyz), "quat": list(pose.quat)}


def _joint(joint: Joint) -> dict[str, object]:
    lower, upper = joint.limits.lower, joint.limits.upper
    if joint.kind == "continuous" or lower is None or upper is None or not lower < upper:
        upper = 1.0 if joint.kind == "prismatic" else math.pi
        lower = -upper
    has_axis = joint.kind in ("revolute", "continuous", "prismatic")
    mimic = joint.mimic
    return {
        "name": joint.name,
        "kind": joint.kind,
        "parent": joint.parent,
        "child": joint.child,
        "axis": list(joint.axis) if has_axis else None,
        "lower": lower,
        "upper": upper,
        "unit": "m" if joint.kind == "prismatic" else "rad",
        "mimic": mimic and asdict(mimic),
        **_plain_pose(joint.X_parent_joint),
    }


def _body(body: Body, subject: Subject) -> dict[str, object]:
    row: dict[str, object] = {"name": body.name, "facts": list(_facts(body, subject))}
    if body.inertial is None:
        return row
    row["com"] = list(body.inertial.com_m)
    measured = subject.measured.by_body[body.name]
    if measured.semi_axes_m is not None:
        row["ellipsoid"] = {"axes": list(measured.semi_axes_m), "quat": list(measured.axes)}
    return row


def _facts(body: Body, subject: Subject) -> Iterator[tuple[str, str]]:
    tree = subject.tree
    yield "link", body.name
    if body.inertial is not None:
        yield "mass", f"{body.inertial.mass_kg:.6g} kg"
        yield "centre of mass", f"{text_of(body.inertial.com_m)} m"
        moments = subject.measured.by_body[body.name].moments_kg_m2
        yield "principal moments", f"{text_of(moments)} kg m²"
    merged = [frame.name for frame in tree.frames if frame.body == body.name]
    if merged:
        yield "holds", ", ".join(merged)
    joint = tree.joint_above.get(body.name)
    if joint is not None:
        yield "joint", f"{joint.name}, {joint.kind}, axis {text_of(joint.axis)}"
        yield "limits", f"{text_of(joint.limits.lower)} to {text_of(joint.limits.upper)}"
        drive = subject.control.by_joint.get(joint.name)
        if drive is not None:
            yield "drive", f"{drive.model}, kp {drive.kp:g}, kd {drive.kd:g}"
            yield "effort", text_of(drive.effort)
            yield "armature", f"{drive.armature:.4g} kg m²"
    links = {body.name, *merged}
    pieces = [s for s in subject.shapes.of("collision") if s.link in links]
    kinds = sorted({type(shape.geometry).__name__.lower() for shape in pieces})
    yield "collision", f"{len(pieces)} pieces" + (f": {', '.join(kinds)}" if kinds else "")
