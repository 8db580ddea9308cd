"""What the readers of scenes share: the robot's file on a floor, with light and sky."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

from assetbuild.errors import UsageError
from assetbuild.facts.mjcf_words import words
from assetbuild.facts.reader import Proof, Reader
from assetbuild.facts.reference import Reference
from assetbuild.facts.table import Key, Table, Value
from assetbuild.facts.vocabulary import VOCABULARY
from assetbuild.robot.floor import floor_of
from assetbuild.simulators.mujoco import caught_warnings

SHOWN = frozenset({"light", "texture", "material", "picture", "statistic", "model"})
"""Kinds that say how a scene looks."""


class SceneReader(Reader):
    """Compares the floor with the robot's, and that a scene changes nothing of the robot's file."""

    form: ClassVar[str] = "scene"
    called: ClassVar[str] = "the scene"
    folder: ClassVar[str] = "mjcf"
    preload: ClassVar[tuple[str, ...]] = ("mujoco",)
    stem: ClassVar[str] = "scene"
    lacks: ClassVar[Mapping[str, str]] = dict.fromkeys(
        {kind for kind, _ in VOCABULARY} - {"floor"}, "the robot's own file says it"
    )

    def file(self, root: Path, robot: str) -> Path | None:
        """Where the target is built."""
        path = root / f"{self.stem}.xml"
        return path if path.is_file() else None

    def prove(self, reference: Reference, path: Path) -> Proof:
        """Against the robot's file beside it, which has its own reader."""
        own = _robot_file(path, self.robot)
        return super().prove(reference, path) if own.is_file() else Proof(Table({}), (), (), 0)

    def read(self, path: Path) -> Table:
        """Words that the robot's own file does not have, and those that it has otherwise."""
        robot, scene = _words(_robot_file(path, self.robot)), _words(path)
        facts: dict[Key, Value] = {
            key: value for key, value in scene.items() if repr(robot.get(key)) != repr(value)
        }
        facts |= {key: "MuJoCo's default" for key in robot if key not in scene}
        planes = [k.name for k, v in facts.items() if k.kind == "shape" and v == "mjGEOM_PLANE"][:1]
        usual: dict[str, Value] = {"height": 0.0, "friction": (1.0, 0.005, 0.0001)}
        floor = usual if planes else {}
        for key in [key for key in facts if key.kind == "shape" and key.name in planes]:
            floor |= _of_floor(key, facts.pop(key))
        return Table({**facts, **{Key("floor", "", word): v for word, v in floor.items()}})

    def expected(self, reference: Reference) -> Table:
        """The floor below the robot, where the source's own MJCF brings none."""
        if _brings_a_floor(reference):
            return Table({})
        floor = floor_of(reference.tree, reference.control)
        said: dict[str, Value] = {
            "height": floor.height_m,
            "friction": floor.friction,
            "mjcf:type": "mjGEOM_PLANE",
        }
        return Table({Key("floor", "", word): value for word, value in said.items()})


def _robot_file(scene: Path, robot: str) -> Path:
    """`go1_mjx.xml` beside `scene_mjx.xml`."""
    return scene.with_name(f"{robot}{scene.stem.removeprefix('scene')}.xml")


def _words(path: Path) -> dict[Key, Value]:
    import mujoco

    with caught_warnings():
        try:
            said = words(mujoco.MjSpec.from_file(str(path)))
        except ValueError as error:
            text = " ".join(str(error).replace(f"{path.parent}/", "").split())
            raise UsageError(f"MuJoCo refuses it: {text}") from None
    return {key: value for key, value in said.items() if key.kind not in SHOWN}


def _of_floor(key: Key, value: Value) -> dict[str, Value]:
    """What a word of the plane says of the floor; how wide its grid is drawn is no matter."""
    word = key.quantity.removeprefix("mjcf:")
    if word in ("there", "body", "size", "material"):
        return {}
    if word == "pos" and isinstance(value, tuple) and value[:2] == (0.0, 0.0):
        return {"height": float(value[2])}
    return {word if word == "friction" else key.quantity: value}


def _brings_a_floor(reference: Reference) -> bool:
    """Whether the source's own MJCF has a plane in its world."""
    tree = reference.tree
    return tree.base == "fixed" and any(
        item.place == "body"
        and item.owner in ("", tree.root)
        and item.element.startswith("<geom")
        and 'type="plane"' in item.element
        for item in reference.control.mjcf_only
    )
