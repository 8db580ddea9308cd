"""Pictures: the one that stands for the robot, and those that explain it."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import ClassVar

import numpy as np

from assetbuild.engine.step import Files, Limits, Step
from assetbuild.errors import StepError
from assetbuild.findings import Finding, Rule
from assetbuild.looks.stage import LONG, Stage, extent
from assetbuild.simulators import mujoco, offscreen
from assetbuild.simulators.mujoco import Model
from assetbuild.simulators.studio import BACKGROUND, Pixels, opengl, studio

DRAWING_S = 400.0
"""Wall clock for all pictures; a driver that hangs costs only them."""
ROOM = (LONG, LONG)
"""Pixels of the largest frame."""
HERO, THUMBNAIL = "hero.png", "thumbnail.png"
SMALL = 256
"""Pixels along a side of the thumbnail."""
Drawn = Callable[[Stage], Iterable[tuple[str, Pixels]]]
"""(file, picture) of what is to be drawn."""
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
    limits: ClassVar[Limits] = Limits(wall_s=450.0)

    renderer: str
    """From `offscreen.renderer`: the same robot looks a little different on another driver."""

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads the folder `mjcf/`."""
        folder = files.outputs / "images"
        folder.mkdir()
        problem = _drawn_apart(files.inputs / "mjcf" / "scene.xml", folder, self.renderer, _hero)
        if problem:
            for half in folder.iterdir():
                half.unlink()
            yield NO_PICTURES(
                "robot", f"no picture: {problem}", hint="`assetbuild doctor` says what to install"
            )


def draw_all(scene: Path, folder: Path, renderer: str) -> None:
    """Write all pictures of a robot's `scene.xml` into a folder, which is made. StepError."""
    folder.mkdir(parents=True, exist_ok=True)
    problem = _drawn_apart(scene, folder, renderer, _all)
    if problem:
        raise StepError(f"no pictures: {problem}", hint="`assetbuild doctor` says what to install")


def _hero(stage: Stage) -> Iterator[tuple[str, Pixels]]:
    pixels = stage.hero()
    yield HERO, pixels
    yield THUMBNAIL, _thumbnail(pixels)


def _all(stage: Stage) -> Iterator[tuple[str, Pixels]]:
    yield HERO, stage.hero()
    yield from stage.others()


def _drawn_apart(scene: Path, folder: Path, renderer: str, drawn: Drawn) -> str:
    """Draw in a process of its own; why it came to nothing, or ""."""

    def draw() -> None:
        with _stage(scene, renderer) as stage:
            for name, pixels in drawn(stage):
                (folder / name).write_bytes(_png(pixels))

    return offscreen.run_apart(draw, DRAWING_S)


@contextmanager
def _stage(scene: Path, renderer: str) -> Iterator[Stage]:
    if renderer == "none":
        raise StepError("no OpenGL without a window (EGL or OSMesa) here, or `MUJOCO_GL` says so")
    model = _loaded(scene)
    data = mujoco.at_key(model)
    seen = extent(model, data)
    with (
        opengl(renderer, ROOM),
        studio(model, ROOM, seen.middle, seen.size / 2.0, seen.lowest) as opened,
    ):
        yield Stage(opened, model, data, seen)


def _loaded(scene: Path) -> Model:
    """Without its contacts where they are too many for MuJoCo's memory."""
    model = mujoco.load(scene).model
    try:
        with mujoco.caught_warnings():
            mujoco.at_key(model)
    except mujoco.ArenaFullError:
        return mujoco.without(model, "CONTACT")
    return model


def _png(pixels: Pixels) -> bytes:
    from PIL import Image

    out = io.BytesIO()
    Image.fromarray(pixels).save(out, "PNG", compress_level=4)
    return out.getvalue()


def _thumbnail(pixels: Pixels) -> Pixels:
    """The picture on a square of 256 pixels."""
    from PIL import Image, ImageOps

    paper = (BACKGROUND,) * 3
    return np.asarray(ImageOps.pad(Image.fromarray(pixels), (SMALL, SMALL), color=paper))
