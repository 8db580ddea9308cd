"""How the robot looks: pictures, the geometry of the 3D view. Nothing that trains.

    tree, shapes, triangles -> viewer
    tree, shapes, meshes, pose -> picture model -> pictures

No gain, no friction and no timestep reaches these steps, so a new one draws nothing anew.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from assetbuild.engine.graph import Node, Ref
from assetbuild.engine.planner import Planner
from assetbuild.plugin_types import Target
from assetbuild.plugins import load_plugin
from assetbuild.recipe.models import Recipe
from assetbuild.rendering.render import Render
from assetbuild.rendering.viewer import Viewer

if TYPE_CHECKING:
    from assetbuild.engine.world import World


PICTURE_MODEL = "picture model"
"""An MJCF to look at; what it has to say about the robot, the target `mjcf` says too."""


def looks(recipe: Recipe, robot: Mapping[str, Ref], pose: Ref, p: Planner) -> dict[str, Node]:
    """The nodes `viewer` and, of a robot that MJCF can hold, `pictures`."""
    shown = {port: robot[port] for port in ("tree.json", "shapes.json", "triangles.npz")}
    nodes = {"viewer": p.add("viewer", Viewer(), shown)}
    if "mjcf" in recipe.targets:  # else the recipe may hold what MJCF refuses
        target = load_plugin(Target, "mjcf")
        drawn = {port: robot[port] for port in ("tree.json", "shapes.json", "meshes/")}
        drawn["control.json"] = pose
        model = nodes[PICTURE_MODEL] = p.add(PICTURE_MODEL, target.configure(recipe), drawn)
        step = Render(renderer=renderer(p.world))
        nodes["pictures"] = p.add("pictures", step, {"mjcf/": model["mjcf/"]})
    return nodes


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
        cards = world.names(Path("/dev"), starts=("nvidia",))
        numbered = [name for name in cards if name.removeprefix("nvidia").isdigit()]
        devices = [*world.names(Path("/dev/dri"), starts=("renderd",)), *numbered]
        return f"egl {' '.join([*drivers, *devices])}"
    if any(world.can_load(f"libOSMesa.so{suffix}") for suffix in ("", ".8", ".6")):
        return "osmesa"
    return "none"


def _drivers(world: World) -> list[str]:
    """Stems of the files that register drivers; libglvnd's variables name others."""
    files = world.variable("__EGL_VENDOR_LIBRARY_FILENAMES")
    folders = world.variable("__EGL_VENDOR_LIBRARY_DIRS")
    if files:
        paths = [Path(file) for file in files.split(":") if world.is_file(Path(file))]
    else:
        paths = [
            Path(folder, name)
            for folder in (folders.split(":") if folders else VENDORS)
            for name in world.names(Path(folder), ends=(".json",))
        ]
    return sorted({path.stem for path in paths})
