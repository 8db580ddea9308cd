"""`share_mass: {link}`: give massless links between joints some mass that no motion can tell."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
from pydantic import Field

from assetbuild.engine.step import Files
from assetbuild.errors import RecipeError
from assetbuild.findings import Finding, Rule
from assetbuild.plugin_types import Edit, Edited
from assetbuild.recipe_types import Pattern, Positive
from assetbuild.robot.chains import Chain, find_chains, is_massless
from assetbuild.robot.inertia import combine, principal_moments, pseudo_inertia
from assetbuild.robot.model import Body, Inertial, Joint, Tree
from assetbuild.robot.pose import Array, Vec3, vec3
from assetbuild.robot.shapes import SourceShapes

SHARE = 0.1
"""Share of the mass that can be taken out of the body before its tensor becomes impossible."""
BALL = 1e-9
"""Moment of each new mass, as a share of the body's least: no engine takes a point of 0. Where no
point is still, the share of its mass too: PhysX moves the links as MuJoCo does down to 1e-12."""
LEAST = 1e-14
"""kg m2; the moments of a new mass are no less."""
MEETS_M = 1e-9
"""Axes that pass a point at this distance pass through it."""

SHARE_MASS = Rule(
    "edit.share_mass",
    "info",
    "mass was moved to massless links between joints, where it changes no motion",
    "nothing",
)


class ShareMass(Edit):
    """For PhysX, which wants mass on every body: three hinges that make a ball joint.

    A point where the axes of all hinges below a link meet does not move when they turn, so a mass
    there moves alike on the link and on the body at the end. The edit moves such a mass to the
    link; kinetic and potential energy stay as they are, but for a share of 1e-9 of the moments,
    which keeps the new mass from being a point. Where there is no such point (the axes do not
    meet, or a joint slides), the link gets 1e-9 of the body's mass instead, which changes the
    energies by no more. Newton gives a body with a moment below 1e-10 kg m2 one of 1e-6: state
    `moments` for it.
    """

    link: Pattern = Field(description="massless links between two joints, by whole name")
    moments: Positive | None = Field(
        None, description="kg m2, of each link; without it 1e-9 of the body's least"
    )

    def edit(self, tree: Tree, shapes: SourceShapes, files: Files) -> Edited:
        """See `Edit`."""
        chains = find_chains(tree, {shape.link for shape in shapes.shapes})
        between = {link for chain in chains for link in chain.between}
        for body in tree.bodies:
            if re.fullmatch(self.link, body.name) and body.name not in between:
                raise RecipeError(
                    f"share_mass: link `{body.name}` is no massless link between two joints",
                    hint="use `set_inertia` or `inertia_from_geometry`",
                )
        inertials: dict[str, Inertial] = {}
        findings: list[Finding] = []
        for chain in chains:
            links = [link for link in chain.between if re.fullmatch(self.link, link)]
            if links:
                shared = _shared(tree, chain, links, self.moments)
                inertials |= shared
                findings.append(_finding(tree, links, shared))
        bodies = tuple(
            replace(body, inertial=inertials.get(body.name, body.inertial)) for body in tree.bodies
        )
        return Edited(replace(tree, bodies=bodies), shapes, tuple(findings))


def _shared(
    tree: Tree, chain: Chain, links: list[str], stated: float | None
) -> dict[str, Inertial]:
    """New mass properties of the links and of the body at the end of the chain.

    stated: the moments of the links, kg m2.
    """
    held = _held(tree, chain.body)
    solid = held[-1].child if held else chain.body
    rest = _inertial(tree.by_body[solid])
    moment = stated or max(BALL * principal_moments(rest.inertia_com_kg_m2)[0], LEAST)
    ball = (moment, moment, moment, 0.0, 0.0, 0.0)
    made: dict[str, Inertial] = {}
    for link in links:
        below = chain.joints[chain.between.index(link) + 1 :]
        point = meeting_point(below)
        if point is None:
            made[link] = Inertial(BALL * rest.mass_kg, (0.0, 0.0, 0.0), ball)
            rest = replace(rest, mass_kg=rest.mass_kg - made[link].mass_kg)
            continue
        X_link_body = Chain((*below, *held), ()).pose_in_parent
        in_body = vec3(X_link_body.inverse().apply(point))
        homogeneous = np.array([*in_body, 1.0])
        # J - m p pᵀ stays positive definite up to m = 1 / (pᵀ J⁻¹ p), J the pseudo-inertia.
        most = 1.0 / float(homogeneous @ np.linalg.solve(pseudo_inertia(rest), homogeneous))
        mass = SHARE * most / len(links)
        made[link] = Inertial(mass, point, ball)
        # The body less a point mass: one body with a part of negative mass.
        rest = combine([rest, Inertial(-mass, in_body, (0.0,) * 6)])
    return made | {solid: rest}


def _held(tree: Tree, body: str) -> tuple[Joint, ...]:
    """The fixed joints from a body without mass to the heaviest one that they hold to it."""
    if not is_massless(tree.by_body[body]):
        return ()
    ways: list[tuple[Joint, ...]] = [()]
    for way in ways:  # grows while it is walked
        end = way[-1].child if way else body
        ways += [(*way, j) for j in tree.joints if j.parent == end and j.kind == "fixed"]
    ends = {way: tree.by_body[way[-1].child].inertial for way in ways if way}
    return max(ends, key=lambda way: made.mass_kg if (made := ends[way]) else 0.0)


def _inertial(body: Body) -> Inertial:
    inertial = body.inertial
    if inertial is None or np.linalg.eigvalsh(pseudo_inertia(inertial))[0] <= 0.0:
        raise RecipeError(
            f"share_mass: the mass properties of link `{body.name}` are not those of a solid body",
            hint="repair them first, by an edit above this one",
        )
    return inertial


def meeting_point(joints: tuple[Joint, ...]) -> Vec3 | None:
    """The point where the axes of these joints meet, in the frame above the first, m.

    Least squares on the distances to the lines; of a shared line, the point nearest to the first
    joint's origin. None where they do not meet, or one slides: every point of the link moves.
    """
    if not all(joint.kind in ("revolute", "continuous") for joint in joints):
        return None
    poses = [Chain(joints[: i + 1], ()).pose_in_parent for i in range(len(joints))]
    lines = [
        (np.asarray(pose.xyz), pose.rotation @ np.asarray(joint.axis))
        for pose, joint in zip(poses, joints, strict=True)
    ]
    A = np.vstack([np.eye(3) - np.outer(axis, axis) for _, axis in lines])
    b = np.concatenate(
        [(np.eye(3) - np.outer(axis, axis)) @ (o - lines[0][0]) for o, axis in lines]
    )
    point: Array = lines[0][0] + np.linalg.lstsq(A, b, rcond=1e-9)[0]
    distances = [np.linalg.norm(np.cross(axis, point - origin)) for origin, axis in lines]
    return vec3(point) if max(distances) <= MEETS_M else None


def _finding(tree: Tree, links: list[str], shared: dict[str, Inertial]) -> Finding:
    solid = next(name for name in shared if name not in links)
    before, after = _inertial(tree.by_body[solid]), shared[solid]
    moved = ", ".join(f"{shared[link].mass_kg:.3g} kg to {link}" for link in links)
    moment = shared[links[0]].inertia_com_kg_m2[0]
    share = moment / principal_moments(before.inertia_com_kg_m2)[0]
    same = share <= 2.0 * BALL or moment <= LEAST
    motion = (
        "the motion is the same"
        if same
        else f"their moments, {moment:.3g} kg m², add {share:.2g} of its least to the motion"
    )
    return SHARE_MASS(
        f"link {solid}",
        f"mass {before.mass_kg:.6g} -> {after.mass_kg:.6g} kg: {moved}, where the axes of "
        f"the joints between meet, or 1e-9 of the whole; {motion}",
        data={
            "before_kg": before.mass_kg,
            "after_kg": after.mass_kg,
            "before_m": before.com_m,
            "after_m": after.com_m,
            "before_kg_m2": before.inertia_com_kg_m2,
            "after_kg_m2": after.inertia_com_kg_m2,
            "links": tuple(links),
        },
    )
