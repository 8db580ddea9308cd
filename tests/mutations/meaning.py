"""Whether a changed file means something else, by the library of its own format."""

from __future__ import annotations

import ast
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree

from assetbuild.errors import AssetBuildError
from assetbuild.facts.reference import Reference
from tests.mutations.bundle import form_of
from tests.mutations.change import numbers_in
from tests.mutations.text import load

Meaning = Any  # compared with == by `differ`, or None where the library refuses the file
UNNAMED = {"signature", "narena", "nbuffer", "paths", "names_map", "path_meshadr", "npaths"}
"""Fields of a compiled model that state where it came from and how much memory it takes."""
DEFAULTS = {
    ("origin", "xyz"): (0.0, 0.0, 0.0), ("origin", "rpy"): (0.0, 0.0, 0.0),
    ("axis", "xyz"): (1.0, 0.0, 0.0), ("mesh", "scale"): (1.0, 1.0, 1.0),
    ("dynamics", "damping"): (0.0,), ("dynamics", "friction"): (0.0,),
    ("limit", "lower"): (0.0,), ("limit", "upper"): (0.0,),
    ("mimic", "multiplier"): (1.0,), ("mimic", "offset"): (0.0,),
}  # fmt: skip
"""What a URDF means by not stating it."""
EMPTY = ("origin", "axis", "dynamics")
"""Elements that say nothing where all they say is that."""


def meaning(bundle: Path, file: str) -> Meaning:
    """What a file of the bundle means; None where it means nothing, because it is refused."""
    form = form_of(file)
    try:
        if form == "mjcf":
            return [compiled(path) for path in _models(bundle, file)]
        if form == "usd":
            return composed(bundle)
        if file.endswith(".urdf"):
            return _element(etree.parse(str(bundle / file)).getroot())
        if file.endswith(".obj"):
            return _mesh(bundle / file)
        if file.endswith(".mtl"):
            lines = (bundle / file).read_text(encoding="utf-8").splitlines()
            return [[numbers_in(word) or word for word in line.split()] for line in lines]
        if file.endswith(".png"):
            return _pixels(bundle / file)
        if form == "python":
            return ast.dump(ast.parse((bundle / file).read_text(encoding="utf-8")))
        return load(bundle / file) if form != "robot" else _robot(bundle)
    except (AssetBuildError, LookupError, ValueError, SyntaxError, OSError, RuntimeError):
        return None


def differ(one: Meaning, two: Meaning) -> bool:
    """Whether two meanings differ by more than rounding."""
    if isinstance(one, dict) and isinstance(two, dict):
        return one.keys() != two.keys() or any(differ(one[k], two[k]) for k in one)
    if isinstance(one, list | tuple) and isinstance(two, list | tuple):
        return len(one) != len(two) or any(differ(a, b) for a, b in zip(one, two, strict=True))
    if isinstance(one, np.ndarray) and isinstance(two, np.ndarray):
        if one.shape != two.shape or one.dtype.kind not in "f":
            return not np.array_equal(one, two)
        return not np.allclose(one, two, rtol=1e-9, atol=1e-14, equal_nan=True)
    if isinstance(one, float) and isinstance(two, float):
        return not (one == two or abs(one - two) <= 1e-9 * abs(one))
    return type(one) is not type(two) or bool(one != two)


# --- MJCF


def _models(bundle: Path, file: str) -> list[Path]:
    """The models that a file of the MJCF's folder is part of: itself, or all of an asset's."""
    own = bundle / file
    return [own] if own.suffix == ".xml" else sorted((bundle / "mjcf").glob("*.xml"))


def compiled(path: Path) -> dict[str, Meaning]:
    """Every array and number of the compiled model, names included. ValueError: refused."""
    import mujoco

    return _fields(mujoco.MjModel.from_xml_path(str(path)))


def _fields(model: object) -> dict[str, Meaning]:
    found: dict[str, Meaning] = {}
    for name in dir(model):
        if name.startswith("_") or name in UNNAMED:
            continue
        value = getattr(model, name)
        if isinstance(value, np.ndarray):
            found[name] = value.copy()
        elif isinstance(value, bool | int | float | bytes | str):
            found[name] = value
        elif not callable(value):
            found[name] = _fields(value)
    return found


# --- USD


def composed(bundle: Path) -> list[Meaning]:
    """Every field of every spec of the flattened stages, the robot's and its scene's."""
    from pxr import Usd

    found: list[Meaning] = []
    for root in sorted((bundle / "usd").glob("*.usd*")):
        stage = Usd.Stage.Open(str(root))
        instances = _opened(stage)
        flat = stage.Flatten(addSourceFileComment=False)
        found += [instances, _specs(flat, Usd.Stage.Open(flat), bundle)]
    return found


def _specs(flat: Any, stage: Any, bundle: Path) -> dict[str, Meaning]:  # a layer and its stage
    """Every spec by its path, without attributes that say what their schema says anyway."""
    from pxr import Sdf

    paths: list[Sdf.Path] = []
    flat.Traverse(Sdf.Path.absoluteRootPath, paths.append)
    found: dict[str, Meaning] = {}
    for path in paths:
        spec = None if path.IsTargetPath() else flat.GetObjectAtPath(path)
        if isinstance(spec, Sdf.AttributeSpec) and not spec.connectionPathList.explicitItems:
            definition = stage.GetPrimAtPath(path.GetPrimPath()).GetPrimDefinition()
            fallback = definition.GetAttributeFallbackValue(path.name)
            said = _plain(spec.default, bundle)
            if fallback is not None and (
                said is None or not differ(said, _plain(fallback, bundle))
            ):
                continue
        if spec is not None:
            fields = {key: spec.GetInfo(key) for key in spec.ListInfoKeys()}
            found[str(path)] = {key: _plain(value, bundle) for key, value in fields.items()}
    return found


def _opened(stage: Any) -> list[str]:  # a stage
    """The instances of a stage, which stand in its flattened form without numbered prototypes."""
    stage.SetEditTarget(stage.GetSessionLayer())
    found: list[str] = []
    while instances := [prim for prim in stage.Traverse() if prim.IsInstance()]:
        for prim in instances:
            found.append(str(prim.GetPath()))
            prim.SetInstanceable(False)
    return sorted(found)


def _plain(value: Any, bundle: Path) -> Meaning:  # whatever a field holds
    name = type(value).__name__
    if name.endswith("Array"):
        return np.array(value)
    if name == "AssetPath":
        return str(value).replace(str(bundle), "")
    if name.startswith("Quat") and not name.endswith("Array"):
        return _unit([value.real, *value.imaginary])
    return value


# --- the others


def _element(element: etree._Element) -> Meaning:
    """Its tag, attributes and children; numbers as numbers, without what URDF's defaults say."""
    stated = {str(k): numbers_in(str(v)) or str(v) for k, v in element.attrib.items()}
    tag = str(element.tag)
    attributes = {k: v for k, v in stated.items() if DEFAULTS.get((tag, k)) != v}
    children = [_element(child) for child in element if isinstance(child.tag, str)]
    kept = [child for child in children if child[1:] != [{}, "", []] or child[0] not in EMPTY]
    return [tag, attributes, (element.text or "").strip(), kept]


def _robot(bundle: Path) -> Meaning:
    """The robot as it is read, its quaternions as the rotations that they are."""
    return _turned(json.loads(Reference.of_bundle(bundle).to_json()))


def _turned(value: Meaning) -> Meaning:
    if isinstance(value, dict):
        return {k: _unit(v) if k == "quat" else _turned(v) for k, v in value.items()}
    return [_turned(item) for item in value] if isinstance(value, list) else value


def _unit(quat: list[float]) -> list[float]:
    size = math.hypot(*quat) or 1.0
    first = next((part for part in quat if part), 1.0)
    return [math.copysign(1.0, first) * part / size for part in quat]


def _mesh(path: Path) -> Meaning:
    """The triangles of a Wavefront file by the values of their corners, under their material."""
    rows: dict[str, list[tuple[float, ...]]] = {"v": [], "vt": [], "vn": []}
    faces: list[tuple[list[str], list[list[str]]]] = []
    looks: list[str] = []
    for line in path.read_text(encoding="utf-8").splitlines():
        word, *parts = line.split() or [""]
        if word in rows:
            rows[word].append(tuple(map(float, parts)))
        elif word == "f":
            faces.append((looks, [part.split("/") for part in parts]))
        elif word in ("usemtl", "mtllib"):
            looks = [*looks, *parts][-2:]
    return [(look, *(_corner(corner, rows) for corner in face)) for look, face in faces]


def _corner(corner: list[str], rows: dict[str, list[tuple[float, ...]]]) -> Meaning:
    """Place, texture coordinates and normal of a corner."""
    named = zip(("v", "vt", "vn"), corner, strict=False)
    return tuple(rows[name][int(index) - 1] for name, index in named if index)


def _pixels(path: Path) -> Meaning:
    from PIL import Image

    with Image.open(path) as picture:
        return np.array(picture.convert("RGBA"))
