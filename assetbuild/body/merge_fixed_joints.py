"""Merge what fixed joints hold together, exactly; merged links live on as frames."""

from __future__ import annotations

import re
from collections.abc import Iterator

from assetbuild.engine.step import Files, Step
from assetbuild.errors import quoted
from assetbuild.findings import Finding, Rule
from assetbuild.robot.codec import encode
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.tree import merge_fixed_joints

FIXED_JOINTS = Rule(
    "merge.fixed_joints",
    "info",
    "links became frames of another body",
    "name a link in `fixed_joints.keep_bodies` to keep it as a body of its own",
)
PLACEHOLDER_ROOT = Rule(
    "merge.placeholder_root",
    "info",
    "the root was a placeholder; its name and frame were replaced",
    "use the new name of the root",
)


class MergeFixedJoints(Step):
    """`links.json` -> `tree.json`, the bodies that will be simulated.

    With `keep_source` it reads `source_control.json` too, which names the bodies of an MJCF.
    """

    shares = True
    outputs = ("tree.json",)

    merge: bool = True
    keep_bodies: tuple[str, ...] = ()
    """Patterns that match whole link names; those links stay bodies on their fixed joint."""
    keep_source: bool = False
    """Keep all that the source calls a body; only what names places is merged."""
    keep_root: bool = False
    """A root without mass keeps its name and its frame too."""

    def run(self, files: Files) -> Iterator[Finding]:
        """See `Step`."""
        robot = RobotFiles(files.inputs)
        links, control = robot.links, robot.source_control if self.keep_source else None
        # The plan refuses a pattern that matches no link.
        kept = {n for p in self.keep_bodies for n in links.by_body if re.fullmatch(p, n)}
        kept |= {*(control.bodies if control else ())}
        tree, facts = merge_fixed_joints(links, self.merge, kept, keep_root=self.keep_root)
        (files.outputs / "tree.json").write_bytes(encode(tree))
        for fact in (each for each in facts if each.placeholder):
            inertial = links.by_body[fact.placeholder].inertial
            mass = inertial.mass_kg if inertial else 0.0
            yield PLACEHOLDER_ROOT(
                f"link {fact.placeholder}",
                f"the root weighs {mass:g} kg and only names a place: the body is called "
                f"`{fact.body}` and has its frame; `{fact.placeholder}` survives as a frame",
                hint=f"use `{fact.body}` where a tool asks for the root body",
                data={"body": fact.body, "mass_kg": mass},
            )
        if facts:
            merged = tuple(link for fact in facts for link in fact.links)
            yield FIXED_JOINTS(
                "robot",
                f"links that fixed joints hold became frames ({len(merged)}: {quoted(merged, 6)}); "
                f"bodies that remain: {len(tree.bodies)}",
                data={"bodies": len(tree.bodies), "links": merged},
            )
