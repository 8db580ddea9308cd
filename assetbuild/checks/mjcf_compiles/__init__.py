"""Does MuJoCo compile every MJCF file, without a word, and does the file make sense?

The lints need the compiled model too, so they run here: compiling is what costs.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from assetbuild.checks.mjcf_compiles import lint_model, lint_text
from assetbuild.engine.step import Files
from assetbuild.errors import StepError
from assetbuild.findings import Finding, Rule
from assetbuild.kinds import Check, write_figures
from assetbuild.robot.mirror import Tolerances, mirror_findings
from assetbuild.robot.twins import twins
from assetbuild.simulators.mujoco import Loaded, load

LOAD = Rule("mjcf.load", "error", "MuJoCo refuses the file", "read the findings on the description")
WARNING = Rule(
    "mjcf.warning", "warning", "MuJoCo warned while it compiled the file", "read the warning"
)


SIZES = {"bodies": "nbody", "nq": "nq", "nv": "nv", "nu": "nu", "keyframes": "nkey",
         "geoms": "ngeom", "sites": "nsite", "excludes": "nexclude"}  # fmt: skip
"""Figure -> its name in MuJoCo's model."""


class MjcfCompiles(Check):
    """Loads each file at the top of `mjcf/`; figures: the sizes of the compiled models."""

    usual_s = 0.6
    isolated = True
    preload = ("mujoco",)
    needs = ("mjcf",)
    reads = ()

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads `mjcf/*.xml` with their assets."""
        figures: dict[str, dict[str, int]] = {}
        for path in sorted((files.inputs / "mjcf").glob("*.xml")):
            try:
                # The reader of facts compiles the looks of the robot; of the scene nobody else.
                loaded = load(path, visuals=path.name == "scene.xml")
            except StepError as error:
                yield LOAD(
                    "robot",
                    f"MuJoCo refuses {path.name}: {error.message}",
                    hint="an error in the source often shows here first: see the lints",
                )
                continue
            model = loaded.model
            figures[path.name] = {word: int(getattr(model, n)) for word, n in SIZES.items()}
            figures[path.name]["bodies"] -= 1  # the world
            yield from said_by_mujoco(path.name, loaded)
            if path.name != "scene.xml":  # the scene includes the robot: nothing twice
                yield from lint_text.lint(path)
                yield from lint_model.lint(model)
        write_figures(files, figures)


def said_by_mujoco(name: str, loaded: Loaded) -> Iterator[Finding]:
    """One finding for each warning of the compiler."""
    for warning in dict.fromkeys(loaded.warnings):
        yield WARNING("robot", f"MuJoCo on {name}: {warning}")


def lint_file(path: Path) -> Iterator[Finding]:
    """Everything that can be said about one MJCF file, foreign or our own."""
    try:
        loaded = load(path)
    except StepError as error:
        yield LOAD("robot", f"MuJoCo refuses {path.name}: {error.message}")
        return
    yield from said_by_mujoco(path.name, loaded)
    yield from lint_text.lint(path)
    yield from lint_model.lint(loaded.model)
    yield from mirror_findings(twins(lint_model.parts_of(loaded.model)), Tolerances())
