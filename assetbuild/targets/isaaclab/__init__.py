"""Isaac Lab: a module for each of its generations that spawns the robot's USD.

The two generations name the same things differently and order quaternions differently; see
docs/reference/isaaclab.md. The physics stands in the USD; what is repeated here is what Isaac Lab
would otherwise decide itself.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, ClassVar

from assetbuild.engine.step import Files
from assetbuild.findings import Finding, Rule
from assetbuild.plugin_types import RecipeView, Target
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.mjcf_only import as_drives
from assetbuild.robot.model import Control
from assetbuild.robot.ranges import Randomize
from assetbuild.simulators.usd_options import UsdOptions
from assetbuild.targets.isaaclab import events
from assetbuild.targets.isaaclab.module import Generation, IsaacLabOptions, Module, module_name
from assetbuild.targets.isaaclab.script import script

NO_USD = Rule(
    "isaaclab.no_usd",
    "error",
    "the modules spawn a USD that the bundle does not hold",
    "add `usd` to the targets",
)
GENERAL = Rule(
    "isaaclab.general",
    "warning",
    "Isaac Lab has no form of the model `general`",
    "another model, or an actuator class of your own",
)
SATURATION = Rule(
    "isaaclab.saturation",
    "info",
    "a `dc_motor` has no stall torque; its effort limit is used instead",
    "`stall` in the row or the motor",
)

SPRING = Rule(
    "isaaclab.spring",
    ("error", "info"),
    "a joint has a spring that rests elsewhere than at 0: the module has its stiffness, but Isaac "
    "Lab aims the drives of all joints at 0 until a target is set (info: a spring that rests at 0)",
    "set the joint's position target to the spring's rest at every reset and accept it by `rules: "
    "{isaaclab.spring: {severity: info, because: ...}}`",
)


class IsaacLab(Target):
    """`python/<robot>_isaaclab_2.py` and `_3.py`, which look for the USD beside them.

    `_measure.py` is for Isaac Lab's half of the comparison.
    """

    outputs = ("isaaclab/",)
    reads: ClassVar[tuple[str, ...]] = ("tree.json", "control.json")
    folder = "python"

    sections: ClassVar[Mapping[str, str]] = {"isaaclab": "options"}
    recipe_fields: ClassVar[Mapping[str, str]] = {"usd": "usd", "randomize": "randomize"}

    options: IsaacLabOptions = IsaacLabOptions()
    """The recipe's `isaaclab`."""
    usd: UsdOptions = UsdOptions()
    """The recipe's `usd`: the modules repeat it, so that no default of Isaac Lab's slips in."""
    randomize: Randomize | None = None
    """The recipe's ranges, for the modules' event terms."""
    has_usd: bool = True
    """Whether the bundle holds the USD that the modules spawn."""

    @classmethod
    def values(cls, recipe: RecipeView) -> dict[str, Any] | None:  # Any: values of its fields
        """Knows whether the USD is built too."""
        fields = super().values(recipe)
        return None if fields is None else fields | {"has_usd": "usd" in recipe.value("targets")}

    def run(self, files: Files) -> Iterator[Finding]:
        """One module for each generation."""
        robot = RobotFiles(files.inputs)
        tree, control = robot.tree, robot.control
        folder = files.outputs / "isaaclab"
        folder.mkdir()
        name = module_name(self.robot)
        texts = {"measure": script(self.robot, name, tree)}
        generations: tuple[Generation, ...] = (2, 3)
        for generation in generations:
            module = Module(
                self.robot, generation, tree, control, self.options, self.usd, self.randomize
            )
            texts[str(generation)] = module.text()
        for kind, text in texts.items():
            (folder / f"{name}_isaaclab_{kind}.py").write_text(text, encoding="utf-8")
        yield from self._findings(control)
        if self.randomize is not None:
            yield from events.lost(self.randomize, control, tree)

    def _findings(self, control: Control) -> Iterator[Finding]:
        if not self.has_usd:
            yield NO_USD(
                "recipe targets",
                "the modules spawn `usd/`, which the bundle does not hold",
                hint="add `usd` to the targets",
            )
        lost = [a.joint for a in control.actuators if a.model == "general"]
        if lost:
            yield GENERAL(
                f"actuator {lost[0]}",
                f"Isaac Lab has no form of the model `general`: {len(lost)} joints get no torque",
                hint="give these joints another model, or an actuator class of your own",
                data={"joints": tuple(lost)},
            )
        for joint, spring in as_drives(control).items():
            lost_rest = spring.rest != 0.0
            yield SPRING(
                f"joint {joint}",
                f"its spring ({spring.stiffness:g}) is the stiffness of an implicit actuator"
                + (f", but Isaac Lab aims it at 0, not at {spring.rest:g}" * lost_rest),
                hint="leave the joint out of actions, and set its position target to the spring's "
                "rest at every reset",
                severity="error" if lost_rest else "info",
                data={"stiffness": spring.stiffness, "rest": spring.rest},
            )
        unstated = [a.joint for a in control.actuators if a.model == "dc_motor" and a.stall is None]
        if unstated:
            yield SATURATION(
                f"actuator {unstated[0]}",
                f"the table states no stall torque: {len(unstated)} joints take their effort limit "
                "for it, so half of the torque is left at half of the velocity limit",
                hint="a motor's stall torque is often higher: give `stall` in the row or the motor",
                data={"joints": tuple(unstated)},
            )
