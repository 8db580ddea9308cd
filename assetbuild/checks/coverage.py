"""Does what collides lie where the robot is seen? Visual against collision geometry, per body.

Collision methods measure what they make; this measures what will be simulated, whatever it came
from: a kept shape that moved by 3 cm is nobody's result.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from pydantic import Field

from assetbuild.engine.step import Files
from assetbuild.findings import Finding, Rule
from assetbuild.mesh import MESH_MODULES
from assetbuild.mesh.hulls import common_hull, hulls_by_body
from assetbuild.mesh.solid import Distance, beyond_hull
from assetbuild.mesh.triangles import TriangleMesh
from assetbuild.plugin_types import Check, write_figures
from assetbuild.recipe_types import Positive
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.model import Tree
from assetbuild.robot.pose import IDENTITY
from assetbuild.robot.shapes import Role

SHIFT = Rule(
    "coverage.shift",
    "warning",
    "collision geometry is beside the visual geometry of its body",
    "compare their `<origin>` in the source; look at the report's 3D view",
)


Hulls = Mapping[tuple[str, Role], Sequence[TriangleMesh]]
"""(body, role) -> the hull of each of its shapes in the frame of the body, m."""


@dataclass(frozen=True)
class Fit:
    """over_m: how far collision sticks out of the visual hulls of its body and of the next ones;
    shift_m: both ends of the body moved alike, by axis.
    """

    over_m: float
    shift_m: tuple[float, float, float]
    size_m: float

    @property
    def largest_m(self) -> float:
        """Along the axis of the largest shift."""
        return max(map(abs, self.shift_m))


class Coverage(Check):
    """Findings `coverage.*`; figures: a row for each body with both kinds of geometry."""

    shares = True
    usual_s = 2.0
    isolated = True
    preload = MESH_MODULES
    reads = ("tree.json", "shapes.json", "hulls.npz")

    section = "validate"

    max_shift: Positive = Field(
        0.015, description="m: collision geometry beside the visual geometry of its body, warning"
    )
    max_shift_share: Positive = Field(
        0.08, description="the same as a share of the body's size; the larger of the two counts"
    )

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads tree, shapes and the hulls of the meshes."""
        robot = RobotFiles(files.inputs)
        tree, hulls = robot.tree, hulls_by_body(robot)
        names = [body.name for body in tree.bodies]
        both = [n for n in names if (n, "visual") in hulls and (n, "collision") in hulls]
        # The distance from the hull of all that is seen of a body.
        outside = functools.cache(lambda name: beyond_hull(common_hull(hulls[name, "visual"])))
        fits = {name: _fit(tree, hulls, name, outside) for name in both}
        rows = [
            {"body": name, "sticks_out_mm": 1e3 * fit.over_m,
             "shift_mm": [1e3 * v for v in fit.shift_m]}
            for name, fit in fits.items()
        ]  # fmt: skip
        limits = dict.fromkeys(("sticks_out_mm", "shift_mm"), 1e3 * self.max_shift)
        write_figures(files, {"bodies": rows}, limits)
        yield from self._shifts(fits)

    def _limit(self, fit: Fit) -> float:
        return max(self.max_shift, self.max_shift_share * fit.size_m)

    def _shifts(self, fits: Mapping[str, Fit]) -> Iterator[Finding]:
        """One finding for all bodies with an equal shift: four legs share a mistake, or a plan."""
        alike: dict[str, list[str]] = {}
        for name, fit in fits.items():
            if fit.largest_m > self._limit(fit) and fit.over_m > 0.5 * fit.largest_m:
                axis = "xyz"[int(np.argmax(np.abs(fit.shift_m)))]
                shift = f"{_length(fit.largest_m)} along {axis}"
                alike.setdefault(shift, []).append(name)
        for shift, (name, *others) in alike.items():
            fit = fits[name]
            same = f"; the same holds for {', '.join(others)}" if others else ""
            yield SHIFT(
                f"link {name}",
                f"its collision geometry lies {shift} from its visual geometry{same}",
                data={"shift_m": fit.shift_m, "limit_m": self._limit(fit)},
            )


def _length(metres: float) -> str:
    """Three figures in the unit of its size: `27.4 mm`, `2.03 m`, `1350 m`; never an exponent."""
    value, unit = (metres, "m") if metres >= 1.0 else (1e3 * metres, "mm")
    return f"{value:.0f} {unit}" if value >= 100.0 else f"{value:.3g} {unit}"


def _fit(tree: Tree, hulls: Hulls, body: str, outside: Callable[[str], Distance]) -> Fit:
    """outside: by the name of a body, the distance from its visual hull."""
    visual, collision = (
        np.concatenate([hull.vertices for hull in hulls[body, role]])
        for role in ("visual", "collision")
    )
    lower = collision.min(axis=0) - visual.min(axis=0)
    upper = collision.max(axis=0) - visual.max(axis=0)
    alike = np.where(lower * upper > 0.0, np.minimum(np.abs(lower), np.abs(upper)), 0.0)
    x, y, z = (float(v) for v in np.sign(lower) * alike)
    size = float(np.linalg.norm(visual.max(axis=0) - visual.min(axis=0)))
    return Fit(_beyond_robot(tree, hulls, body, outside), (x, y, z), size)


def _beyond_robot(tree: Tree, hulls: Hulls, body: str, outside: Callable[[str], Distance]) -> float:
    """How far collision sticks out of the visual hulls of its body and of the next ones, m.

    A source may give a motor to one link to be seen and to its neighbour to be hit.
    """
    left = np.concatenate([hull.vertices for hull in hulls[body, "collision"]])
    apart = np.full(len(left), np.inf)
    above = tree.joint_above.get(body)
    near = {} if above is None else {above.parent: above.X_parent_joint.inverse()}
    near |= {j.child: j.X_parent_joint for j in tree.joints if j.parent == body}
    for name, X_body_other in ({body: IDENTITY} | near).items():
        if (name, "visual") in hulls and len(left):
            apart = np.minimum(apart, outside(name)(X_body_other.inverse().apply(left)))
            left, apart = left[apart > 0.0], apart[apart > 0.0]
    return float(apart.max(initial=0.0))
