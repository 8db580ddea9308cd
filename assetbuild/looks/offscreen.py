"""What this machine draws with where there is no window: EGL, OSMesa, or on macOS CGL."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

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
