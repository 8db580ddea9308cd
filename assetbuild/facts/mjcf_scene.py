"""What the readers of scenes share: the robot's file on a floor, with light and sky."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

from assetbuild.errors import UsageError
from assetbuild.facts.compare import EXACT, Precision
from assetbuild.facts.mjcf_words import words
from assetbuild.facts.reader import Proof, Reader
from assetbuild.facts.reference import Reference
from assetbuild.facts.table import Key, Table, Value
from assetbuild.facts.vocabulary import VOCABULARY
from assetbuild.robot.floor import floor_of, starting_origins
from assetbuild.simulators.mujoco import caught_warnings

LOOKS: Mapping[tuple[str, str], Value] = {
    ("light", "body"): "",
    ("light", "pos"): (0.0, 0.0, 2.5),
    ("light", "type"): "mjLIGHT_DIRECTIONAL",
    ("sky", "builtin"): "mjBUILTIN_GRADIENT",
    ("sky", "type"): "mjTEXTURE_SKYBOX",
    ("sky", "rgb1"): (0.55, 0.7, 0.85),
    ("sky", "rgb2"): (0.1, 0.15, 0.2),
    ("sky", "width"): 256.0,
    ("sky", "height"): 1536.0,
    ("ground", "type"): "mjTEXTURE_2D",
    ("ground", "builtin"): "mjBUILTIN_CHECKER",
    ("ground", "mark"): "mjMARK_EDGE",
    ("ground", "markrgb"): (0.6, 0.6, 0.6),
    ("ground", "rgb1"): (0.22, 0.28, 0.34),
    ("ground", "rgb2"): (0.16, 0.2, 0.25),
    ("ground", "width"): 300.0,
    ("ground", "height"): 300.0,
    ("floor", "reflectance"): 0.1,
    ("floor", "texrepeat"): (4.0, 4.0),
    ("floor", "texuniform"): True,
    ("floor", "texture"): "the ground",
    ("picture", "headlight.ambient"): (0.35, 0.35, 0.35),
    ("picture", "headlight.diffuse"): (0.5, 0.5, 0.5),
    ("picture", "headlight.specular"): (0.0, 0.0, 0.0),
    ("picture", "rgba.haze"): (0.25, 0.35, 0.45, 1.0),
    ("picture", "global.azimuth"): 140.0,
    ("picture", "global.elevation"): -20.0,
    ("picture", "global.offheight"): 960.0,
    ("picture", "global.offwidth"): 1280.0,
}
"""What every scene of ours looks like: the same light and ground in all bundles."""
SMALLEST_M = 0.5


class SceneReader(Reader):
    """Compares what a scene adds to the robot's file, and that it changes nothing of that."""

    form: ClassVar[str] = "scene"
    called: ClassVar[str] = "the scene"
    folder: ClassVar[str] = "mjcf"
    preload: ClassVar[tuple[str, ...]] = ("mujoco",)
    precision: ClassVar[Precision] = Precision({**EXACT, "number": 1e-7, "vector": 1e-7})
    """MuJoCo keeps colours and lights as float32."""
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
        facts: dict[Key, Value] = {}
        facts |= {k: v for k, v in scene.items() if repr(robot.get(k)) != repr(v)}
        facts |= {key: "MuJoCo's default" for key in robot if key not in scene}
        return Table(_named(facts))

    def expected(self, reference: Reference) -> Table:
        """The floor below the robot, the camera that shows it whole, light and ground."""
        facts: dict[Key, Value] = {
            _key(subject, word): value
            for (subject, word), value in LOOKS.items()
            if subject not in ("ground", "floor") or not _brings_a_floor(reference)
        }
        facts[Key("model", "", "mjcf:name")] = f"{self.robot} scene"
        points = starting_origins(reference.tree, reference.control)
        lower, upper = points.min(axis=0), points.max(axis=0)
        middle = tuple(round(float(v), 2) for v in (lower + upper) / 2)
        facts[Key("statistic", "", "mjcf:center")] = middle
        extent = round(max(SMALLEST_M, math.dist(lower, upper)), 2)
        facts[Key("statistic", "", "mjcf:extent")] = extent
        if _brings_a_floor(reference):
            return Table(facts)
        floor = floor_of(reference.tree, reference.control)
        facts[Key("floor", "", "height")] = floor.height_m
        facts[Key("floor", "", "friction")] = floor.friction
        facts[Key("floor", "", "mjcf:type")] = "mjGEOM_PLANE"
        facts[Key("floor", "", "mjcf:size")] = (0.0, 0.0, 0.05)
        facts[Key("floor", "", "mjcf:material")] = "the ground"
        return Table(facts)


def _robot_file(scene: Path, robot: str) -> Path:
    """`go1_mjx.xml` beside `scene_mjx.xml`."""
    return scene.with_name(f"{robot}{scene.stem.removeprefix('scene')}.xml")


def _words(path: Path) -> dict[Key, Value]:
    import mujoco

    with caught_warnings():
        try:
            return words(mujoco.MjSpec.from_file(str(path)))
        except ValueError as error:
            text = " ".join(str(error).replace(f"{path.parent}/", "").split())
            raise UsageError(f"MuJoCo refuses it: {text}") from None


def _key(subject: str, word: str) -> Key:
    kind = {"sky": "texture", "ground": "texture", "floor": "material"}.get(subject, subject)
    name = {"light": "#0", "sky": "#0", "ground": "ground", "floor": "ground"}.get(subject, "")
    return Key(kind, name, f"mjcf:{word}")


def _named(facts: Mapping[Key, Value]) -> dict[Key, Value]:
    """The first plane of the world as the floor, its texture and material as the ground."""
    found: dict[Key, Value] = {}
    planes = [k.name for k, v in facts.items() if k.kind == "shape" and v == "mjGEOM_PLANE"][:1]
    worn = {k.name: str(v) for k, v in facts.items() if k.quantity == "mjcf:material"}
    grounds = {worn[name] for name in planes if name in worn}
    for key, value in facts.items():
        if key.kind == "shape" and key.name in planes:
            found |= _floor(key, value, grounds)
            continue
        if key.kind in ("texture", "material") and key.name in grounds:
            key = key._replace(name="ground")
        if key.quantity == "mjcf:textures" and isinstance(value, tuple):
            shown = [str(v) for v in value if v]
            key = key._replace(quantity="mjcf:texture")
            value = "the ground" if shown and set(shown) <= grounds else " ".join(shown)
        found[key] = value
    if planes and not any(k.quantity == "height" for k in found):
        found[Key("floor", "", "height")] = 0.0
    if planes and not any(k.quantity == "friction" for k in found):
        found[Key("floor", "", "friction")] = (1.0, 0.005, 0.0001)
    return found


def _floor(key: Key, value: Value, grounds: set[str]) -> dict[Key, Value]:
    word = key.quantity.removeprefix("mjcf:")
    if word == "body":
        return {}
    if word == "pos" and isinstance(value, tuple) and value[:2] == (0.0, 0.0):
        return {Key("floor", "", "height"): float(value[2])}
    if word == "friction":
        return {Key("floor", "", "friction"): value}
    if word == "material":
        value = "the ground" if value in grounds else value
    return {Key("floor", "", f"mjcf:{word}"): value}


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
