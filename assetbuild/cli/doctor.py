"""`assetbuild doctor`: what this machine has and lacks, and how to get it."""

from __future__ import annotations

import argparse
import importlib.metadata
import importlib.util
import os
import platform
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

Level = Literal["ok", "optional", "missing", "broken"]
CORE = (
    "numpy", "scipy", "pydantic", "trimesh", "pycollada", "fast-simplification", "coacd", "vhacdx",
    "manifold3d", "mujoco", "usd-core", "yourdfpy", "xacro",
)  # fmt: skip
EXTRAS = (
    ("oracle", "pinocchio", "kinematics and dynamics compared with pinocchio"),
    ("physx", "ovphysx", "the physical checks in PhysX too"),
    ("lint", "simcheck", "the lints of simcheck and mjcf-doctor"),
    ("dask", "distributed", "builds on more than one machine"),
    ("remote", "obstore", "a shared cache in S3"),
    ("policy", "onnxruntime", "policies in the loop"),
)
APT = "apt-get install libegl1 libgl1-mesa-dri"


@dataclass(frozen=True)
class Row:
    """One thing looked at. broken: builds fail; missing: something is left out; optional: an extra
    that is not installed."""

    name: str
    level: Level
    details: str
    fix: str = ""


def run(arguments: argparse.Namespace) -> int:
    """Print what was found; 1 when something that every build needs is broken."""
    rows = list(examine())
    for row in rows:
        print(f"{row.level:8} {row.name:18} {row.details}")
        if row.fix:
            print(f"{'':8} {'':18} -> {row.fix}")
    broken = sum(row.level == "broken" for row in rows)
    missing = sum(row.level == "missing" for row in rows)
    print(f"{broken} broken, {missing} missing" if broken or missing else "ready to build")
    return 1 if broken else 0


def examine() -> Iterator[Row]:
    """Everything that a build may want, in the order of a build."""
    from assetbuild._version import __version__

    system = f"{platform.system()} {platform.machine()}"
    yield Row("assetbuild", "ok", f"{__version__}, Python {platform.python_version()}, {system}")
    yield from _libraries()
    yield _cache()
    yield _confinement()
    git, use = shutil.which("git"), "sources by `git`, and `diff REVISION:RECIPE`"
    yield Row("git", "ok", git) if git else Row("git", "missing", use, "apt-get install git")
    yield from _pictures()
    for extra, module, use in EXTRAS:
        known = importlib.util.find_spec(module) is not None
        fix = "" if known else f"pip install 'assetbuild[{extra}]'"
        yield Row(f"extra {extra}", "ok" if known else "optional", use, fix)
    yield from _plugins()


def _libraries() -> Iterator[Row]:
    versions = {name: _version(name) for name in CORE}
    if lacking := [name for name, version in versions.items() if not version]:
        details = f"not installed: {', '.join(lacking)}"
        yield Row("libraries", "broken", details, "pip install assetbuild")
    else:
        yield Row("libraries", "ok", ", ".join(map(" ".join, versions.items())))
    if importlib.util.find_spec("pxr") and _version("usd-exchange"):
        fix = "pip uninstall usd-exchange, then pip install --force-reinstall usd-core"
        yield Row("pxr", "broken", "usd-exchange and usd-core overwrite each other", fix)


def _plugins() -> Iterator[Row]:
    """Plug-ins of other packages; one that cannot be loaded hurts only recipes that name it."""
    from assetbuild.collision import CollisionMethod
    from assetbuild.errors import MachineError
    from assetbuild.facts.reader import Reader
    from assetbuild.plugin_types import Check, Edit, Target
    from assetbuild.plugins import foreign_names, load_plugin

    for kind in (Target, Reader, Check, Edit, CollisionMethod):
        for name in foreign_names(kind):
            row = f"plug-in {name}"
            try:
                load_plugin(kind, name)
                yield Row(row, "ok", kind.group)
            except MachineError as error:
                yield Row(row, "missing", error.message, error.hint)


def _version(name: str) -> str:
    """The version of a distribution, or "" if it is not installed."""
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return ""


def _cache() -> Row:
    from assetbuild.engine.machine import cache_root

    root = Path(cache_root())
    place = next(folder for folder in (root, *root.parents) if folder.exists())
    free = shutil.disk_usage(place).free / 1e9
    details = f"{root}, {free:.1f} GB free"
    if not os.access(place, os.W_OK):
        fix = "set ASSETBUILD_CACHE to a folder that you may write to"
        return Row("store", "missing", f"{details}, not writable: builds start from nothing", fix)
    if free < 2.0:
        return Row("store", "missing", details, "assetbuild cache gc --max-size 1GB")
    return Row("store", "ok", details)


def _confinement() -> Row:
    """Landlock holds xacro files; without it a private folder and an empty environment do."""
    from assetbuild.engine.confine import version

    kernel, landlock = platform.release(), version()
    if landlock:
        return Row("Landlock", "ok", f"version {landlock}, kernel {kernel}: xacro is confined")
    fix = "Linux 5.13 or newer with Landlock; until then expand only xacro files that you trust"
    return Row("Landlock", "missing", f"not on this kernel ({kernel})", fix)


def _pictures() -> Iterator[Row]:
    from assetbuild.engine.world import World
    from assetbuild.rendering.plan import renderer
    from assetbuild.rendering.viewer import three_js

    kind = renderer(World())
    if kind == "none":
        details = "no EGL and no OSMesa, or MUJOCO_GL=disable: reports have no pictures"
        yield Row("pictures", "missing", details, APT)
    else:
        yield _tried(kind)
    library = three_js()
    if library is None:
        fix = "pip install 'trimesh>=4.6'"
        yield Row("3D view", "missing", "trimesh brings no three.js: reports have no view", fix)
    else:
        revision = re.search(r'const e="(\d+)"', library)
        yield Row("3D view", "ok", f"three.js r{revision.group(1) if revision else '?'} of trimesh")


def _tried(kind: str) -> Row:
    """A context is opened in a child: a bad driver may take its process down."""
    module = kind.partition(" ")[0]
    code = (
        f"from mujoco.{module} import GLContext\nc = GLContext(8, 8)\nc.make_current()\n"
        "from OpenGL import GL\nprint(GL.glGetString(GL.GL_RENDERER).decode())"
    )
    try:
        done = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, timeout=60
        )
    except subprocess.TimeoutExpired:
        return Row("pictures", "missing", f"OpenGL by {kind} hangs", APT)
    if done.returncode != 0:
        last = (done.stderr.strip().splitlines() or ["the process died"])[-1]
        return Row("pictures", "missing", f"OpenGL by {kind} does not start: {last[:120]}", APT)
    return Row("pictures", "ok", f"{kind}: {done.stdout.strip()}")
