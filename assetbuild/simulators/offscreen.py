"""OpenGL without a window: by EGL, by OSMesa, or on macOS by CGL, in a process of its own."""

from __future__ import annotations

import os
import select
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from assetbuild.errors import StepError

if TYPE_CHECKING:
    from assetbuild.engine.world import World

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
