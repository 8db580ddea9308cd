"""OpenUSD: a layered asset that Isaac Lab spawns and PhysX simulates, with usd-core alone."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import ClassVar

from assetbuild.engine.step import Files
from assetbuild.findings import Finding
from assetbuild.plugin_types import Preparation, Target
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.sections import About
from assetbuild.simulators.usd_options import UsdOptions

# Both decide the bytes of a binary layer from outside of the recipe.
_ENVIRONMENT = ("USD_WRITE_NEW_USDC_FILES_AS_VERSION", "PIXAR_TF_ENV_SETTINGS_FILE")


PRELOAD = ("pxr.Usd", "pxr.UsdGeom", "pxr.UsdPhysics", "pxr.UsdShade")


class UsdGeometries(Preparation):
    """`geometries.usdc`: each mesh once."""

    own_name = "usd_geometries"
    outputs = ("geometries.usdc",)
    reads: ClassVar[tuple[str, ...]] = ("shapes.json", "triangles.npz")
    isolated: ClassVar[bool] = True
    preload = PRELOAD

    def run(self, files: Files) -> Iterator[Finding]:
        """Writes the library of meshes."""
        with plain_environment():
            from assetbuild.targets.usd.geometry import write_library

            robot = RobotFiles(files.inputs)
            write_library(files.outputs, robot.shapes, robot.triangles)
        yield from ()


class Usd(Target):
    """`usd/<robot>.usda`, `usd/payloads/...` and `usd/scene.usda`."""

    usual_s = 1.0
    outputs = ("usd/",)
    reads: ClassVar[tuple[str, ...]] = ("tree.json", "shapes.json", "control.json", "meshes/")
    preparation = UsdGeometries
    isolated: ClassVar[bool] = True
    preload = PRELOAD

    sections: ClassVar[Mapping[str, str]] = {"usd": "options"}
    recipe_fields: ClassVar[Mapping[str, str]] = {
        "about_robot": "about",
        "licence": "source.license",
        "urdf": "source.urdf",
        "xacro": "source.xacro",
        "mjcf": "source.mjcf",
    }

    options: UsdOptions = UsdOptions()
    """The recipe's `usd`."""
    about_robot: About = About()
    """The recipe's `about`."""
    licence: str | None = None
    urdf: str | None = None
    xacro: str | None = None
    mjcf: str | None = None

    def run(self, files: Files) -> Iterator[Finding]:
        """Writes the asset; raises StepError for joints that no articulation holds."""
        with plain_environment():
            from assetbuild.targets.usd.asset import write_asset

            yield from write_asset(
                files.outputs / "usd",
                self.robot,
                RobotFiles(files.inputs),
                self.options,
                self.about_robot,
                self.licence,
                self.urdf or self.xacro or self.mjcf,
            )


@contextmanager
def plain_environment() -> Iterator[None]:
    """Take away the variables that change the bytes of a layer; they come back afterwards."""
    kept = {name: os.environ.pop(name) for name in _ENVIRONMENT if name in os.environ}
    try:
        yield
    finally:
        os.environ.update(kept)
