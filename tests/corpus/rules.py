"""Rules by which a source is broken, written down before the corpus ran.

A robot that breaks one is run like the others. When it does not end in a ready bundle, it is left
out, by name and with its rule. Nothing of assetbuild decides here. The runner knows one more rule,
`file`: the description, or a mesh that it names, is not there.
"""

from __future__ import annotations

import math
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from xml.etree.ElementTree import Element, ParseError, fromstring

import numpy as np


def broken(source: Path) -> str:
    """`rule: what`, of the first rule that the URDF or MJCF breaks, else ""."""
    if source.suffix == ".xml":
        return next(_of_mjcf(source), "")
    if not _is_read(source):
        return "readers: neither pinocchio nor yourdfpy reads it"
    try:
        robot = fromstring(source.read_bytes())  # noqa: S314 - expat refuses external entities
    except ParseError:
        return ""
    return next(_of_urdf(robot), "")


def _is_read(urdf: Path) -> bool:
    """Each in a child of its own: a reader may crash."""
    programs = (
        "import pinocchio, sys; pinocchio.buildModelFromUrdf(sys.argv[1])",
        "import yourdfpy, sys; robot = yourdfpy.URDF.load(sys.argv[1], load_meshes=False, "
        "load_collision_meshes=False, build_scene_graph=False); sys.exit(not robot.link_map)",
    )
    return any(_runs(program, urdf) for program in programs)


def _of_mjcf(source: Path) -> Iterator[str]:
    program = (
        "import mujoco, sys; m = mujoco.MjModel.from_xml_path(sys.argv[1]); sys.exit(3 * m.nflex)"
    )
    code = subprocess.run(
        [sys.executable, "-P", "-c", program, str(source)], capture_output=True, timeout=120
    ).returncode
    if code:
        yield "soft: it has flexes" if code % 3 == 0 else "readers: MuJoCo does not compile it"


def _runs(program: str, file: Path) -> bool:
    command = [sys.executable, "-P", "-c", program, str(file)]
    try:
        return not subprocess.run(command, capture_output=True, timeout=120).returncode
    except subprocess.TimeoutExpired:
        return False


def _of_urdf(robot: Element) -> Iterator[str]:
    links = [link.get("name", "") for link in robot.findall("link")]
    joints = [joint for joint in robot.findall("joint") if joint.get("type")]
    names = [joint.get("name", "") for joint in joints]
    yield from _tree(links, joints)
    for kind, all_of_them in (("link", links), ("joint", names)):
        for name, count in Counter(all_of_them).items():
            if count > 1:
                yield f"names: {count} times the {kind} {name}"
    for joint in joints:
        mimic = joint.find("mimic")
        if mimic is not None and mimic.get("joint") not in names:
            yield f"mimic: {joint.get('name')} mimics {mimic.get('joint')}"
    try:
        yield from _numbers(robot, joints)
    except ValueError as error:
        yield f"number: {error}"


def _tree(links: list[str], joints: list[Element]) -> Iterator[str]:
    parents: dict[str, str] = {}
    for joint in joints:
        ends = [end.get("link", "") for tag in ("parent", "child") for end in joint.findall(tag)]
        for name in ends:
            if name not in links:
                yield f"tree: the joint {joint.get('name')} names {name}, which is no link"
        if len(ends) == 2:
            if ends[1] in parents:
                yield f"tree: {ends[1]} has two parents"
            parents[ends[1]] = ends[0]
    roots = [name for name in dict.fromkeys(links) if name not in parents]
    if len(roots) != 1:
        yield f"tree: {len(roots)} roots"


def _numbers(robot: Element, joints: list[Element]) -> Iterator[str]:
    total, stated = 0.0, False
    for link in robot.findall("link"):
        name, inertial = link.get("name"), link.find("inertial")
        mass = number(inertial, "mass", "value")
        total, stated = total + (mass or 0.0), stated or mass is not None
        if mass is not None and mass < 0:
            yield f"mass: {name} weighs {mass:g} kg"
        if mass is not None and mass > 10_000:
            yield f"absurd: {name} weighs {mass:g} kg"
        values = [number(inertial, "inertia", key) or 0.0 for key in _TENSOR]
        xx, xy, xz, yy, yz, zz = values
        moments = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        if moments[0] < -1e-6 * abs(moments[2]):
            yield f"tensor: {name} has the principal moment {moments[0]:.3g} kg m2"
    if total == 0.0:
        yield "massless: no link states a mass above zero"
    if stated and 0 < total < 1e-3:
        yield f"absurd: it weighs {total:g} kg"
    for joint in joints:
        lower, upper = (number(joint, "limit", key) or 0.0 for key in ("lower", "upper"))
        if lower > upper and joint.get("type") in ("revolute", "prismatic"):
            yield f"limits: {joint.get('name')} from {lower:g} to {upper:g}"
        place = joint.find("origin")
        far = math.hypot(*numbers(place.get("xyz", "0")) if place is not None else (0.0,))
        if far > 30:
            yield f"absurd: {joint.get('name')} lies {far:g} m from its parent"


_TENSOR = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


def number(element: Element | None, tag: str, key: str) -> float | None:
    """None where it is not stated; ValueError where it is none."""
    found = element.find(tag) if element is not None else None
    text = found.get(key) if found is not None else None
    return numbers(text)[0] if text and text.strip() else None


def numbers(text: str) -> list[float]:
    """Commas part numbers as blanks do, for readers that take them."""
    values = [float(word) for word in text.replace(",", " ").split()]
    if not all(map(math.isfinite, values)):
        raise ValueError(f"`{text}` is not finite")
    return values
