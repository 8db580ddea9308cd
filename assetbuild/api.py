"""Build a recipe and load a bundle from Python; `assetbuild.build` and `assetbuild.load_bundle`."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from assetbuild.errors import StepError, UsageError


@dataclass(frozen=True)
class Facts:
    """What a bundle's robot is. ready: for training, as its report judges; names as in the files.

    joints: those that move; actuators: the joints that a drive moves; keyframe: its first pose,
    joint -> rad or m.
    """

    robot: str
    ready: bool
    mass_kg: float
    bodies: tuple[str, ...]
    joints: tuple[str, ...]
    actuators: tuple[str, ...]
    keyframe: Mapping[str, float]


@dataclass(frozen=True)
class Bundle:
    """A built bundle. path: its folder; files: path inside the bundle -> SHA-256."""

    path: Path
    files: Mapping[str, str]

    @cached_property
    def facts(self) -> Facts:
        """Masses, names and the verdict, from `report/`; UsageError where that is missing."""
        from assetbuild.facts.reference import Reference
        from assetbuild.report.bundle import read_json
        from assetbuild.robot.inertia import total_mass

        reference = Reference.of_bundle(self.path)
        tree, control = reference.tree, reference.control
        frames = control.keyframes
        report = read_json(self.path, "report/report.json")
        return Facts(
            robot=self._robot,
            ready=bool(report["verdict"]["ready"]),
            mass_kg=total_mass(tree),
            bodies=tuple(body.name for body in tree.bodies),
            joints=tuple(joint.name for joint in tree.moving_joints),
            actuators=tuple(a.joint for a in control.actuators if a.model != "passive"),
            keyframe=dict(frames[0].joints) if frames else {},
        )

    @property
    def mjcf_path(self) -> Path:
        """The robot on a floor, `mjcf/scene.xml`: what MuJoCo loads."""
        return self.file("mjcf/scene.xml", "mjcf")

    @property
    def urdf_path(self) -> Path:
        """The clean URDF."""
        return self.file(f"urdf/{self._robot}.urdf", "urdf")

    @property
    def usd_path(self) -> Path:
        """The USD's root layer."""
        return self.file(f"usd/{self._robot}.usda", "usd")

    def file(self, name: str, target: str = "") -> Path:
        """The path of one file of the bundle. UsageError where the bundle has none of that name."""
        if name not in self.files:
            hint = f"write `{target}` into `targets` of the recipe" if target else ""
            raise UsageError(f"`{self.path}` has no file `{name}`", hint=hint)
        return self.path / name

    @cached_property
    def _robot(self) -> str:
        from assetbuild.report.bundle import read_json

        return str(read_json(self.path, "manifest.json")["robot"])


def load_bundle(path: str | os.PathLike[str]) -> Bundle:
    """The bundle in a folder. UsageError where there is none."""
    from assetbuild.report.bundle import manifest_of

    folder = Path(path)
    return Bundle(folder, manifest_of(folder))


def build(
    recipe: str | os.PathLike[str],
    out: str | os.PathLike[str] | None = None,
    *,
    variant: str | None = None,
    frozen: bool = False,
) -> Bundle:
    """Build a recipe, as `assetbuild build` does; only stale steps run.

    out: default `build/<robot>`; frozen: fail rather than write a lock. Raises AssetBuildError
    for wrong input, and where a step failed or a check found an error.
    """
    from assetbuild.pipeline.building import Request, build_all

    place = Path(out) if out is not None else None
    request = Request(recipe=Path(recipe), out=place, variant=variant, frozen=frozen)
    (outcome,) = build_all([request], lambda event: None, lambda line: None)
    for error in outcome.errors:
        raise error
    if outcome.out is None or outcome.exit_code:
        reason = outcome.report.verdict.next_step if outcome.report else "a step failed"
        where = f"; its report lies in `{outcome.out}`" if outcome.out else ""
        raise StepError(f"{recipe} did not pass its checks: {reason}{where}")
    return load_bundle(outcome.out)
