"""Surfaces that no robot has: more slippery than ice on ice, or stickier than soft rubber."""

from __future__ import annotations

from collections.abc import Iterator

from assetbuild.findings import Finding, Rule
from assetbuild.robot.model import Control
from assetbuild.robot.shapes import Shapes

SLIDING = (0.2, 3.0)
"""Coefficients of sliding friction between which real pairs of dry surfaces lie: Teflon on steel
and polished wet metal just below, racing tyres and gecko-like grippers just above."""
SHOWN = 5

FRICTION = Rule(
    "contact.friction",
    "warning",
    "a surface's sliding friction is implausibly small or large (outside 0.2 to 3)",
    "rubber feet have 0.6 to 1.2, metal and plastic 0.2 to 0.6; a surface that is meant to be so "
    "needs a line in `rules`, or `condim: 1` if it has no friction",
)


def contact_findings(shapes: Shapes, control: Control) -> Iterator[Finding]:
    """One for each value that is outside, with the links that have it."""
    own = dict(control.contacts)
    links: dict[float, dict[str, None]] = {}
    for shape in shapes.of("collision"):
        surface = own.get(shape.name, control.contact)
        touches = surface.mask or surface.partners
        if touches and surface.condim > 1 and not SLIDING[0] <= surface.friction[0] <= SLIDING[1]:
            links.setdefault(surface.friction[0], {})[shape.link] = None
    for friction, found in links.items():
        names = list(found)
        listed = ", ".join(f"`{name}`" for name in names[:SHOWN])
        more = f" and {len(names) - SHOWN} more links" if len(names) > SHOWN else ""
        slides = friction < SLIDING[0]
        yield FRICTION(
            f"link {names[0]}",
            f"sliding friction of {friction:.4g} is {'below' if slides else 'above'} the plausible "
            f"range of {SLIDING[0]:g} to {SLIDING[1]:g}: {listed}{more}",
            hint="0.08 for 0.8? `contact.friction` is [sliding, torsional (m), rolling (m)]",
            data={"friction": friction, "lower": SLIDING[0], "upper": SLIDING[1]},
        )
