"""`scene.xml`: the robot on a floor, with light, sky and haze; what people open in a viewer."""

from __future__ import annotations

import math
from xml.etree.ElementTree import Element, fromstring

from assetbuild.robot.floor import Floor, brings_floor, floor_of, starting_origins
from assetbuild.robot.pose import Array
from assetbuild.targets.mjcf.robot_xml import RobotXml
from assetbuild.targets.mjcf.xml import element, numbers

SMALLEST_EXTENT_M = 0.5
_SCENE = """
<mujoco>
  <visual>
    <headlight diffuse="0.5 0.5 0.5" ambient="0.35 0.35 0.35" specular="0 0 0"/>
    <quality shadowsize="4096"/>
    <rgba haze="0.25 0.35 0.45 1"/>
    <global azimuth="140" elevation="-20" offwidth="1280" offheight="960"/>
  </visual>
  <asset>
    <texture type="skybox" builtin="gradient" rgb1="0.55 0.7 0.85" rgb2="0.1 0.15 0.2" width="256"
      height="1536"/>
  </asset>
  <worldbody>
    <light pos="0 0 2.5" dir="0 0 -1" directional="true"/>
  </worldbody>
</mujoco>
"""
_GROUND = """
<asset>
  <texture name="{ground}" type="2d" builtin="checker" mark="edge" rgb1="0.22 0.28 0.34"
    rgb2="0.16 0.2 0.25" markrgb="0.6 0.6 0.6" width="300" height="300"/>
  <material name="{ground}" texture="{ground}" texuniform="true" texrepeat="4 4"
    reflectance="0.1"/>
</asset>
"""


def scene(model: RobotXml, file: str) -> Element:
    """The root element of `scene.xml`. file: stem of the robot's own file."""
    tree, control = model.tree, model.control
    center, extent = view(starting_origins(tree, control))
    root = fromstring(_SCENE)  # noqa: S314 # our own text
    root.set("model", f"{model.robot} scene")
    root[:0] = [
        element("include", {"file": f"{file}.xml"}),
        element("statistic", {"center": numbers(center), "extent": numbers([extent])}),
    ]
    if not brings_floor(tree, control):
        ground = model.free_name("ground")
        root[-2].extend(fromstring(_GROUND.format(ground=ground)))  # noqa: S314 # our own text
        root[-1].append(_floor(ground, model.free_name("floor"), floor_of(tree, control)))
    return root


def view(origins: Array) -> tuple[tuple[float, ...], float]:
    """Middle (m) and size (m) of the robot, for the camera; 2 digits."""
    lower, upper = origins.min(axis=0), origins.max(axis=0)
    size = max(SMALLEST_EXTENT_M, math.dist(lower, upper))
    center = tuple(round(float(v), 2) for v in (lower + upper) / 2)
    return center, round(size, 2)


def _floor(material: str, name: str, ground: Floor) -> Element:
    floor: dict[str, str | None] = {
        "name": name,
        "type": "plane",
        "size": "0 0 0.05",
        "pos": numbers((0.0, 0.0, ground.height_m)) if ground.height_m else None,
        "friction": numbers(ground.friction),
        "material": material,
    }
    return element("geom", floor)
