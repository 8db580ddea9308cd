"""`mjcf/scene.xml`: the robot on a floor, what people open in a viewer."""

from __future__ import annotations

from typing import ClassVar

from assetbuild.facts.mjcf_scene import SceneReader


class SceneFacts(SceneReader):
    """The scene of the full MJCF."""

    needs: ClassVar[tuple[str, ...]] = ("mjcf",)
    behind: ClassVar[tuple[str, ...]] = ("mjcf/scene.xml", "mjcf/{robot}.xml")
