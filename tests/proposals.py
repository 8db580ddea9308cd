"""What `init` writes of a robot, and the recipe that a build reads of it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from assetbuild.init import Proposal, propose, write
from assetbuild.pipeline.recipes import load_recipe
from assetbuild.recipe.models import Recipe


@dataclass(frozen=True)
class Proposed:
    """plain: the YAML of its text. Any: values of YAML."""

    proposal: Proposal
    recipe: Recipe
    plain: dict[str, Any]

    @property
    def text(self) -> str:
        return self.proposal.text


def proposed(robot: str | bytes | Path, folder: Path, **args: str) -> Proposed:
    """robot: a file, or the text of a URDF or an MJCF, which lies in `folder` beside its recipe."""
    if isinstance(robot, Path):
        file = robot
    else:
        data = robot.encode() if isinstance(robot, str) else robot
        file = folder / ("robot.xml" if data.lstrip().startswith(b"<mujoco") else "robot.urdf")
        file.write_bytes(data)
    out = folder / "recipe.yaml"
    proposal = propose(file, out, {}, args)
    write(proposal, force=True)
    return Proposed(proposal, load_recipe(out).recipe, yaml.safe_load(proposal.text))
