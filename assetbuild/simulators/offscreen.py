"""Frames of a MuJoCo model without a window: OpenGL by EGL, by OSMesa, or on macOS by CGL."""

from __future__ import annotations

import importlib
import os
import select
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from assetbuild.errors import StepError
from assetbuild.robot.pose import Vec3
from assetbuild.simulators.mujoco import Data, Model

if TYPE_CHECKING:
    from assetbuild.engine.world import World

Pixels = NDArray[np.uint8]
VENDORS = ("/usr/share/glvnd/egl_vendor.d", "/etc/glvnd/egl_vendor.d")
"""Where the drivers behind libEGL are registered."""
OFF = ("disable", "disabled", "off", "false", "0")
"""Values of `MUJOCO_GL` that ask for no rendering."""


def renderer(world: World) -> str:
    """What this machine would draw with: `egl 50_mesa renderD128`, `osmesa`, `cgl`, or `none`.

    Drivers of EGL, then devices: without one the same driver draws in software, or not at all.
    Looks at files and loads the dispatcher only, so it costs a millisecond. `MUJOCO_GL=disable`,
    as MuJoCo's own Python package understands it, draws nothing.
    """
    if (world.variable("MUJOCO_GL") or "").lower() in OFF:
        return "none"
    if sys.platform == "darwin":
        return "cgl"
    drivers = _drivers(world)
    if drivers and world.can_load("libEGL.so.1"):
        return f"egl {' '.join([*drivers, *_devices(world)])}"
    if any(world.can_load(f"libOSMesa.so{suffix}") for suffix in ("", ".8", ".6")):
        return "osmesa"
    return "none"


def _devices(world: World) -> list[str]:
    cards = world.names(Path("/dev"), starts=("nvidia",))
    numbered = [name for name in cards if name.removeprefix("nvidia").isdigit()]
    return [*world.names(Path("/dev/dri"), starts=("renderd",)), *numbered]


def _drivers(world: World) -> list[str]:
    """Stems of the files that register drivers; libglvnd's variables name others."""
    files = world.variable("__EGL_VENDOR_LIBRARY_FILENAMES")
    folders = world.variable("__EGL_VENDOR_LIBRARY_DIRS")
    if files:
        found = [Path(file) for file in files.split(":") if world.is_file(Path(file))]
    else:
        found = [
            Path(folder, name)
            for folder in (folders.split(":") if folders else VENDORS)
            for name in world.names(Path(folder), ends=(".json",))
        ]
    return sorted({path.stem for path in found})


def run_apart(work: Callable[[], None], wall_s: float) -> str:
    """Do `work` in a forked process; why it came to nothing, or "" when it is done.

    OpenGL drivers crash and hang. The caller must have no other thread.
    """
    said_in, said_out = os.pipe()
    pid = os.fork()
    if pid == 0:
        os.close(said_in)
        _become_worker(work, said_out)
    os.close(said_out)
    ready: list[int] = []
    try:
        ready, _, _ = select.select([said_in], [], [], wall_s)  # closed when it ends
        said = os.read(said_in, 4096).decode("utf-8", "replace") if ready else ""
    finally:
        os.close(said_in)
        if not ready:
            os.kill(pid, signal.SIGKILL)
        _, status = os.waitpid(pid, 0)
    if not ready:
        return f"the driver was not done after {wall_s:g} s"
    if os.WIFSIGNALED(status):
        return f"the driver crashed ({signal.Signals(os.WTERMSIG(status)).name})"
    return said


def _become_worker(work: Callable[[], None], said: int) -> NoReturn:
    try:
        work()
    except StepError as error:
        os.write(said, error.message.encode()[:4000])
    except BaseException as error:
        os.write(said, f"{type(error).__name__}: {error}".encode()[:4000])
    finally:
        os._exit(0)  # no exit handlers: a driver's own may hang


Paint = Callable[[Any], None]
"""Changes one mjvGeom of a scene before it is drawn. Any: MuJoCo's types have no stubs."""


@dataclass(frozen=True)
class View:
    """What a frame shows.

    groups: geom groups (0 floor, 2 visual, 3 collision). flags: names such as `mjVIS_JOINT`.
    azimuth, elevation: degrees, as MuJoCo's cameras count them. distance: m.
    """

    lookat: Vec3
    distance: float
    groups: tuple[int, ...] = (0, 2)
    flags: tuple[str, ...] = ()
    azimuth: float = 140.0
    elevation: float = -18.0
    width: int = 640
    height: int = 480
    paint: Paint | None = field(default=None, compare=False)


class Studio:
    """An OpenGL context with one model in it. Twice the size is drawn and averaged: no jaggies."""

    def __init__(self, model: Model, width: int, height: int) -> None:
        import mujoco

        self.model = model
        quality = model.vis.quality
        quality.shadowsize = quality.offsamples = 0  # ten times as slow without a GPU
        model.vis.global_.offwidth, model.vis.global_.offheight = 2 * width, 2 * height
        self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)
        self._scene = mujoco.MjvScene(model, maxgeom=20_000)

    def driver(self) -> str:
        """OpenGL's own name for what draws, such as `llvmpipe (LLVM 15.0.6, 256 bits)`."""
        from OpenGL import GL

        return str(GL.glGetString(GL.GL_RENDERER).decode("utf-8", "replace"))

    def frame(self, data: Data, view: View) -> Pixels:
        """(height, width, 3) colours."""
        import mujoco

        option = mujoco.MjvOption()
        option.geomgroup[:] = 0
        option.geomgroup[list(view.groups)] = 1
        for flag in view.flags:
            option.flags[getattr(mujoco.mjtVisFlag, flag)] = 1
        option.sitegroup[:] = 0
        camera = mujoco.MjvCamera()
        camera.lookat[:] = view.lookat
        camera.distance, camera.azimuth, camera.elevation = (
            view.distance,
            view.azimuth,
            view.elevation,
        )
        everything = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(self.model, data, option, None, camera, everything, self._scene)
        for name in ("mjRND_SHADOW", "mjRND_REFLECTION", "mjRND_HAZE", "mjRND_FOG"):
            self._scene.flags[getattr(mujoco.mjtRndFlag, name)] = 0
        if view.paint is not None:
            for geom in self._scene.geoms[: self._scene.ngeom]:
                view.paint(geom)
        rect = mujoco.MjrRect(0, 0, 2 * view.width, 2 * view.height)
        pixels = np.zeros((rect.height, rect.width, 3), dtype=np.uint8)
        mujoco.mjr_render(rect, self._scene, self._context)
        mujoco.mjr_readPixels(pixels, None, rect, self._context)
        blocks = pixels[::-1].reshape(view.height, 2, view.width, 2, 3).astype(np.uint16)
        return np.asarray((blocks.sum(axis=(1, 3)) + 2) // 4, dtype=np.uint8)

    def free(self) -> None:
        """Give the context's memory back before the context goes."""
        self._context.free()


@contextmanager
def studio(model: Model, renderer: str, width: int, height: int) -> Iterator[Studio]:
    """A studio on the named renderer; StepError when OpenGL will not start.

    The context's class is taken from MuJoCo's own module: its environment variable is read once,
    at import, which is too early for a process that serves many steps.
    """
    kind = renderer.partition(" ")[0]
    try:
        context = importlib.import_module(f"mujoco.{kind}").GLContext(2 * width, 2 * height)
        context.make_current()
    except Exception as error:  # whatever a driver throws: there is no picture then
        text = " ".join(str(error).split())[:200]
        raise StepError(f"OpenGL by {kind} does not start: {text}") from error
    try:
        opened = Studio(model, width, height)
        try:
            yield opened
        finally:
            opened.free()
    finally:
        context.free()
