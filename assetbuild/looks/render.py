"""Pictures: the one that stands for the robot, and those that explain it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

import numpy as np

from assetbuild.engine.step import Files, Limits, Step
from assetbuild.errors import StepError
from assetbuild.findings import Finding, Rule
from assetbuild.looks.stage import LONG, Stage
from assetbuild.looks.studio import BACKGROUND, Pixels, studio
from assetbuild.mesh.native import NativeError, NativeLimits, run_apart
from assetbuild.simulators import mujoco

DRAWING = NativeLimits(cpu_s=60.0, memory_mb=1 << 20)
"""Drivers crash and hang: that costs only the pictures. They map more memory than they use."""
HERO, THUMBNAIL = "hero.png", "thumbnail.png"
SMALL = 256
"""Pixels along a side of the thumbnail."""
HINT = "`assetbuild doctor` says what to install"
NO_PICTURES = Rule(
    "pictures.none",
    "info",
    "the report has no picture: OpenGL cannot draw without a window here, or the MJCF does not "
    "load",
    "`assetbuild doctor`",
)


class Render(Step):
    """`mjcf/scene.xml` -> `images/hero.png` and the same, small, for the USD.

    A machine without OpenGL, or with a driver that crashes, writes no picture and leaves a finding;
    the renderer is part of the key, so a later driver makes them.
    """

    usual_s = 2.0
    outputs = ("images/",)
    isolated = True
    cpu_bound = True  # Mesa compiles its shaders for the CPU that it finds
    preload = ("mujoco",)
    limits: ClassVar[Limits] = Limits(wall_s=900.0)

    renderer: str
    """From `offscreen.renderer`: the same robot looks a little different on another driver."""

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads the folder `mjcf/`."""
        folder = files.outputs / "images"
        folder.mkdir()
        try:
            draw(files.inputs / "mjcf" / "scene.xml", folder, self.renderer)
        except StepError as error:
            for half in folder.iterdir():
                half.unlink()
            yield NO_PICTURES("robot", f"no picture: {error.message}", hint=HINT)


def draw_all(scene: Path, folder: Path, renderer: str) -> None:
    """Write all pictures of a robot's `scene.xml` into a folder, which is made. StepError."""
    folder.mkdir(parents=True, exist_ok=True)
    try:
        draw(scene, folder, renderer, explained=True)
    except StepError as error:
        raise StepError(f"no pictures: {error.message}", hint=HINT) from None


def draw(scene: Path, folder: Path, renderer: str, *, explained: bool = False) -> None:
    """Write the picture of a robot with a small one, or those that explain it as well. StepError.

    In a process of its own.
    """
    if renderer == "none":
        raise StepError("no OpenGL without a window (EGL or OSMesa) here, or `MUJOCO_GL` says so")
    stage = Stage(_loaded(scene))

    def work() -> tuple[()]:
        size, radius = (LONG, LONG), stage.size / 2.0
        with studio(renderer, stage.model, size, stage.middle, radius, stage.lowest) as opened:
            hero = stage.hero(opened)
            _write(folder / HERO, hero)
            if not explained:
                _write(folder / THUMBNAIL, _thumbnail(hero))
                return ()
            for name, pixels in stage.others(opened):
                _write(folder / name, pixels)
        return ()

    try:
        run_apart(work, DRAWING)
    except NativeError as error:
        raise StepError(f"OpenGL by {renderer.partition(' ')[0]}: {error}") from None


def _loaded(scene: Path) -> mujoco.Model:
    """Without its contacts where they are too many for MuJoCo's memory."""
    model = mujoco.load(scene).model
    try:
        with mujoco.caught_warnings():
            mujoco.at_key(model)
    except mujoco.ArenaFullError:
        return mujoco.without(model, "CONTACT")
    return model


def _write(path: Path, pixels: Pixels) -> None:
    from PIL import Image

    Image.fromarray(pixels).save(path, "PNG", compress_level=4)


def _thumbnail(pixels: Pixels) -> Pixels:
    """The picture on a square of 256 pixels."""
    from PIL import Image, ImageOps

    paper = (BACKGROUND,) * 3
    return np.asarray(ImageOps.pad(Image.fromarray(pixels), (SMALL, SMALL), color=paper))
