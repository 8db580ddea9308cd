"""Expands a xacro as ROS does, with the xacro library alone, in a child with a time limit.

The corpus needs the source as other readers see it, so nothing of assetbuild is used here.
As a program: `python xacros.py FILE ARGS PACKAGES`, the last two being JSON objects.
"""

from __future__ import annotations

import json
import re
import resource
import subprocess
import sys
import types
from collections.abc import Mapping
from pathlib import Path

SECONDS = 60
MEMORY_BYTES = 2 << 30


class XacroError(Exception):
    """The xacro library does not expand the file; the text is its last line."""


def expanded(file: Path, args: Mapping[str, str], packages: Mapping[str, Path]) -> bytes:
    """The URDF text; packages: the folder of every `$(find NAME)`."""
    folders = {name: str(path) for name, path in packages.items()}
    command = [sys.executable, "-P", __file__, str(file), json.dumps(dict(args))]
    try:
        done = subprocess.run(
            [*command, json.dumps(folders)],
            capture_output=True,
            timeout=SECONDS,
            stdin=subprocess.DEVNULL,
        )
    except subprocess.TimeoutExpired:
        raise XacroError(f"no end after {SECONDS} s") from None
    if done.returncode:
        lines = done.stderr.decode(errors="replace").strip().splitlines()
        raise XacroError(lines[-1] if lines else f"exit code {done.returncode}")
    return done.stdout


def packages_in(folder: Path) -> dict[str, Path]:
    """The folder of every `package.xml` below, by the name that it states; the highest one wins."""
    found: dict[str, Path] = {}
    for file in sorted(folder.rglob("package.xml"), key=lambda path: len(path.parts)):
        name = re.search(r"<name>\s*([\w-]+)\s*</name>", file.read_text(errors="replace"))
        if name:
            found.setdefault(name[1], file.parent)
    return found


def _main(file: str, args: str, packages: str) -> None:
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS))
    index = types.ModuleType("ament_index_python.packages")
    index.get_package_share_directory = json.loads(packages).__getitem__  # type: ignore[attr-defined] # a stand-in
    sys.modules["ament_index_python"] = types.ModuleType("ament_index_python")
    sys.modules["ament_index_python.packages"] = index
    import xacro

    document = xacro.process_file(file, mappings=json.loads(args))
    sys.stdout.buffer.write(document.toxml(encoding="utf-8"))


if __name__ == "__main__":
    _main(*sys.argv[1:])
