"""Files beside a mesh: which ones it names, and pictures of the description as PNG."""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import ClassVar

from assetbuild.engine.step import Files, Limits, Step
from assetbuild.findings import Finding, Rule
from assetbuild.mesh.companions import Naming, companions_of
from assetbuild.mesh.picture import png_of


class MeshCompanions(Step):
    """Reads `mesh` (or a material library), writes `companions.json`: a list of paths.

    They start at the folder of the file. Whether they exist is not asked here, and nothing is
    decoded: a search for names in the text.
    """

    shares = True
    own_name = "mesh_companions"
    outputs = ("companions.json",)

    format: Naming
    """Format of the file, which decides how it names others; derived from its suffix."""

    def run(self, files: Files) -> Iterable[Finding]:
        """Never fails on a broken file: `convert_mesh` says what is wrong with it."""
        names = companions_of((files.inputs / "mesh").read_bytes(), self.format)
        text = json.dumps(names, indent=1) + "\n"
        (files.outputs / "companions.json").write_text(text, encoding="ascii")
        return ()


UNREADABLE = Rule(
    "texture.unreadable",
    "warning",
    "a texture of the description is not a picture",
    "save it as PNG or JPEG",
)


class ConvertTexture(Step):
    """Reads `picture`; writes `texture/texture.png`, or nothing when it is no picture."""

    own_name = "convert_texture"
    outputs = ("texture/",)
    isolated = True
    all_told = True
    preload = ("numpy", "collada", "lxml.etree", "PIL.Image")  # as convert_mesh
    limits: ClassVar[Limits] = Limits(wall_s=60.0, memory_mb=2048)

    name: str = "texture"
    """What findings and errors call it. Part of the key: name no path to share the result."""

    def run(self, files: Files) -> Iterable[Finding]:
        """Raises StepError for a picture that is too large."""
        (files.outputs / "texture").mkdir()
        try:
            png = png_of((files.inputs / "picture").read_bytes(), self.name)
        except ValueError as error:
            return [
                UNREADABLE(
                    "robot",
                    f"the texture `{self.name}` is not readable as a picture: {error}",
                    hint="save it again as PNG or JPEG",
                    data={"texture": self.name},
                )
            ]
        (files.outputs / "texture" / "texture.png").write_bytes(png)
        return []
