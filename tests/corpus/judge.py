"""Is the bundle the source's robot? pinocchio, MuJoCo and a second mesh reader say so, not we.

A URDF (of a xacro, what it expands to): pinocchio's poses of all links, mass and centre of mass,
against our MJCF in MuJoCo; area and size of each link's meshes, against our URDF's, assimp reading
both. An MJCF: MuJoCo on the source and on ours. Poses are relative to one link, so that it does not
matter where the base stands.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, ParseError, fromstring, tostring

import numpy as np

from tests.corpus.assimp import Measured, polygons, polygons_measured

POSES = 10
TOLERANCE = 1e-6
"""m, direction cosines, and relative for masses: sources state six digits."""
AREA, SIZE = 0.05, 0.01
"""Relative: a mesh of more than `max_faces` is thinned."""
Poses = dict[str, np.ndarray]
"""(4, 4) of each link or body, in the world."""


def evaluate(
    source: Path, bundle: Path, find: Callable[[str], Path | None], *, edited: bool
) -> str:
    """`equal`, `not judged: ...`, or what differs. find: the file of a mesh's URI.

    edited: `init` changed masses or limits, so that only kinematics are compared.
    """
    (built,) = [p for p in (bundle / "mjcf").glob("*.xml") if is_robot_alone(p)]
    if source.suffix == ".xml":
        return in_mujoco(source, built, edited=edited)
    urdf = next((bundle / "urdf").glob("*.urdf"), None)
    differs = [in_pinocchio(source, built, edited=edited)]
    if urdf:
        differs += meshes(source, urdf, find)
    differs = [words for words in differs if words]
    return "; ".join(differs) or "equal"


def is_robot_alone(mjcf: Path) -> bool:
    return mjcf.stem != "scene" and not re.search(r"(^scene_|_mjx$|_bare$)", mjcf.stem)


# --- kinematics and mass --------------------------------------------------------------------


def in_pinocchio(source: Path, built: Path, *, edited: bool) -> str:
    """What differs between the source in pinocchio and our MJCF in MuJoCo, "" if nothing."""
    import mujoco
    import pinocchio as pin

    try:
        theirs = pin.buildModelFromXML(readable(source))
    except (ValueError, RuntimeError, UnicodeDecodeError) as error:
        return f"not judged: pinocchio: {str(error).splitlines()[0][:120]}"
    ours = mujoco.MjModel.from_xml_path(str(built))
    data, state = theirs.createData(), mujoco.MjData(ours)
    random = np.random.default_rng(0)
    for _ in range(POSES):
        q = pin.neutral(theirs)
        mujoco.mj_resetData(ours, state)
        state.qpos[:] = 0.0
        for number in range(1, theirs.njoints):
            joint, angle = theirs.joints[number], random.uniform(-1.0, 1.0)
            index = mujoco.mj_name2id(ours, mujoco.mjtObj.mjOBJ_JOINT, theirs.names[number])
            if joint.nv != 1:
                continue
            if index < 0:
                return f"the joint {theirs.names[number]} is not in ours"
            at = joint.idx_q
            q[at : at + joint.nq] = angle if joint.nq == 1 else (np.cos(angle), np.sin(angle))
            state.qpos[ours.jnt_qposadr[index]] = angle
        upright(ours, state)
        pin.framesForwardKinematics(theirs, data, q)
        mujoco.mj_forward(ours, state)
        there = {
            frame.name: data.oMf[number].homogeneous  # a joint may have the name of a link
            for number, frame in enumerate(theirs.frames)
            if frame.type == pin.FrameType.BODY
        }
        if differs := unlike(there, poses(ours, state)):
            return differs
        masses = [inertia.mass for inertia in theirs.inertias]
        centres = [
            X.act(inertia.lever) for X, inertia in zip(data.oMi, theirs.inertias, strict=True)
        ]
        if not edited and sum(masses):
            centre = np.average(centres, axis=0, weights=masses)
            if differs := heavier(sum(masses), centre, there, ours, state):
                return differs
    return ""


_LISTS = ("xyz", "rpy", "size", "scale", "rgba")


def readable(source: Path) -> str:
    """The URDF without what pinocchio alone refuses and no pose or mass depends on.

    Commas beside numbers are blanks, of four numbers three count, a missing or negative effort or
    velocity is 0, and a revolute joint without a limit turns without end. A text that is no XML
    stays as it is.
    """
    text = re.sub(r"<\?xml.*?\?>", "", source.read_text())
    try:
        robot = fromstring(text)  # noqa: S314 - expat refuses external entities
    except ParseError:
        return text
    for element in robot.iter():
        for key in _LISTS:
            if key in element.attrib:
                words = re.split(r"[\s,;]+", element.attrib[key].strip(" ,;"))
                element.set(key, " ".join(words[:3] if key in ("xyz", "rpy") else words))
    for joint in robot.findall("joint"):
        limit = joint.find("limit")
        if limit is None and joint.get("type") == "revolute":
            joint.set("type", "continuous")
        for key in ("effort", "velocity"):
            if limit is not None and (value(limit.get(key)) or 0.0) <= 0.0:
                limit.set(key, "0")
    return tostring(robot, encoding="unicode")


def value(text: str | None) -> float | None:
    """None where there is none."""
    try:
        return None if text is None else float(text)
    except ValueError:
        return None


def upright(model: Any, state: Any) -> None:  # Any: mujoco has no types
    """Unit quaternions of free and ball joints."""
    for kind, at in zip(model.jnt_type, model.jnt_qposadr, strict=True):
        if kind in (0, 1):
            state.qpos[at + (3 if kind == 0 else 0)] = 1.0


def poses(model: Any, state: Any) -> Poses:  # Any: mujoco has no types
    """Return the poses of bodies and of sites, which merged links become."""
    found: Poses = {}
    for count, named, xpos, xmat in (
        (model.nsite, model.site, state.site_xpos, state.site_xmat),
        (model.nbody, model.body, state.xpos, state.xmat),
    ):
        for index in range(count):
            X = np.eye(4)
            X[:3, :3], X[:3, 3] = xmat[index].reshape(3, 3), xpos[index]
            found[named(index).name] = X
    return found


def unlike(there: Poses, here: Poses) -> str:
    """The link whose pose differs most, each relative to the first link that both have.

    Where a joint of an MJCF stands beside the origin of its body, our link has the joint's frame
    and the old one is called `<body>_origin`.
    """
    here = {name: here.get(f"{name}_origin", X) for name, X in here.items()}
    names = [name for name in there if name in here and name not in ("", "world", "universe")]
    if not names:
        return "no link of the source is in ours"
    first = names[0]
    theirs, ours = np.linalg.inv(there[first]), np.linalg.inv(here[first])
    errors = {n: np.abs(theirs @ there[n] - ours @ here[n]).max() for n in names}
    worst = max(errors, key=lambda name: errors[name])
    return "" if errors[worst] < TOLERANCE else f"pose of {worst} by {errors[worst]:.2g}"


def heavier(
    mass: float, centre: np.ndarray, there: Poses, model: Any, state: Any
) -> str:  # Any: mujoco has no types
    """What differs in mass or centre of mass, m relative to the first common link."""
    ours = float(model.body_mass.sum())
    if abs(ours - mass) > TOLERANCE * mass:
        return f"mass {ours:.6g} instead of {mass:.6g} kg"
    here = poses(model, state)
    first = next(name for name in there if name in here and name not in ("", "world", "universe"))
    mine = np.average(state.xipos, axis=0, weights=model.body_mass)
    a = np.linalg.inv(there[first]) @ [*centre, 1.0]
    b = np.linalg.inv(here[first]) @ [*mine, 1.0]
    off = np.abs(a - b).max()
    return "" if off < TOLERANCE * 10 else f"centre of mass by {off:.2g} m"


def in_mujoco(source: Path, built: Path, *, edited: bool) -> str:
    """What differs between two MJCFs; what is not in ours by name is none of the robot."""
    import mujoco

    models = [mujoco.MjModel.from_xml_path(str(path)) for path in (source, built)]
    states = [mujoco.MjData(model) for model in models]
    random = np.random.default_rng(0)
    names = [models[0].joint(i).name for i in range(models[0].njnt)]
    common = [name for name in names if name and named_joint(models[1], name) >= 0]
    if any(names) and not common:
        return "no joint of the source is in ours"
    for _ in range(POSES):
        angles = {name: random.uniform(-1.0, 1.0) for name in common}
        for model, state in zip(models, states, strict=True):
            mujoco.mj_resetData(model, state)
            state.qpos[:] = 0.0
            upright(model, state)
            for name, angle in angles.items():
                index = named_joint(model, name)
                if model.jnt_type[index] in (2, 3):  # which count from `ref`
                    at = model.jnt_qposadr[index]
                    state.qpos[at] = model.qpos0[at] + angle
            mujoco.mj_forward(model, state)
        there, here = (poses(m, s) for m, s in zip(models, states, strict=True))
        if differs := unlike(there, here):
            return differs
        robot = [i for i in range(1, models[0].nbody) if named_body(models[0], i) in here]
        masses = models[0].body_mass[robot]
        if not edited and masses.sum():
            centre = np.average(states[0].xipos[robot], axis=0, weights=masses)
            if differs := heavier(float(masses.sum()), centre, there, models[1], states[1]):
                return differs
    return "equal"


def named_body(model: Any, index: int) -> str:  # Any: mujoco has no types
    """Return the name of a body, or of the nearest one above it that has a name."""
    while index and not model.body(index).name:
        index = int(model.body_parentid[index])
    return str(model.body(index).name) if index else ""


def named_joint(model: Any, name: str) -> int:  # Any: mujoco has no types
    import mujoco

    return int(mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name))


# --- meshes ---------------------------------------------------------------------------------


def meshes(source: Path, urdf: Path, find: Callable[[str], Path | None]) -> list[str]:
    """The link whose meshes differ most in area or size, by a reader that is not ours."""
    try:
        there = links(source, find)
        here = links(urdf, lambda uri: urdf.parent / uri)
    except Exception as error:  # what a foreign reader raises has no end
        return [f"not judged: meshes: {type(error).__name__}: {str(error)[:80]}"]
    worst, words = 1.0, ""
    for name, (area, size) in there.items():
        mine, extent = here.get(name, (0.0, np.zeros(3)))
        off = max(
            abs(mine - area) / max(area, 1e-9) / AREA,
            float(np.abs(extent - size).max()) / max(float(size.max()), 1e-9) / SIZE,
        )
        if off > worst:
            sizes = " x ".join(f"{v:.3g}" for v in extent), " x ".join(f"{v:.3g}" for v in size)
            worst = off
            words = (
                f"meshes of {name}: {mine:.4g} instead of {area:.4g} m2, "
                f"{sizes[0]} instead of {sizes[1]} m"
            )
    return [words] if words else []


def links(urdf: Path, find: Callable[[str], Path | None]) -> Mapping[str, tuple[float, np.ndarray]]:
    """Area in m2 and sorted size in m of what is seen of each link that has meshes."""
    found: dict[str, tuple[float, np.ndarray]] = {}
    for link in fromstring(readable(urdf)).iter("link"):  # noqa: S314 - the runner's own copy
        seen: list[Measured] = []
        for visual in link.findall("visual"):
            mesh = visual.find("geometry/mesh")
            path = find(mesh.get("filename", "").strip()) if mesh is not None else None
            if mesh is None or path is None:
                continue
            corners, counts = polygons(path)
            scale = [float(v) for v in (mesh.get("scale") or "1").split()]
            scale = scale[:3] if len(set(scale)) == 1 else scale
            X = origin(visual.find("origin"))
            corners = corners * scale @ X[:3, :3].T + X[:3, 3]
            seen.append(polygons_measured(corners, counts))
        if seen:
            lower = np.min([shape.lower for shape in seen], axis=0)
            upper = np.max([shape.upper for shape in seen], axis=0)
            area = sum(shape.area for shape in seen)
            found[link.get("name", "")] = area, np.sort(upper - lower)
    return found


def origin(element: Element | None) -> np.ndarray:
    """(4, 4), from `xyz` and `rpy` about fixed axes."""
    from scipy.spatial.transform import Rotation

    X = np.eye(4)
    if element is not None:
        X[:3, 3] = [float(v) for v in (element.get("xyz") or "0 0 0").split()]
        angles = [float(v) for v in (element.get("rpy") or "0 0 0").split()]
        X[:3, :3] = Rotation.from_euler("xyz", angles).as_matrix()
    return X
