"""How the robot looks: light meshes, pictures, the geometry of the 3D view. Nothing that trains.

    meshes -> light meshes -> viewer
    tree, shapes, meshes, pose -> picture model -> pictures

No gain, no friction and no timestep reaches these steps, so a new one draws nothing anew.
"""

from __future__ import annotations

from collections.abc import Mapping

from assetbuild.engine.graph import Node, Ref
from assetbuild.engine.planner import Planner
from assetbuild.geometry.plan import Geometry
from assetbuild.kinds import Target
from assetbuild.looks.lighten import Lighten
from assetbuild.looks.offscreen import renderer
from assetbuild.looks.render import Render
from assetbuild.looks.viewer import Viewer
from assetbuild.plugins import load_plugin
from assetbuild.recipe.models import Recipe
from assetbuild.robot.shapes import MeshFile

PICTURE_MODEL = "picture model"
"""An MJCF to look at; what it has to say about the robot, the target `mjcf` says too."""


def lightened(recipe: Recipe, geometry: Geometry, p: Planner) -> Ref:
    """The meshes of the 3D view; they do not wait for what collides."""
    meshes = dict.fromkeys(
        geometry.visual(shape.geometry, recipe.visual.max_faces)["parts/"]
        for shape in geometry.shapes.of("visual")
        if isinstance(shape.geometry, MeshFile)
    )
    inputs = {f"meshes/{number}/parts/": ref for number, ref in enumerate(meshes)}
    return p.add("light meshes", Lighten(), inputs)["light/"]


def looks(
    recipe: Recipe, robot: Mapping[str, Ref], light: Ref, pose: Ref, p: Planner
) -> dict[str, Node]:
    """The nodes `viewer` and, of a robot that MJCF can hold, `pictures`. light: `lightened`."""
    ports = {port: robot[port] for port in ("shapes.json", "meshes/")}
    shown = ports | {"tree.json": robot["tree.json"], "light/": light}
    nodes = {"viewer": p.add("viewer", Viewer(), shown)}
    if "mjcf" in recipe.targets:  # else the recipe may hold what MJCF refuses
        target = load_plugin(Target, "mjcf")
        drawn = ports | {"tree.json": robot["tree.json"], "control.json": pose}
        model = p.add(PICTURE_MODEL, target.configure(recipe), drawn)
        step = Render(renderer=renderer(p.world))
        nodes["pictures"] = p.add("pictures", step, {"mjcf/": model["mjcf/"]})
    return nodes
