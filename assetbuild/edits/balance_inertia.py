"""`balance_inertia: {link}`: the nearest tensor that some mass could have."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from assetbuild.engine.step import Files
from assetbuild.errors import RecipeError
from assetbuild.findings import Finding, Rule
from assetbuild.plugin_types import Edited, LinkEdit
from assetbuild.robot.inertia import matrix_of, principal_moments, tensor_of, triangle_violation
from assetbuild.robot.model import Body, Inertial, Tree
from assetbuild.robot.shapes import SourceShapes

ROOM = 1e-9
"""A + B exceeds C by this share of C: turning the axes, as MuJoCo does, loses exact equality."""

BALANCE_INERTIA = Rule(
    "edit.balance_inertia",
    ("info", "warning"),
    "the smallest principal moment was raised (a warning when no link needed it)",
    "measure the part; remove an edit that does nothing",
)


class BalanceInertia(LinkEdit):
    """Where C > A + B of the principal moments A <= B <= C, A becomes C - B, and a billionth of C.

    The other two and all axes stay: of all ways to raise one moment it is the smallest change.
    Links that satisfy the inequality are left alone.
    """

    def edit(self, tree: Tree, shapes: SourceShapes, files: Files) -> Edited:
        """See `Edit`."""
        done = super().edit(tree, shapes, files)
        if done.findings:
            return done
        message = f"no link that matches `{self.link}` violates A + B >= C"
        needless = BALANCE_INERTIA("recipe edits", message, "remove the edit", severity="warning")
        return replace(done, findings=(needless,))

    def change(self, body: Body) -> tuple[Inertial, Finding] | None:
        """See `LinkEdit`."""
        old = body.inertial
        if old is None or triangle_violation(old.inertia_com_kg_m2) <= 0.0:
            return None
        before = old.inertia_com_kg_m2
        a, b, c = principal_moments(before)
        if b <= 0.0:
            raise RecipeError(
                f"balance_inertia: two principal moments of link `{body.name}` are not positive "
                f"({a:.4g}, {b:.4g} kg m2)",
                hint="use `set_inertia` or `inertia_from_geometry`",
            )
        raised = c - b + ROOM * c
        _, axes = np.linalg.eigh(matrix_of(before))
        after = tensor_of(matrix_of(before) + (raised - a) * np.outer(axes[:, 0], axes[:, 0]))
        finding = BALANCE_INERTIA(
            f"link {body.name}",
            f"smallest principal moment {a:.6g} -> {raised:.6g} kg m2, the others "
            f"{b:.6g} and {c:.6g} as they were",
            data={
                "before_kg_m2": before,
                "after_kg_m2": after,
                "before_smallest_kg_m2": a,
                "after_smallest_kg_m2": raised,
            },
        )
        return Inertial(old.mass_kg, old.com_m, after), finding
