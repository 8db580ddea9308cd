"""Does MuJoCo compile every MJCF file, without a word?"""

from __future__ import annotations

from collections.abc import Iterator

from assetbuild.engine.step import Files
from assetbuild.errors import StepError
from assetbuild.findings import Finding
from assetbuild.kinds import Check, write_figures
from assetbuild.simulators.mujoco import load


class MjcfCompiles(Check):
    """Loads each file at the top of `mjcf/`; figures: the sizes of the compiled models."""

    isolated = True
    preload = ("mujoco",)
    tools = ("mujoco",)
    needs = ("mjcf",)
    reads = ()

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads `mjcf/*.xml` with their assets."""
        figures: dict[str, object] = {}
        for path in sorted((files.inputs / "mjcf").glob("*.xml")):
            try:
                loaded = load(path)
            except StepError as error:
                yield Finding(
                    "mjcf.load",
                    "error",
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
            for warning in loaded.warnings:
                yield Finding(
                    "mjcf.warning", "warning", "robot", f"MuJoCo on {path.name}: {warning}"
                )
        write_figures(files, figures)
