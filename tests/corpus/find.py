"""Finds the robots of a folder: `python -m tests.corpus.find FOLDER`, one JSON line a robot.

A robot is a URDF or a xacro that expands to one, with at least one moving joint and all its meshes,
or an MJCF that MuJoCo compiles, with at least one joint and one actuator. Neither assetbuild nor
another reader of robots decides about a URDF: its text is searched for meshes and joints, so that a
file that nobody can read is found, too. A line with `lacks` names the first file that is not there,
or why it is no robot.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import re
import subprocess
import sys
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[1]))

from corpus.xacros import XacroError, expanded, packages_in

MOVING = re.compile(rb"<joint\b[^>]*\btype\s*=\s*[\"']\s*(revolute|continuous|prismatic|planar)")
MESH = re.compile(rb"<mesh\b[^>]*?\bfilename\s*=\s*[\"']([^\"']*)[\"']", re.S)
COMMENT = re.compile(rb"<!--.*?-->", re.S)
POINTER = b"version https://git-lfs"


@dataclass(frozen=True)
class Found:
    """path: below the folder; digest: of its text; lacks: "" or what is missing."""

    path: str
    digest: str
    lacks: str = ""


def robots_in(folder: Path, jobs: int = 1) -> Iterator[Found]:
    """All that look like a robot, in the order of their paths."""
    packages = packages_in(folder)
    files = sorted(path for path in folder.rglob("*") if is_candidate(path))
    included = {name for path in files if path.suffix == ".xml" for name in includes(path)}
    files = [path for path in files if path.resolve() not in included]
    with ThreadPoolExecutor(jobs) as pool:
        yield from pool.map(lambda path: found(path, folder, packages), files)


def is_candidate(path: Path) -> bool:
    if not path.is_file() or path.stat().st_size > 20e6:
        return False
    if path.suffix == ".xml":
        text = path.read_bytes()
        return b"<mujoco" in text and b"<body" in text and b"joint" in text
    return path.suffix in (".urdf", ".xacro")


def includes(mjcf: Path) -> list[Path]:
    """What an MJCF includes is a part of it, and no robot of its own."""
    names = re.findall(rb"<include\s+file\s*=\s*[\"']([^\"']+)", mjcf.read_bytes())
    return [(mjcf.parent / name.decode(errors="replace")).resolve() for name in names]


def found(path: Path, folder: Path, packages: Mapping[str, Path]) -> Found:
    name = path.relative_to(folder).as_posix()
    try:
        text = path.read_bytes()
        if path.suffix == ".xml":
            lacks = lacking_of_mjcf(path)
        else:
            text = expanded(path, {}, packages) if path.suffix == ".xacro" else text
            lacks = lacking(text, path, folder, packages)
    except XacroError as error:
        lacks = f"xacro: {error}"[:160]
    return Found(name, hashlib.sha256(b"".join(text.split())).hexdigest(), lacks)


def lacking(text: bytes, file: Path, folder: Path, packages: Mapping[str, Path]) -> str:
    """The first mesh that a URDF's text names and the folder does not hold."""
    text = COMMENT.sub(b"", text)
    if not MOVING.search(text):
        return "no moving joint"
    for name in MESH.findall(text):
        uri = name.decode(errors="replace").strip()
        path = resolved(uri, file, folder, packages)
        if path is None or not path.stat().st_size:
            return f"no file {uri}"
        with path.open("rb") as mesh:
            if mesh.read(len(POINTER)) == POINTER:
                return f"a pointer instead of {uri}"
    return ""


def resolved(uri: str, file: Path, folder: Path, packages: Mapping[str, Path]) -> Path | None:
    """The file of a mesh, where any reader of the field would look for it."""
    kind, _, rest = uri.rpartition("://")
    rest = rest.lstrip("/")
    places: list[Path] = []
    if kind == "file":
        places.append(Path("/") / rest)
    if kind in ("package", "model", "file"):
        package, _, inside = rest.partition("/")
        if package in packages:
            places.append(packages[package] / inside)
        places += [parent / inside for parent in above(file, folder) if parent.name == package]
        places += [parent / inside for parent in above(file, folder)]
    places += [parent / rest for parent in above(file, folder)]
    return next((place for place in places if place.is_file()), None)


def above(file: Path, folder: Path) -> list[Path]:
    return [parent for parent in file.parents if parent.is_relative_to(folder)]


def lacking_of_mjcf(path: Path) -> str:
    """What MuJoCo says, in a child: a file must not stop the search."""
    program = (
        "import mujoco, sys; m = mujoco.MjModel.from_xml_path(sys.argv[1]);"
        "sys.exit(0 if m.njnt and m.nu else 'no joint' if m.nu else 'no actuator')"
    )
    command = [sys.executable, "-P", "-c", program, str(path)]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, errors="replace", timeout=120
        )
    except subprocess.TimeoutExpired:
        return "MuJoCo: no end after 120 s"
    lines = done.stderr.strip().splitlines() or [f"exit code {done.returncode}"]
    return lines[-1][:160] if done.returncode else ""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args()
    for robot in robots_in(options.folder, options.jobs):
        print(json.dumps(asdict(robot)), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
