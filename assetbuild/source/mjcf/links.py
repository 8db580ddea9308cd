"""Bodies, joints and sites of a compiled MJCF as links and joints of the Robot.

In the Robot a body's frame is the frame of the joint above it, all joints at 0. MJCF puts a joint
anywhere in its body (`pos`), several on one body, and calls any value the rest (`ref`). So

- the frame of a body whose last joint has a `pos` moves to that joint's anchor; its old frame
  stays as a frame `<body>_origin`;
- several joints on one body become a row of links without mass (`robot.chains` undoes it);
- positions count from `ref`.

A site is a link without mass on a fixed joint, which merging makes a frame.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from assetbuild.errors import SourceError
from assetbuild.findings import Finding, Rule
from assetbuild.robot.inertia import Tensor, rotate_tensor
from assetbuild.robot.model import Base, Body, Inertial, Joint, JointKind, Limits
from assetbuild.robot.pose import IDENTITY, Pose, Vec3, normalised_quat, vec3
from assetbuild.source.mjcf.text import DROPPED, bodies, error_at, parts

if TYPE_CHECKING:
    from lxml.etree import _Element


Model = Any  # mujoco.MjModel: its extension module has no types
FREE, BALL, SLIDE, HINGE = 0, 1, 2, 3
WORLD = "world"

JOINT_POS = Rule(
    "mjcf.joint_pos",
    "info",
    "a joint is not at the origin of its body: the link's frame was moved to the joint, and the "
    "old one became a frame `<body>_origin`",
    "nothing",
)
JOINT_REF = Rule(
    "mjcf.joint_ref",
    "info",
    "a joint of the source's MJCF has a `ref`: positions, ranges and commands are counted from "
    "it here",
    "subtract it in controllers that were written for the source",
)
BASE = Rule(
    "mjcf.base",
    "info",
    "the recipe's `base` differs from the source's",
    "omit `base` to keep the source's",
)
RENAMED = Rule(
    "mjcf.renamed",
    "info",
    "a site has the name of a body; frames and bodies share one set of names here",
    "use the new name",
)


@dataclass
class Links:
    """What the bodies of an MJCF amount to.

    kept: links that are bodies of the source with mass; the others only name places.
    shift: where the frame of a link stands in the frame of the body of that name, m.
    rest: `ref` of each joint, rad or m. sites: link by site.
    mount: pose of the root body in the world, in the source. free_joint: its name, or "".
    """

    base: Base
    root: str
    bodies: list[Body] = field(default_factory=list)
    joints: list[Joint] = field(default_factory=list)
    kept: list[str] = field(default_factory=list)
    shift: dict[str, Vec3] = field(default_factory=dict)
    rest: dict[str, float] = field(default_factory=dict)
    sites: dict[str, str] = field(default_factory=dict)
    mount: Pose = IDENTITY
    free_joint: str = ""
    findings: list[Finding] = field(default_factory=list)

    def in_link(self, body: str, pose: Pose) -> Pose:
        """A pose given in the frame of a body of the source, in the frame of its link."""
        return Pose(_minus(pose.xyz, self.shift[body]), pose.quat)


def read_links(world: _Element, model: Model, base: Base | None) -> Links:
    """All bodies below the world; SourceError for what the Robot cannot be.

    base: what the recipe says of the root; None = what the source says.
    """
    tops = list(parts(world, "body"))
    robot = [top for top in tops if top.get("mocap") != "true"]
    if not robot:
        raise error_at(world, "a robot without bodies", "is this the file of the robot?")
    links = _root(robot, model, base)
    for top in tops:
        if top not in robot:
            links.findings.append(_dropped_mocap(top))
    own = {id(top) for top in tops if top not in robot}
    for body, parent in bodies(world):
        if id(body) in own or (parent not in links.shift and parent != WORLD):
            continue  # a mocap body, or below one
        _add_body(links, body, parent, model)
    _add_sites(links, world, model)
    return links


def _root(tops: list[_Element], model: Model, base: Base | None) -> Links:
    """The root body of the source, or the world where several bodies or a joint hang on it."""
    free = [top for top in tops if _joint_kinds(top, model) == [FREE]]
    if len(tops) > 1 and free:
        hint = "one recipe builds one robot: give the file of the robot, not that of the scene"
        raise error_at(free[-1], f"{len(tops)} bodies in the world, some of them free", hint)
    top, name = tops[0], str(tops[0].get("name"))
    if len(tops) > 1 or (not free and _joint_kinds(top, model)):
        if base == "floating":
            hint = "write `base: fixed`"
            raise error_at(top, "joints connect the robot to the world: it cannot float", hint)
        links = Links("fixed", WORLD)
        links.bodies.append(Body(WORLD))
        links.kept.append(WORLD)
        links.shift[WORLD] = (0.0, 0.0, 0.0)
        return links
    stated: Base = "floating" if free else "fixed"
    links = Links(
        base or stated, name, mount=_pose(model.body_pos, model.body_quat, _id(model, "body", name))
    )
    if free:
        links.free_joint = str(model.joint(int(model.body(name).jntadr[0])).name)
    if base not in (None, stated):
        links.findings.append(_other_base(name, links.base))
    return links


def _add_body(links: Links, element: _Element, parent: str, model: Model) -> None:
    name = str(element.get("name"))
    index = _id(model, "body", name)
    first, count = int(model.body_jntadr[index]), int(model.body_jntnum[index])
    joints = list(range(first, first + count))
    kinds = [int(model.jnt_type[joint]) for joint in joints]
    _refuse(element, name, kinds, name == links.root)
    if name == links.root:
        joints = []
    anchors = [vec3(model.jnt_pos[joint]) for joint in joints]
    links.shift[name] = anchors[-1] if anchors else (0.0, 0.0, 0.0)
    if name != links.root:
        made = _joints_to(links, name, parent, joints, anchors, model)
        links.joints += made
        links.bodies += [Body(joint.child) for joint in made[:-1]]
    links.bodies.append(Body(name, _inertial(links, element, index, name, model)))
    if links.bodies[-1].inertial is not None:
        links.kept.append(name)
    if links.shift[name] != (0.0, 0.0, 0.0):
        _keep_origin(links, name)


def _joints_to(
    links: Links, name: str, parent: str, joints: list[int], anchors: list[Vec3], model: Model
) -> list[Joint]:
    """The joints from the parent's link down to the link of a body."""
    index = _id(model, "body", name)
    X_parent_body = links.in_link(parent, _pose(model.body_pos, model.body_quat, index))
    if not joints:
        taken = {str(model.joint(i).name) for i in range(model.njnt)}
        fixed = f"{name}_fixed"
        while fixed in taken:
            fixed += "_"
        return [Joint(fixed, "fixed", parent, name, X_parent_body)]
    made, above, X = [], parent, X_parent_body @ Pose(anchors[0])
    for number, joint in enumerate(joints):
        if number:
            X = Pose(_minus(anchors[number], anchors[number - 1]))
        own = str(model.joint(joint).name)
        below = name if number == len(joints) - 1 else f"{name}_{own}"
        made.append(_joint(links, own, above, below, X, joint, model))
        above = below
    return made


def _joint(
    links: Links, name: str, parent: str, child: str, X: Pose, index: int, model: Model
) -> Joint:
    slide, dof = int(model.jnt_type[index]) == SLIDE, int(model.jnt_dofadr[index])
    ref = float(model.qpos0[int(model.jnt_qposadr[index])])
    if ref:
        links.rest[name] = ref
        links.findings.append(_counted_from(name, ref, "m" if slide else "rad"))
    limited = bool(model.jnt_limited[index])
    lower, upper = (float(v) - ref for v in model.jnt_range[index])
    kind: JointKind = "prismatic" if slide else "revolute" if limited else "continuous"
    return Joint(
        name=name,
        kind=kind,
        parent=parent,
        child=child,
        X_parent_joint=X,
        axis=vec3(model.jnt_axis[index]),
        limits=Limits(lower, upper) if limited else Limits(),
        damping=float(model.dof_damping[dof]),
        friction=float(model.dof_frictionloss[dof]),
    )


def _inertial(
    links: Links, element: _Element, index: int, name: str, model: Model
) -> Inertial | None:
    mass = float(model.body_mass[index])
    if mass == 0.0 and not model.body_inertia[index].any():
        return None
    xx, yy, zz = (float(v) for v in model.body_inertia[index])
    w, x, y, z = (float(v) for v in model.body_iquat[index])
    tensor = rotate_tensor((xx, yy, zz, 0.0, 0.0, 0.0), normalised_quat((w, x, y, z)))
    com = _minus(vec3(model.body_ipos[index]), links.shift[name])
    return Inertial(mass, com, _as_stated(element, tensor))


def _as_stated(body: _Element, compiled: Tensor) -> Tensor:
    """`fullinertia` by its own numbers: MuJoCo's diagonalisation of it is good to 3e-6 in 3.11.

    Only where both agree to that: a compiler option may have changed the tensor.
    """
    inertial = body.find("inertial")
    stated = inertial.get("fullinertia") if inertial is not None else None
    if stated is None:
        return compiled
    xx, yy, zz, xy, xz, yz = (float(word) for word in stated.split())
    exact = (xx, yy, zz, xy, xz, yz)
    close = np.allclose(exact, compiled, rtol=0.0, atol=1e-5 * max(map(abs, exact)))
    return exact if close else compiled


def _keep_origin(links: Links, name: str) -> None:
    shift = links.shift[name]
    origin = f"{name}_origin"
    links.bodies.append(Body(origin))
    back = Pose(_minus((0.0, 0.0, 0.0), shift))
    links.joints.append(Joint(f"{origin}_fixed", "fixed", name, origin, back))
    links.findings.append(
        JOINT_POS(
            f"link {name}",
            f"its joint stands at {_words(shift)} m in the body: the link's frame moved there",
            f"the old frame lives on as `{origin}`",
            data={"pos_m": shift},
        )
    )


def _add_sites(links: Links, world: _Element, model: Model) -> None:
    taken = {body.name for body in links.bodies}
    for element, body in [
        (site, str(owner.get("name")))
        for owner, _ in bodies(world)
        for site in parts(owner, "site")
    ]:
        if body not in links.shift:
            continue
        site = str(element.get("name"))
        name = site
        while name in taken:
            name += "_site"
        taken.add(name)
        links.sites[site] = name
        if name != site:
            links.findings.append(_renamed_site(site, name))
        index = _id(model, "site", site)
        pose = links.in_link(body, _pose(model.site_pos, model.site_quat, index))
        links.bodies.append(Body(name))
        links.joints.append(Joint(f"{name}_fixed", "fixed", body, name, pose))


# --- refusals and findings ------------------------------------------------------------------


def _refuse(element: _Element, name: str, kinds: list[int], is_root: bool) -> None:
    if BALL in kinds:
        hint = "write it as three hinges on the body, about x, y and z"
        raise error_at(element, f"body `{name}`: ball joints are not read", hint)
    if FREE in kinds and not is_root:
        hint = "one recipe builds one robot; its root alone may float"
        raise error_at(element, f"body `{name}`: a free joint inside the robot", hint)


def _joint_kinds(body: _Element, model: Model) -> list[int]:
    index = _id(model, "body", str(body.get("name")))
    first, count = int(model.body_jntadr[index]), int(model.body_jntnum[index])
    return [int(model.jnt_type[joint]) for joint in range(first, first + count)]


def _dropped_mocap(top: _Element) -> Finding:
    return DROPPED(
        f"link {top.get('name')}",
        f"the mocap body `{top.get('name')}` and all on it was left out",
        "it belongs to a scene; nothing moves it in a robot",
        severity="warning",
        data={"element": "body mocap", "count": 1},
    )


def _other_base(name: str, base: Base) -> Finding:
    now, before = ("floats", "is fixed") if base == "floating" else ("is fixed", "floats")
    return BASE(
        f"link {name}",
        f"the recipe says `base: {base}`: the root {now}; in the source it {before}",
        "leave `base` out to keep what the source says",
        data={"base": base},
    )


def _counted_from(joint: str, ref: float, unit: str) -> Finding:
    return JOINT_REF(
        f"joint {joint}",
        f"its positions count from `ref` = {ref:g} {unit}: 0 here is {ref:g} {unit} in the source",
        "subtract it from positions and commands of the source's controllers",
        data={"ref": ref},
    )


def _renamed_site(site: str, name: str) -> Finding:
    return RENAMED(
        f"link {site}",
        f"a body has the name of the site `{site}`: the frame is called `{name}`",
        "bodies and frames share their names in URDF and USD",
        data={"before": site, "after": name},
    )


# --- small things ---------------------------------------------------------------------------


def _id(model: Model, kind: str, name: str) -> int:
    try:
        return int(getattr(model, kind)(name).id)
    except KeyError:
        raise SourceError(f"{kind} `{name}` is not in the compiled model") from None


def _pose(positions: Any, quats: Any, index: int) -> Pose:  # Any: arrays of the model
    w, x, y, z = (float(v) for v in quats[index])
    return Pose(vec3(positions[index]), normalised_quat((w, x, y, z)))


def _minus(a: Vec3, b: Vec3) -> Vec3:
    """Negative zeros become zero; subtracting zeros changes no bit."""
    return vec3([x - y for x, y in zip(a, b, strict=True)])


def _words(vector: Vec3) -> str:
    return "(" + ", ".join(f"{v:g}" for v in vector) + ")"


def depth_first_of(links: Links) -> Iterator[Body]:
    """The bodies as `Tree` wants them."""
    from assetbuild.robot.tree import depth_first

    order, _ = depth_first(links.root, links.joints)
    by_name: Mapping[str, Body] = {body.name: body for body in links.bodies}
    return (by_name[name] for name in order)
