"""A xacro file to plain URDF, as a program of strangers: see `xacro_child`."""

from __future__ import annotations

import json
import os
import posixpath
import re
import subprocess
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, ClassVar

from pydantic import Field

from assetbuild.engine.confine import bare_environment
from assetbuild.engine.step import Files, Limits, Step
from assetbuild.errors import SourceError, Where, did_you_mean, nearest, quoted
from assetbuild.findings import Finding, Rule
from assetbuild.lfs import refuse_pointer
from assetbuild.source.urdf.xml import read_xml

SECONDS = 30.0
"""Wall-clock limit of the expansion; real robots take less than one."""
PROGRAM = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); "
    "from assetbuild.source.urdf import xacro_child; xacro_child.main()"
)
BEYOND_IMPORTS = ("assetbuild.source.urdf.xacro_child",)
NOT_INCLUDED = (
    ".stl", ".dae", ".obj", ".mtl", ".ply", ".glb", ".gltf", ".fbx", ".3ds", ".blend", ".max",
    ".step", ".stp", ".iges", ".igs", ".sldprt", ".sldasm", ".usd", ".usda", ".usdc", ".usdz",
    ".cdf", ".vtk", ".pcd", ".png", ".jpg", ".jpeg", ".gif", ".bmp", ".tga", ".tif", ".tiff",
    ".webp", ".svg", ".hdr", ".exr", ".dds", ".ico", ".pdf", ".mp4", ".avi", ".mov", ".webm",
    ".zip", ".gz", ".bz2", ".xz", ".7z", ".rar", ".tar", ".bag", ".db3", ".mcap", ".npy", ".npz",
    ".h5", ".pkl", ".pt", ".pth", ".onnx", ".bin", ".so", ".a", ".o", ".dll", ".exe", ".pyc",
    ".whl", ".jar", ".ttf",
    ".md", ".rst", ".html", ".ipynb", ".py", ".c", ".cc", ".cpp", ".h", ".hpp", ".rviz",
    ".run.json",
)  # fmt: skip
"""Endings of meshes, pictures, archives, code, pages and run logs of builds; a xacro may include
every other file."""
MOST_FILES = 20_000
"""Files that one xacro may choose from: the packages of a robot, not a disk."""

ABSENT = Rule(
    "xacro.package_missing",
    "info",
    "the xacro file asks for a package that the recipe states as missing, and reads nothing of it",
    "nothing, if only what is left out (plugins of Gazebo, controllers) names it",
)
ARGUMENT = Rule(
    "xacro.argument",
    "warning",
    "the recipe gives the xacro file an argument that it neither declares nor uses",
    "correct its name in `source.args`",
)
WARNING = Rule(
    "xacro.warning",
    "info",
    "xacro printed a warning while it expanded the file",
    "read the warning",
)


_NOT_XML = re.compile(r": line \d+, column \d+$")
_ASKED = re.compile(r"`([^`]+)`|unknown macro name: (\S+)|evaluating expression '(.+?)'")
"""What an error of xacro is about."""
_DECLARED = re.compile(r"<(?:xacro:)?arg\s[^>]*?name\s*=\s*[\"']([^\"']+)")
_UNPREFIXED = re.compile(r"<(macro|property|include|insert_block)\s")
_USED = re.compile(r"\$\(arg\s+([^\s)]+)\)")

WHERE = "say where the package is: `source.packages` of the recipe, `--package` of `init`"
GIVE = "give it: `source.args` of the recipe, `--arg` of `init`"


class ExpandXacro(Step):
    """`tree/` (declared files, relative to the source root) -> `robot.urdf`, `used.json`.

    `used.json`: {"files": those that were read, "packages": those that `$(find)` was asked for}.
    The file runs without network, without environment, and may read nothing but `tree/`. Paths
    below it come out as `package://` or relative. SourceError names the file, and what it wanted.
    """

    outputs = ("robot.urdf", "used.json")
    isolated = True
    limits: ClassVar[Limits] = Limits(wall_s=SECONDS + 30, memory_mb=4096)

    file: str
    """The xacro file, below the source root."""
    args: dict[str, str] = Field(default_factory=dict)
    """Values of its `xacro:arg`s."""
    packages: dict[str, str] = Field(default_factory=dict)
    """`$(find NAME)` -> folder below the source root."""
    absent: tuple[str, ...] = ()
    """Packages that the source does not have: `$(find NAME)` gives a path where nothing lies."""

    def run(self, files: Files) -> Iterator[Finding]:
        """Expand; each of xacro's warnings is reported once."""
        tree = files.inputs / "tree"
        answer = self._expanded(tree)
        if "error" in answer:
            error = self._error(answer, tree)
            if error.where is not None:
                refuse_pointer(_bytes_of(tree / error.where.file), where=error.where)
            raise error
        (files.outputs / "robot.urdf").write_text(answer["urdf"], encoding="utf-8")
        files.write_json("used.json", answer["used"])
        for name in sorted({*self.absent} & {*answer["used"]["packages"]}):
            yield ABSENT(
                "recipe source.missing.packages",
                f"`$(find {name})` was answered with a path where nothing lies",
                hint="if its files matter, add the package to the source",
                data={"package": name},
            )
        for name, hint in self._unknown(tree, answer["used"]["files"]):
            yield ARGUMENT(
                "recipe source.args",
                f"no `<xacro:arg>` is called `{name}`: its value changes nothing",
                hint=hint,
                data={"argument": name},
            )
        for text in dict.fromkeys(answer["said"]):
            yield WARNING("robot", f"xacro: {text}")

    def _unknown(self, tree: Path, used: Iterable[str]) -> Iterator[tuple[str, str]]:
        """The arguments that no file declares or uses, each with the name that may be meant."""
        text = _text_of(tree, used)
        named = {*_DECLARED.findall(text), *_USED.findall(text)}
        for name in self.args:
            if name not in named and not any("$" in other for other in named):
                yield name, did_you_mean(name, named)

    def _expanded(self, tree: Path) -> dict[str, Any]:  # Any: JSON of the child
        job = {"tree": str(tree), **self.model_dump()}
        path = json.dumps([os.path.abspath(p) for p in sys.path if p])  # noqa: PTH100
        try:
            child = subprocess.run(
                [sys.executable, "-P", "-s", "-c", PROGRAM, path],
                input=json.dumps(job).encode(),
                capture_output=True,
                env=bare_environment(),
                timeout=SECONDS,
            )
        except subprocess.TimeoutExpired:
            raise SourceError(
                f"the expansion took more than {SECONDS:g} s and was stopped",
                where=Where(self.file),
                hint="does a macro or an expression loop without end?",
            ) from None
        if child.returncode != 0 or not child.stdout:
            last = child.stderr.decode("utf-8", "replace").strip().rpartition("\n")[2][:300]
            reason = last or f"it ended with code {child.returncode}"
            raise SourceError(f"the expansion died: {reason}", where=Where(self.file))
        answer: dict[str, Any] = json.loads(child.stdout)  # Any: JSON
        return answer

    def _error(self, answer: dict[str, Any], tree: Path) -> SourceError:  # Any: JSON
        stack = answer.get("files") or [self.file]
        file = answer.get("file") or stack[-1]
        macros = answer.get("macros") or []
        within = f" (in macro `{macros[-1]}`)" if macros else ""
        found = _ASKED.search(answer["error"])
        asked = next(filter(None, found.groups())) if found else ""
        where = Where(file, answer.get("line", 0))
        for name in (file, *answer.get("read", ())) if asked and not where.line else ():
            if line := _line_of(asked, tree / name):
                where = Where(name, line)
                break
        if _NOT_XML.search(answer["error"]):
            read_xml(_bytes_of(tree / where.file), where.file, "xacro")  # raises with a hint
        hint = self._hint(answer, tree, asked) or _old_style(tree / where.file)
        if unknown := re.search(r"name '(\w+)' is not defined", "" if hint else answer["error"]):
            hint = f"define `{unknown[1]}` above its use by <xacro:property>; or does another file "
            hint += "include this one? Build that file"
        return SourceError(f"{answer['error']}{within}", where=where, hint=hint)

    def _hint(self, answer: dict[str, Any], tree: Path, asked: str) -> str:  # Any: JSON
        message = answer["error"]
        for name, near in self._unknown(tree, answer.get("read", ())):
            return f"no `<xacro:arg>` is called `{name}`: {near}"
        if "$(find" in message:
            near = did_you_mean(message.split("`")[-2], self.packages) if self.packages else ""
            return f"{near}; " * bool(near) + WHERE
        if "declared packages" in message or "readable files" in message:
            there = [path.relative_to(tree).as_posix() for path in tree.rglob("*")]
            for name, value in self.args.items():
                ends = asked.split(f"/{value}/")
                alike = re.compile("/([^/]+)/".join(map(re.escape, ends)))
                if len(ends) == 2 and (known := [*filter(None, map(alike.fullmatch, there))]):
                    near = did_you_mean(value, (match[1] for match in known))
                    return f"the argument `{name}` is `{value}`: {near}"
            meant = nearest(asked, there)
            if meant is None:
                return f"{WHERE}; or is part of its name an argument? {GIVE}"
            for name, folder in self.packages.items():
                base = meant.removesuffix(posixpath.relpath(asked, folder))
                if base != meant and base[-1:] in ("", "/"):
                    lies = f"does the package `{name}` lie in `{base.rstrip('/') or '.'}`?"
                    return f"{lies} correct `source.packages`"
            return f"did you mean `{meant}`? correct the file, or state `source.patches`"
        if "is no UTF-8" in message:
            return "save the file as UTF-8: xacro reads no other encoding"
        text = _text_of(tree, answer.get("read", ()))
        macro = re.escape(asked.removeprefix("xacro:"))
        if "unknown macro name" in message and re.search(rf"macro\s+name=[\"']{macro}[\"']", text):
            return "it is defined below its first use: xacro reads from top to bottom; move it up"
        if "Undefined substitution argument" in message:
            given = {*self.args, *_DECLARED.findall(text), *message.split()}
            others = [name for name in dict.fromkeys(_USED.findall(text)) if name not in given]
            return f"{GIVE}{f'; it also needs {quoted(others, 20)}' if others else ''}"
        return ""


def _text_of(tree: Path, names: Iterable[str]) -> str:
    """Several files, one after the other."""
    return "\n".join((tree / name).read_text("utf-8", "replace") for name in names)


def _line_of(asked: str, file: Path) -> int:
    """The first line of a file that names what was asked for; 0 where it is computed."""
    lines = _bytes_of(file).splitlines()
    word = asked.rpartition("/")[2].encode()
    return next((n for n, line in enumerate(lines, 1) if word in line), 0)


def _old_style(file: Path) -> str:
    """A hint, if the file has tags of xacro without the prefix that it asks for since 2020."""
    tag = _UNPREFIXED.search(_bytes_of(file).decode("utf-8", "replace"))
    return f"write `<xacro:{tag[1]}`: xacro reads `<{tag[1]}` no more" if tag else ""


def _bytes_of(file: Path) -> bytes:
    """The content of a file; nothing where there is no such file."""
    return file.read_bytes() if file.is_file() else b""
