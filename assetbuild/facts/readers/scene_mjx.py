"""`mjcf/scene_mjx.xml`: the mjx model on a floor."""

from __future__ import annotations

from typing import ClassVar

from assetbuild.facts.mjcf_scene import SceneReader


class SceneMjxFacts(SceneReader):
    """The scene of the mjx model."""

    needs: ClassVar[tuple[str, ...]] = ("mjx",)
    behind: ClassVar[tuple[str, ...]] = ("mjcf/scene_mjx.xml", "mjcf/{robot}_mjx.xml")
    form: ClassVar[str] = "scene_mjx"
    called: ClassVar[str] = "the scene of the mjx model"
    written: ClassVar[str] = "scene_mjx.xml"
