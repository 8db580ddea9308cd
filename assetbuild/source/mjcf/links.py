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

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from assetbuild.findings import Finding, Rule
from assetbuild.robot.inertia import Tensor, rotate_tensor
from assetbuild.robot.model import Base, Body, Inertial, Joint, JointKind, Limits, MjcfOnly
from assetbuild.robot.pose import IDENTITY, Pose, Vec3, normalised_quat, vec3
from assetbuild.source.mjcf.compiled import Compiled
from assetbuild.source.mjcf.opaque import element_text
from assetbuild.source.mjcf.scenery import hangs, kind_of
from assetbuild.source.mjcf.text import WORLD, Element, bodies, error_at, parts

FREE, BALL, SLIDE = 0, 1, 2
ORIGIN: Vec3 = (0.0, 0.0, 0.0)

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
    "leave `base` out to keep what the source says",
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

    kept: links that are bodies of the source with mass, or that touch on their own; the others
    only name places.
    shift: where the frame of a link stands in the frame of the body of that name, m.
    rest: `ref` of each joint, rad or m. sites: link by site.
    mount: pose of the root body in the world, in the source. free_joint: its name, or "".
    mjcf_only, findings: of the bodies and of all that is read after them.
    """

    source: Compiled
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
    mjcf_only: list[MjcfOnly] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)

    def in_link(self, body: str, pose: Pose) -> Pose:
        """A pose given in the frame of a body of the source, in the frame of its link."""
        return Pose(_minus(pose.xyz, self.shift.get(body, ORIGIN)), pose.quat)

    def renamed(self, stated: Mapping[str, str]) -> dict[str, str]:
        """The attributes of an element with sites by their names in the Robot."""
        sites = self.sites
        return {
            k: sites.get(v, v) if kind_of(k, stated) == "site" else v for k, v in stated.items()
        }

    def keep(self, place: str, tag: str, stated: Mapping[str, str], owner: str = "") -> None:
        """Leave attributes to MJCF in alphabetical order, if there are any."""
        if stated:
            text = element_text(tag, dict(sorted(stated.items())))
            self.mjcf_only.append(MjcfOnly(place, text, owner))


def read_links(source: Compiled, base: Base | None) -> Links:
    """All bodies below the world; SourceError for what the Robot cannot be.

    base: what the recipe says of the root; None = what the source says.
    """
    world = source.bodies[0][0]
    tops = list(parts(world, "body"))
    if not tops:
        raise error_at(world, "a robot without bodies", "is this the file of the robot?")
    links = _root(tops, source, base)
    for body, parent in bodies(world):
        _add_body(links, body, parent)
    links.kept += _touching_apart(links)
    _add_sites(links)
    return links


def _root(tops: list[Element], source: Compiled, base: Base | None) -> Links:
    """The root body of the source, or the world where bodies, a joint or a tendon hang on it."""
    name = str(tops[0].get("name"))
    if hangs(source.root, tops, source.classes):
        if base == "floating":
            message = "joints or tendons connect the robot to the world: it cannot float"
            raise error_at(tops[0], message, "write `base: fixed`")
        bodies = [Body(WORLD)]
        return Links(source, "fixed", WORLD, bodies, kept=[WORLD], shift={WORLD: ORIGIN})
    free = source.joint_kinds(name) == [FREE]
    stated: Base = "floating" if free else "fixed"
    links = Links(source, base or stated, name, mount=source.pose_of("body", name))
    if free:
        links.free_joint = str(source.model.joint(source.joints_of(name)[0]).name)
    if base not in (None, stated):
        now, before = ("floats", "is fixed") if base == "floating" else ("is fixed", "floats")
        message = f"the recipe says `base: {base}`: the root {now}; in the source it {before}"
        links.findings.append(BASE(f"link {name}", message, data={"base": links.base}))
    return links


def _add_body(links: Links, element: Element, parent: str) -> None:
    name, model = str(element.get("name")), links.source.model
    if FREE in links.source.joint_kinds(name) and name != links.root:
        hint = "one recipe builds one robot; its root alone may float"
        raise error_at(element, f"body `{name}`: a free joint inside the robot", hint)
    joints = links.source.joints_of(name) if name != links.root else ()
    anchors = [vec3(model.jnt_pos[joint]) for joint in joints]
    links.shift[name] = anchors[-1] if anchors else ORIGIN
    if name != links.root:
        made = _joints_to(links, name, parent, joints, anchors)
        links.joints += made
        links.bodies += [Body(joint.child) for joint in made[:-1]]
    links.bodies.append(Body(name, _inertial(links, element, name)))
    if links.bodies[-1].inertial is not None:
        links.kept.append(name)
    if links.shift[name] != ORIGIN:
        _keep_origin(links, name)


def _joints_to(
    links: Links, name: str, parent: str, joints: Sequence[int], anchors: list[Vec3]
) -> list[Joint]:
    """The joints from the parent's link down to the link of a body."""
    model = links.source.model
    X_parent_body = links.in_link(parent, links.source.pose_of("body", name))
    if not joints:
        fixed = f"{name}_fixed"
        while fixed in {str(model.joint(i).name) for i in range(model.njnt)}:
            fixed += "_"
        return [Joint(fixed, "fixed", parent, name, X_parent_body)]
    made, above, X = [], parent, X_parent_body @ Pose(anchors[0])
    for number, joint in enumerate(joints):
        if number:
            X = Pose(_minus(anchors[number], anchors[number - 1]))
        joint_name = str(model.joint(joint).name)
        below = name if number == len(joints) - 1 else f"{name}_{joint_name}"
        made.append(_joint(links, joint_name, above, below, X))
        above = below
    return made


def _joint(links: Links, name: str, parent: str, child: str, X: Pose) -> Joint:
    joint = links.source.entry("joint", name)
    if int(joint.type[0]) == BALL:  # what brakes it and holds it only MJCF can say
        return Joint(name, "ball", parent, child, X)
    slide, ref = int(joint.type[0]) == SLIDE, float(joint.qpos0[0])
    if ref:
        links.rest[name] = ref
        shown = f"{ref:g} {'m' if slide else 'rad'}"
        message = f"its positions count from `ref` = {shown}: 0 here is {shown} in the source"
        hint = "subtract it from positions and commands of the source's controllers"
        links.findings.append(JOINT_REF(f"joint {name}", message, hint, data={"ref": ref}))
    limited = bool(joint.limited[0])
    lower, upper = (float(v) - ref for v in joint.range)
    kind: JointKind = "prismatic" if slide else "revolute" if limited else "continuous"
    return Joint(
        name=name,
        kind=kind,
        parent=parent,
        child=child,
        X_parent_joint=X,
        axis=vec3(joint.axis),
        limits=Limits(lower, upper) if limited else Limits(),
        damping=float(joint.damping[0]),
        friction=float(joint.frictionloss[0]),
    )


def _inertial(links: Links, element: Element, name: str) -> Inertial | None:
    model, index = links.source.model, links.source.id_of("body", name)
    mass = float(model.body_mass[index])
    if mass == 0.0 and not model.body_inertia[index].any():
        return None
    xx, yy, zz = (float(v) for v in model.body_inertia[index])
    w, x, y, z = (float(v) for v in model.body_iquat[index])
    tensor = rotate_tensor((xx, yy, zz, 0.0, 0.0, 0.0), normalised_quat((w, x, y, z)))
    com = _minus(vec3(model.body_ipos[index]), links.shift[name])
    return Inertial(mass, com, _as_stated(element, tensor))


def _as_stated(body: Element, compiled: Tensor) -> Tensor:
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
    back = Pose(_minus(ORIGIN, shift))
    links.joints.append(Joint(f"{origin}_fixed", "fixed", name, origin, back))
    at = ", ".join(f"{v:g}" for v in shift)
    message = f"its joint stands at ({at}) m in the body: the link's frame moved there"
    hint = f"the old frame lives on as `{origin}`"
    links.findings.append(JOINT_POS(f"link {name}", message, hint, data={"pos_m": shift}))


def _add_sites(links: Links) -> None:
    taken = {body.name for body in links.bodies}
    on_bodies = [(owner, body) for owner, body in links.source.bodies if body in links.shift]
    for element, body in [
        (site, body) for owner, body in on_bodies for site in parts(owner, "site")
    ]:
        site = name = str(element.get("name"))
        while name in taken:
            name += "_site"
        taken.add(name)
        links.sites[site] = name
        if name != site:
            message = f"a body has the name of the site `{site}`: the frame is called `{name}`"
            hint = "bodies and frames share their names in URDF and USD"
            data = {"before": site, "after": name}
            links.findings.append(RENAMED(f"link {site}", message, hint, data=data))
        pose = links.in_link(body, links.source.pose_of("site", site))
        links.bodies.append(Body(name))
        links.joints.append(Joint(f"{name}_fixed", "fixed", body, name, pose))


def _touching_apart(links: Links) -> list[str]:
    """Bodies without mass that touch others than the body that they are fixed to.

    An `<exclude>` names one of both: as one body they would be excluded together.
    """
    model = links.source.model
    solid = model.geom_bodyid[(model.geom_contype | model.geom_conaffinity) != 0]
    names = {str(model.body(int(body)).name) for body in solid}
    above = {joint.child: joint.parent for joint in links.joints if joint.kind == "fixed"}
    passes: dict[str, set[str]] = {}
    for pair in links.source.root.iterfind("contact/exclude"):
        one, other = str(pair.get("body1")), str(pair.get("body2"))
        passes.setdefault(one, set()).add(other)
        passes.setdefault(other, set()).add(one)
    touching = []
    for name in [body.name for body in links.bodies if body.name in names]:
        top = name
        while top not in links.kept and top in above:
            top = above[top]
        if passes.get(name, set()) - {top} != passes.get(top, set()) - {name}:
            touching.append(name)
    return [name for name in touching if name not in links.kept]


def _minus(a: Vec3, b: Vec3) -> Vec3:
    """Negative zeros become zero; subtracting zeros changes no bit."""
    return vec3([x - y for x, y in zip(a, b, strict=True)])
