"""Which other files a mesh names, so that the plan can declare them as inputs."""

from __future__ import annotations

import json
from collections.abc import Iterable

from assetbuild.engine.step import Files, Step
from assetbuild.findings import Finding
from assetbuild.mesh.companions import Naming, companions_of


class MeshCompanions(Step):
    """Reads `mesh` (or a material library), writes `companions.json`: a list of paths.

    They start at the folder of the file. Whether they exist is not asked here, and nothing is
    decoded: a search for names in the text.
    """

    outputs = ("companions.json",)

    format: Naming
    """By the file's suffix."""

    def run(self, files: Files) -> Iterable[Finding]:
        """Never fails on a broken file: `convert_mesh` says what is wrong with it."""
        names = companions_of((files.inputs / "mesh").read_bytes(), self.format)
        text = json.dumps(names, indent=1) + "\n"
        (files.outputs / "companions.json").write_text(text, encoding="ascii")
        return ()
