"""Time and gravity that the modules for trainers set: read from their text, which is never run.

A policy is trained with what the module says, whatever the model beside it does. mjlab's sets
MuJoCo's options, Isaac Lab's PhysX's; each row has the other engine's scene beside it.
"""

from __future__ import annotations

import ast
import contextlib
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from assetbuild.checks.alignment.row import NUMBER, Row

Constants = Mapping[str, object]
ISAACLAB = {"dt": "timestep", "gravity": "gravity"}
"""Keywords of Isaac Lab's SimulationCfg."""
MJLAB = ("timestep", "gravity")
"""Fields of mjlab's `cfg.sim.mujoco`."""


@dataclass(frozen=True)
class World:
    """timestep: s; gravity: (3,) m/s². None = not stated, or not in plain."""

    timestep: float | None
    gravity: tuple[float, ...] | None


def module_rows(inputs: Path, mujoco: World, physx: World) -> Iterator[Row]:
    """Two rows for each module below `mjlab/` and `isaaclab/`. mujoco, physx: of the scenes."""
    for path in sorted((inputs / "mjlab").glob("python/*_mjlab.py")):
        yield from _rows(path.name, mjlab_world(path.read_text("utf-8")), physx, is_physx=False)
    for path in sorted((inputs / "isaaclab").glob("*_isaaclab_[0-9].py")):
        yield from _rows(path.name, isaaclab_world(path.read_text("utf-8")), mujoco, is_physx=True)


def mjlab_world(text: str) -> World:
    """What the velocity task is given; without one, the constants that the module offers."""
    module = ast.parse(text)
    known = _constants(module)
    set_ = {name: known.get(name.upper()) for name in MJLAB}
    for node in ast.walk(module):
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Attribute):
            field = ast.unparse(node.targets[0]).partition("sim.mujoco.")[2]
            if field in set_:
                set_[field] = _value(node.value, known)
    return _world(set_)


def isaaclab_world(text: str) -> World:
    """The arguments of its SimulationCfg; one that is not given has a default of Isaac Lab's."""
    module = ast.parse(text)
    known = _constants(module)
    set_: dict[str, object] = {}
    for node in ast.walk(module):
        if isinstance(node, ast.Call) and ast.unparse(node.func).endswith("SimulationCfg"):
            for keyword in node.keywords:
                if keyword.arg in ISAACLAB:
                    set_[ISAACLAB[keyword.arg]] = _value(keyword.value, known)
    return _world(set_)


def _constants(module: ast.Module) -> dict[str, object]:
    """Names that the module gives plain values to, `A, B = 1, 2` too."""
    found: dict[str, object] = {}
    for node in module.body:
        if not isinstance(node, ast.Assign):
            continue
        target, value = node.targets[0], node.value
        pairs = [(target, value)]
        if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
            pairs = list(zip(target.elts, value.elts, strict=False))
        for name, plain in pairs:
            if isinstance(name, ast.Name):
                found[name.id] = _value(plain, found)
    return found


def _value(node: ast.expr, known: Constants) -> object:
    if isinstance(node, ast.Name):
        return known.get(node.id)
    with contextlib.suppress(ValueError, TypeError):
        return ast.literal_eval(node)
    return None


def _world(set_: Mapping[str, object]) -> World:
    timestep, gravity = set_.get("timestep"), set_.get("gravity")
    is_vector = isinstance(gravity, tuple) and all(isinstance(v, int | float) for v in gravity)
    return World(
        float(timestep) if isinstance(timestep, int | float) else None,
        tuple(map(float, gravity)) if isinstance(gravity, tuple) and is_vector else None,
    )


def _rows(name: str, theirs: World, scene: World, *, is_physx: bool) -> Iterator[Row]:
    """MuJoCo's side is the module's or the scene's, as the trainer runs in PhysX or not."""
    subject, off = f"module {name}", math.nan
    if theirs.timestep is not None and scene.timestep is not None:
        off = abs(theirs.timestep - scene.timestep) / scene.timestep
    sides: tuple[float | str, float | str] = (_step(scene), _step(theirs))
    mujoco, physx = sides if is_physx else sides[::-1]
    yield Row("timestep", "CRITICAL", subject, mujoco, physx, off, *NUMBER, "of it")
    off = math.nan
    if theirs.gravity is not None and scene.gravity is not None:
        off = max(abs(a - b) for a, b in zip(theirs.gravity, scene.gravity, strict=True))
    words = (_pull(scene), _pull(theirs))
    mujoco, physx = words if is_physx else words[::-1]
    yield Row("gravity", "CRITICAL", subject, mujoco, physx, off, 1e-5, 0.01, "m/s²")


def _step(world: World) -> float | str:
    return "not stated" if world.timestep is None else world.timestep


def _pull(world: World) -> str:
    return " ".join(f"{v:.6g}" for v in world.gravity) if world.gravity else "not stated"
