"""Surfaces that no robot has, and softness that MuJoCo does not take as it is stated."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from assetbuild.findings import Finding, Rule
from assetbuild.robot.model import Control
from assetbuild.robot.shapes import Shapes

SLIDING = (0.2, 3.0)
"""Coefficients of sliding friction between which real pairs of dry surfaces lie: Teflon on steel
and polished wet metal just below, racing tyres and gecko-like grippers just above."""
SHOWN = 5
DEFAULT_S = 0.02
"""MuJoCo's time constant of a constraint that states none."""
SAFE_STEPS = 2
"""MuJoCo's `refsafe`: a shorter time constant is raised to so many time steps, without a word."""

FRICTION = Rule(
    "contact.friction",
    "warning",
    "a surface's sliding friction is implausibly small or large (outside 0.2 to 3)",
    "rubber feet have 0.6 to 1.2, metal and plastic 0.2 to 0.6; a surface that is meant to be so "
    "needs a line in `rules`, or `condim: 1` if it has no friction",
)

RAISED = Rule(
    "contact.softness",
    "info",
    "MuJoCo takes two time steps in place of a shorter time constant (`solref`)",
    "a smaller `simulation.timestep`, or a longer time constant",
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
        names, listed = list(found), _listed(list(found), "links")
        slides = friction < SLIDING[0]
        yield FRICTION(
            f"link {names[0]}",
            f"sliding friction of {friction:.4g} is {'below' if slides else 'above'} the plausible "
            f"range of {SLIDING[0]:g} to {SLIDING[1]:g}: {listed}",
            hint="0.08 for 0.8? `contact.friction` is [sliding, torsional (m), rolling (m)]",
            data={"friction": friction, "lower": SLIDING[0], "upper": SLIDING[1]},
        )
    yield from _raised(shapes, control)


def _raised(shapes: Shapes, control: Control) -> Iterator[Finding]:
    """One for each time constant that is too short for the time step.

    A surface without priority is mixed with what it touches: the floor's, which is the default.
    """
    own, least = dict(control.contacts), SAFE_STEPS * control.simulation.timestep
    stated: dict[float, dict[str, None]] = {}
    for shape in shapes.of("collision"):
        surface = own.get(shape.name, control.contact)
        constant = surface.solref[0] if surface.solref and surface.priority else DEFAULT_S
        stated.setdefault(constant, {})[f"link {shape.link}"] = None
    for loop in control.loops:
        stated.setdefault(loop.solref[0], {})[f"loop {loop.name}"] = None
    for constant, found in stated.items():
        if 0.0 < constant < least:
            names = list(found)
            yield RAISED(
                names[0],
                f"MuJoCo takes {least:g} s, two time steps, in place of the time constant "
                f"{constant:g} s: {_listed(names, 'places')}",
                hint=f"`simulation: {{timestep: {constant / SAFE_STEPS:g}}}`, or `solref: "
                f"[{least:g}, ...]`, which says what happens",
                data={"stated_s": constant, "taken_s": least, "places": len(names)},
            )


def _listed(names: Sequence[str], what: str) -> str:
    shown = ", ".join(f"`{name}`" for name in names[:SHOWN])
    return shown + (f" and {len(names) - SHOWN} more {what}" if len(names) > SHOWN else "")
