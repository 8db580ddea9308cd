"""`share_mass: {link}`: give massless links between joints a mass too small for motion to show."""

from __future__ import annotations

import re
from dataclasses import replace

from pydantic import Field

from assetbuild.engine.step import Files
from assetbuild.errors import RecipeError
from assetbuild.findings import Finding, Rule
from assetbuild.plugin_types import Edit, Edited
from assetbuild.recipe_types import Pattern, Positive
from assetbuild.robot.chains import Chain, find_chains, is_massless, rigid_with
from assetbuild.robot.inertia import mass_data, principal_moments
from assetbuild.robot.model import Inertial, Tree
from assetbuild.robot.shapes import SourceShapes

SHARE = 1e-9
"""Share of the body's mass and of its least moment that each link gets. PhysX refuses a body
without inertia, and agrees with MuJoCo on the motion for shares down to 1e-12."""
LEAST = 1e-14
"""kg m2; the moments of a new mass are no less."""

SHARE_MASS = Rule(
    "edit.share_mass",
    "info",
    "a little mass was moved to massless links between joints",
    "nothing",
)


class ShareMass(Edit):
    """For PhysX, which wants mass on every body: three hinges that make a ball joint.

    Each link gets 1e-9 of the mass and of the least moment of the body at the end, which changes
    the energies by no more. Newton gives a body with a moment below 1e-10 kg m2 one of 1e-6: state
    `moments` for it; the mass is then the same share.
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
                shared, finding = _shared(tree, chain, links, self.moments)
                inertials |= shared
                findings.append(finding)
        return Edited(tree.with_inertials(inertials), shapes, tuple(findings))


def _shared(
    tree: Tree, chain: Chain, links: list[str], stated: float | None
) -> tuple[dict[str, Inertial], Finding]:
    """New mass properties of the links and of the body at the end of the chain, in words too.

    stated: the moments of the links, kg m2.
    """
    solid = chain.body
    if is_massless(tree.by_body[solid]):
        masses = {
            name: made.mass_kg if (made := tree.by_body[name].inertial) else 0.0
            for name in rigid_with(tree, solid)
        }
        solid = max(masses, key=lambda name: masses[name])
    rest = tree.by_body[solid].inertial
    least = principal_moments(rest.inertia_com_kg_m2)[0] if rest else 0.0
    if rest is None or min(rest.mass_kg, least) <= 0.0:
        raise RecipeError(
            f"share_mass: link `{solid}` has no mass, or a principal moment that is not positive",
            hint="repair them first, by an edit above this one",
        )
    moment = stated or max(SHARE * least, LEAST)
    mass = moment / least * rest.mass_kg
    made = Inertial(mass, (0.0, 0.0, 0.0), (moment, moment, moment, 0.0, 0.0, 0.0))
    if mass * len(links) >= rest.mass_kg:
        raise RecipeError(
            f"share_mass: `moments` of {moment:g} kg m² are those of the whole link `{solid}`",
            hint="leave `moments` out, or state less",
        )
    after = replace(rest, mass_kg=rest.mass_kg - mass * len(links))
    moved = ", ".join(f"{mass:.3g} kg to {link}" for link in links)
    share = moment / least
    same = share <= 2.0 * SHARE or moment <= LEAST
    motion = (
        "the motion is the same"
        if same
        else f"their moments, {moment:.3g} kg m², add {share:.2g} of its least to the motion"
    )
    finding = SHARE_MASS(
        f"link {solid}",
        f"mass {rest.mass_kg:.6g} -> {after.mass_kg:.6g} kg: {moved}; {motion}",
        data={**mass_data(rest, after), "links": tuple(links)},
    )
    return {**dict.fromkeys(links, made), solid: after}, finding
