"""Builds robots with a package in which one file is changed, and says what came of it."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import assetbuild
from tests.mutations.bundle import form_of
from tests.mutations.meaning import Meaning, differ, meaning
from tests.writers.plant import Bug, planted

PACKAGE = Path(assetbuild.__file__).parent
Fate = Literal["same", "refused", "missed", "caught"]
"""same: no file means anything else. refused: no bundle came out. missed: a bundle that means
something else is called ready; caught: it is not."""
SECONDS = 900


@dataclass(frozen=True)
class Trial:
    """What became of one bug, and on which robot. files: whose meaning changed."""

    bug: Bug
    fate: Fate
    robot: str = ""
    files: tuple[str, ...] = ()
    blocked_by: str = ""


class Shop:
    """Recipes that are built with a bug, and their clean bundles."""

    def __init__(self, recipes: list[Path], folder: Path) -> None:
        """folder: where packages, bundles and the store lie."""
        self.recipes, self.folder = recipes, folder
        self.clean: dict[Path, Path] = {}

    def try_one(self, bug: Bug) -> Trial:
        """The first robot whose files change their meaning decides."""
        package = self._package(bug)
        last = Trial(bug, "same")
        for recipe in self.recipes:
            last = self._tried(bug, recipe, package)
            if last.fate != "same":
                break
        shutil.rmtree(package.parent)
        return last

    def _tried(self, bug: Bug, recipe: Path, package: Path) -> Trial:
        bundle = self._built(recipe, package.parent, package.parent / recipe.stem)
        if bundle is None:
            return Trial(bug, "refused", recipe.stem)
        changed = other_files(self.clean_of(recipe), bundle)
        if not changed:
            return Trial(bug, "same")
        verdict = json.loads((bundle / "report/report.json").read_bytes())["verdict"]
        fate: Fate = "missed" if verdict["ready"] else "caught"
        reason = ", ".join(map(str, verdict["blocked_by"]))
        return Trial(bug, fate, recipe.stem, tuple(changed), reason)

    def clean_of(self, recipe: Path) -> Path:
        """The bundle of a recipe without a bug."""
        if recipe not in self.clean:
            package = self._package(None)
            bundle = self._built(recipe, package.parent, self.folder / "clean" / recipe.stem)
            assert bundle is not None, f"{recipe} does not build without a bug"
            self.clean[recipe] = bundle
        return self.clean[recipe]

    def _package(self, bug: Bug | None) -> Path:
        """A copy of the package, by links, with the bug."""
        place = Path(tempfile.mkdtemp(dir=self.folder))
        for path in PACKAGE.rglob("*"):
            name = path.relative_to(PACKAGE).as_posix()
            if path.is_dir() or "__pycache__" in name:
                continue
            copy = place / "assetbuild" / name
            copy.parent.mkdir(parents=True, exist_ok=True)
            if bug is not None and name == bug.file:
                copy.write_text(planted(PACKAGE, bug), encoding="utf-8")
            else:
                copy.symlink_to(path)
        return place / "assetbuild"

    def _built(self, recipe: Path, packages: Path, out: Path) -> Path | None:
        """The bundle, or what is written in its place where a check fails; None without either."""
        variables = {
            "PYTHONPATH": str(packages),
            "ASSETBUILD_CACHE": str(self.folder / "store"),
            "PYTHONDONTWRITEBYTECODE": "1",
            "MUJOCO_GL": "disable",  # no pictures
        }
        program = "import sys; from assetbuild.__main__ import main; sys.exit(main())"
        command = [sys.executable, "-P", "-c", program, "build", str(recipe), "-o", str(out)]
        try:
            subprocess.run(
                command,
                env=os.environ | variables,
                capture_output=True,
                timeout=SECONDS,
                check=False,
            )
        except subprocess.TimeoutExpired:
            return None
        failed = out.with_name(f"{out.name}.failed")
        found = failed if failed.exists() else out
        return found if (found / "report/report.json").exists() else None


def other_files(before: Path, after: Path) -> tuple[str, ...]:
    """The files that people read which mean something else; a USD by its main files."""
    names = {name for bundle in (before, after) for name in _read_by_people(bundle)}
    return tuple(
        name
        for name in sorted(names)
        if _bytes(before, name) != _bytes(after, name)
        and differ(_placeless(meaning(before, name)), _placeless(meaning(after, name)))
    )


def _read_by_people(bundle: Path) -> list[str]:
    endings = (".xml", ".urdf", ".py", ".yaml", ".xrdf", ".usda")
    found = (p for p in bundle.rglob("*") if p.suffix in endings and "payloads" not in p.parts)
    return [name for name in (str(p.relative_to(bundle)) for p in found) if form_of(name)]


def _bytes(bundle: Path, name: str) -> list[bytes]:
    """Return the bytes of a file, or of all layers of a USD."""
    path = bundle / name
    layers = sorted(path.parent.rglob("*.usd*")) if name.startswith("usd/") else [path]
    return [layer.read_bytes() for layer in layers if layer.exists()]


def _placeless(meant: Meaning) -> Meaning:
    """Without where files of a compiled model lie; a file that is not there means nothing."""
    if isinstance(meant, dict):
        return {k: _placeless(v) for k, v in meant.items() if not k.endswith("pathadr")}
    return [_placeless(each) for each in meant] if isinstance(meant, list) else meant
