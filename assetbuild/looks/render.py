"""Pictures of the robot as people look at it in a viewer: shapes, masses, axes, contacts, turns."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import ClassVar

import numpy as np

from assetbuild.engine.step import Files, Limits, Step
from assetbuild.errors import StepError
from assetbuild.findings import Finding, Rule
from assetbuild.looks import stage
from assetbuild.looks.annotate import png, thumbnail
from assetbuild.looks.stage import HERO, Extent, Picture, Stage, extent
from assetbuild.simulators import mujoco, offscreen
from assetbuild.simulators.mujoco import Data, Model
from assetbuild.simulators.studio import opengl, studio

DRAWING_S = 400.0
"""Wall clock for all pictures; a driver that hangs costs only them."""
ROOM = (stage.LONG, stage.LONG)
"""Pixels of the largest frame."""
THUMBNAIL = "thumbnail.png"
"""The hero, small: it lies beside the USD and is not in the list."""
NO_PICTURES = Rule(
    "pictures.none",
    "info",
    "the report has no pictures: OpenGL cannot draw without a window here, or the MJCF does not "
    "load",
    "`assetbuild doctor`",
)


class Render(Step):
    """`mjcf/scene.xml` -> `images/*.png` and `pictures.json`, which says what each one shows.

    The two pictures of the robot itself show its meshes. All others show those of `light/`, as
    `Lighten` writes them: they differ by less than a pixel and are drawn in a third of the time.

    A machine without OpenGL, or with a driver that crashes, writes no picture and leaves a finding;
    the renderer is part of the key, so a later driver makes them.
    """

    usual_s = 5.0
    outputs = ("images/", "pictures.json")
    isolated = True
    cpu_bound = True  # Mesa compiles its shaders for the CPU that it finds
    preload = ("mujoco",)
    limits: ClassVar[Limits] = Limits(wall_s=450.0)

    renderer: str
    """From `offscreen.renderer`: the same robot looks a little different on another driver."""
    turntable: int = 8
    """Views all around."""

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads the folders `mjcf/` and `light/`."""
        (files.outputs / "images").mkdir()
        problem = offscreen.run_apart(lambda: self._write(files), DRAWING_S)
        if problem:
            for half in (files.outputs / "images").iterdir():
                half.unlink()
            _write_list(files, [], "")
            yield NO_PICTURES(
                "robot", f"no pictures: {problem}", hint="`assetbuild doctor` says what to install"
            )

    def _write(self, files: Files) -> None:
        pictures, driver = self._pictures(files)
        for picture in pictures:
            (files.outputs / "images" / picture.file).write_bytes(
                png(picture.pixels, every_colour=picture.file == HERO)
            )
            if picture.file == HERO:
                (files.outputs / "images" / THUMBNAIL).write_bytes(thumbnail(picture.pixels))
        _write_list(files, pictures, driver)

    def _pictures(self, files: Files) -> tuple[list[Picture], str]:
        if self.renderer == "none":
            raise StepError(
                "no OpenGL without a window (EGL or OSMesa) here, or `MUJOCO_GL` says so"
            )
        model = _loaded(files.inputs / "mjcf" / "scene.xml")
        data = mujoco.at_key(model)
        seen = extent(model, data)
        made: list[Picture] = []
        with opengl(self.renderer, ROOM):
            with _stage(model, data, seen) as robot:
                made += robot.hero()
            light = _lightened(model, files.inputs)
            with _stage(light, mujoco.at_key(light), seen) as robot:
                made += [*robot.views(), *robot.turntable(self.turntable), *robot.directions()]
                return made, robot.studio.driver()


@contextmanager
def _stage(model: Model, data: Data, seen: Extent) -> Iterator[Stage]:
    with studio(model, ROOM, seen.middle, seen.size / 2.0, seen.lowest) as opened:
        yield Stage(opened, model, data, seen)


def _lightened(model: Model, inputs: Path) -> Model:
    """The scene with light meshes where these show the same: no texture, nothing that collides."""
    collides = np.asarray(model.geom_dataid)[np.asarray(model.geom_group) == stage.COLLISION]
    kept = {_file_of(model, int(number)) for number in collides if number >= 0}
    with TemporaryDirectory() as folder:
        copy = Path(folder) / "mjcf"
        shutil.copytree(inputs / "mjcf", copy, copy_function=os.symlink)
        for mesh in copy.rglob("*.obj"):
            text = mesh.read_bytes()
            light = inputs / "light" / f"{hashlib.sha256(text).hexdigest()}.obj"
            if mesh.name not in kept and b"\nvt " not in text and light.is_file():
                mesh.unlink()
                mesh.symlink_to(light)
        return _loaded(copy / "scene.xml")


def _loaded(scene: Path) -> Model:
    """Without its contacts where they are too many for MuJoCo's memory."""
    model = mujoco.load(scene).model
    try:
        with mujoco.caught_warnings():
            mujoco.at_key(model)
    except mujoco.ArenaFullError:
        return mujoco.without(model, "CONTACT")
    return model


def _file_of(model: Model, mesh: int) -> str:
    start = int(model.mesh_pathadr[mesh])
    return Path(bytes(model.paths[start:]).split(b"\0", 1)[0].decode()).name


def _write_list(files: Files, pictures: Sequence[Picture], driver: str) -> None:
    rows = [{"file": p.file, "title": p.title, "alt": p.alt} for p in pictures]
    text = json.dumps({"driver": driver, "pictures": rows}, indent=1, sort_keys=True)
    (files.outputs / "pictures.json").write_text(text + "\n", encoding="utf-8")
