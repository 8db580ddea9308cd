"""How the robot looks: light meshes, pictures, the geometry of the 3D view. Nothing that trains.

    shapes, meshes -> light meshes -> viewer
    tree, shapes, meshes, pose -> picture model -> pictures

No gain, no friction and no timestep reaches these steps, so a new one draws nothing anew.
"""

from __future__ import annotations

from collections.abc import Mapping

from assetbuild.engine.graph import Node, Ref
from assetbuild.engine.planner import Planner
from assetbuild.kinds import Target
from assetbuild.looks.lighten import Lighten
from assetbuild.looks.render import Render
from assetbuild.looks.viewer import Viewer
from assetbuild.plugins import load_plugin
from assetbuild.recipe.models import Recipe
from assetbuild.simulators.offscreen import renderer

PICTURE_MODEL = "picture model"
"""An MJCF to look at; what it has to say about the robot, the target `mjcf` says too."""


def looks(recipe: Recipe, robot: Mapping[str, Ref], pose: Ref, p: Planner) -> dict[str, Node]:
    """The nodes `viewer` and, of a robot that MJCF can hold, `pictures`."""
    ports = {port: robot[port] for port in ("shapes.json", "meshes/")}
    light = p.add("light meshes", Lighten(), ports)
    shown = {name: light[name] for name in ports} | {"tree.json": robot["tree.json"]}
    nodes = {"viewer": p.add("viewer", Viewer(), shown)}
    if "mjcf" in recipe.targets:  # else the recipe may hold what MJCF refuses
        target = load_plugin(Target, "mjcf")
        drawn = ports | {"tree.json": robot["tree.json"], "control.json": pose}
        model = p.add(PICTURE_MODEL, target.configure(recipe), drawn)
        step = Render(renderer=renderer(p.world))
        nodes["pictures"] = p.add("pictures", step, {"mjcf/": model["mjcf/"]})
    return nodes
