"""Does MuJoCo compile every MJCF file, without a word, and does the file make sense?

The lints need the compiled model too, so they run here: compiling is what costs.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from assetbuild.checks.mjcf_compiles import lint_model, lint_xml
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


class MjcfCompiles(Check):
    """Loads each file at the top of `mjcf/`; figures: the sizes of the compiled models."""

    usual_s = 0.6
    isolated = True
    preload = ("mujoco",)
    needs = ("mjcf",)
    reads = ()

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads `mjcf/*.xml` with their assets."""
        figures: dict[str, object] = {}
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
            figures[path.name] = {
                "bodies": int(model.nbody) - 1,
                "nq": int(model.nq),
                "nv": int(model.nv),
                "nu": int(model.nu),
                "keyframes": int(model.nkey),
                "geoms": int(model.ngeom),
                "sites": int(model.nsite),
                "excludes": int(model.nexclude),
            }
            yield from said_by_mujoco(path.name, loaded)
            if path.name != "scene.xml":  # the scene includes the robot: nothing twice
                yield from lint_xml.lint(lint_xml.read(path))
                yield from lint_model.lint(model)
        write_figures(files, figures)


def said_by_mujoco(name: str, loaded: Loaded) -> Iterator[Finding]:
    """One finding for each warning of the compiler."""
    for warning in dict.fromkeys(loaded.warnings):
        yield WARNING("robot", f"MuJoCo on {name}: {warning}")


def lint_file(path: Path) -> Iterator[Finding]:
    """Everything that can be said about one MJCF file, foreign or our own."""
    root = lint_xml.read(path)
    yield from lint_xml.lint(root)
    try:
        loaded = load(path)
    except StepError as error:
        yield LOAD("robot", f"MuJoCo refuses {path.name}: {error.message}")
        return
    yield from said_by_mujoco(path.name, loaded)
    yield from lint_model.lint(loaded.model)
    yield from mirror_findings(twins(lint_model.parts_of(loaded.model)), Tolerances())
