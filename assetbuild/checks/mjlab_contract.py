"""Do the bare MJCF and its module keep what mjlab 1.6 asks of a robot?"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from assetbuild.engine.step import Files
from assetbuild.errors import StepError
from assetbuild.findings import Finding, Rule
from assetbuild.kinds import Check, write_figures
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.model import Control, Tree
from assetbuild.simulators import mujoco

COLLISION = re.compile(r".*_collision\d*")
SENSORS = ("imu_ang_vel", "imu_lin_vel", "root_angmom")
"""What mjlab's velocity task reads."""
SINGLE = {"ROOT_BODY": "body", "IMU_SITE": "site"}
SEVERAL = {"FOOT_SITES": "site", "FOOT_GEOMS": "geom", "JOINTS": "joint", "ACTION_SCALE": "joint"}
"""Constants of the module -> what in the MJCF they name; mjlab takes all as patterns."""

LOAD = Rule("mjlab.load", "error", "MuJoCo refuses the bare MJCF", "see `mjcf.load`")
CONTRACT = Rule(
    "mjlab.contract",
    "error",
    "the bare MJCF or its module breaks what mjlab asks for",
    "report it: this is a bug",
)
BURIED = Rule(
    "mjlab.buried",
    "error",
    "a floating robot without keyframes rests in the ground, where mjlab counts its contacts",
    "add a keyframe `home` with `base: on_ground`",
)


class MjlabContract(Check):
    """One finding per broken promise."""

    isolated = True
    preload = ("mujoco",)
    needs = ("mjlab",)
    reads = ("tree.json", "control.json")

    robot: str

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads `mjlab/mjcf/<robot>_bare.xml` and the module."""
        stored = RobotFiles(files.inputs)
        try:
            model = mujoco.load(
                files.inputs / "mjlab/mjcf" / f"{self.robot}_bare.xml", visuals=False
            ).model
        except StepError as error:
            write_figures(files, {"skipped": "it does not load"})
            yield LOAD("robot", f"MuJoCo refuses it: {error.message}")
            return
        broken = [*_foreign(model), *_names(model), *_task(model, stored.tree)]
        for path in sorted((files.inputs / "mjlab/python").glob("*.py")):
            try:
                module = ast.parse(path.read_text(encoding="utf-8"), path.name)
            except SyntaxError as error:
                broken.append(f"{path.name}:{error.lineno}: {error.msg}")
            else:
                broken += [f"{path.name}: {message}" for message in _Module(module, model).broken()]
        write_figures(files, {"sensors": int(model.nsensor), "sites": int(model.nsite)})
        for message in broken:
            yield CONTRACT(
                "robot", message, hint="mjlab would refuse or misread it: please report it"
            )
        yield from _buried(model, stored.tree, stored.control)


def _foreign(model: mujoco.Model) -> Iterator[str]:
    for what, count in (("actuators", model.nu), ("keyframes", model.nkey)):
        if count:
            yield f"{count} {what} in the bare MJCF: mjlab's configs bring their own"


def _names(model: mujoco.Model) -> Iterator[str]:
    for i in range(model.ngeom):
        name = mujoco.name_of(model, "geom", i)
        collides = bool(model.geom_contype[i] or model.geom_conaffinity[i])
        if collides and not COLLISION.fullmatch(name):
            yield f"collision geom `{name}` is not called `*_collision`: no config finds it"


def _task(model: mujoco.Model, tree: Tree) -> Iterator[str]:
    if tree.base == "fixed":
        return
    there = {mujoco.name_of(model, "sensor", i) for i in range(model.nsensor)}
    for name in SENSORS:
        if name not in there:
            yield f"no sensor `{name}`, which mjlab's velocity task reads"
    if model.njnt == 0 or int(model.jnt_type[0]) != 0:
        yield "the first joint is not the free joint of the base"


def _buried(model: mujoco.Model, tree: Tree, control: Control) -> Iterator[Finding]:
    if tree.base == "fixed" or float(model.qpos0[2]) > 0.0:
        return
    message = "the root rests in the ground: mjlab counts its contacts before the first reset"
    if control.keyframes:
        yield CONTRACT("robot", message, hint="mjlab would refuse it: please report it")
    else:
        hint = "add a keyframe `home` with `base: on_ground`"
        yield BURIED("robot", message, hint=hint)


# --- the module -----------------------------------------------------------------------------


@dataclass(frozen=True)
class _Module:
    """The module's syntax tree beside the model that its patterns are matched against."""

    tree: ast.Module
    model: mujoco.Model

    def broken(self) -> Iterator[str]:
        """What mjlab would refuse or misread."""
        constants = self._constants()
        for constant, kind in SINGLE.items():
            if constant in constants and constants[constant] not in self._all(kind):
                yield f"`{constant}`: no {kind} is called `{constants[constant]}`"
        for constant, kind in SEVERAL.items():
            if constant in constants:
                yield from _unmatched(constant, _listed(constants[constant]), self._all(kind))
        drives = list(self._patterns("target_names_expr", constants))
        yield from _unmatched("target_names_expr", drives, self._all("joint"))
        yield from self._feet(constants)

    def _constants(self) -> dict[str, object]:
        """Literals at the top of the module, by name."""
        found: dict[str, object] = {}
        for node in self.tree.body:
            if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
                try:
                    found[node.targets[0].id] = ast.literal_eval(node.value)
                except ValueError:  # an expression, such as the path of the MJCF
                    continue
        return found

    def _patterns(self, keyword: str, constants: Mapping[str, object]) -> Iterator[str]:
        """All patterns that calls are given under a keyword."""
        for node in ast.walk(self.tree):
            if isinstance(node, ast.keyword) and node.arg == keyword:
                yield from _listed(_value(node.value, constants))

    def _feet(self, constants: Mapping[str, object]) -> Iterator[str]:
        """The contact sensor and the sites of the feet: one of each, and in the same order."""
        primary = next(
            (
                node.value
                for node in ast.walk(self.tree)
                if isinstance(node, ast.keyword) and node.arg == "primary"
            ),
            None,
        )
        if not isinstance(primary, ast.Call):
            return
        given = {word.arg: _value(word.value, constants) for word in primary.keywords}
        kind, patterns = str(given.get("mode")), _listed(given.get("pattern"))
        yield from _unmatched("the contact sensor", patterns, self._all(kind))
        sites = _listed(constants.get("FOOT_SITES"))
        touching = [n for n in self._all(kind) if any(re.fullmatch(p, n) for p in patterns)]
        bodies = [self._body_of(kind, name) for name in touching]
        standing = [self._body_of("site", site) for site in sites if site in self._all("site")]
        if bodies != standing:
            yield (
                f"the contact sensor counts {len(touching)} feet ({', '.join(bodies)}) where "
                f"`FOOT_SITES` has {len(sites)} ({', '.join(standing)}): mjlab's rewards take them "
                "in pairs"
            )

    def _all(self, kind: str) -> list[str]:
        """Names in the order of the model. kind: body, joint, geom or site."""
        counts = {"body": "nbody", "joint": "njnt", "geom": "ngeom", "site": "nsite"}
        count = int(getattr(self.model, counts[kind]))
        return [mujoco.name_of(self.model, kind, i) for i in range(count)]

    def _body_of(self, kind: str, name: str) -> str:
        if kind == "body":
            return name
        return mujoco.name_of(self.model, "body", int(getattr(self.model, kind)(name).bodyid[0]))


def _value(node: ast.expr, constants: Mapping[str, object]) -> object:
    """A literal, or the constant that a name stands for; None for anything else."""
    if isinstance(node, ast.Name):
        return constants.get(node.id)
    try:
        return ast.literal_eval(node)
    except ValueError:
        return None


def _listed(value: object) -> list[str]:
    if isinstance(value, str):
        return [value]
    return [str(item) for item in value] if isinstance(value, tuple | list | dict) else []


def _unmatched(where: str, patterns: Sequence[str], names: Sequence[str]) -> Iterator[str]:
    """mjlab refuses a pattern that matches nothing, and a name that two patterns match."""
    for pattern in patterns:
        if not any(re.fullmatch(pattern, name) for name in names):
            yield f"{where}: `{pattern}` matches nothing in the bare MJCF"
    for name in names:
        twice = [pattern for pattern in patterns if re.fullmatch(pattern, name)]
        if len(twice) > 1:
            yield f"{where}: `{name}` has multiple matches, `{twice[0]}` and `{twice[1]}`"
