"""Where a URDF's file names lead: always to a path below the root of the source."""

from __future__ import annotations

import posixpath
import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from assetbuild.errors import did_you_mean
from assetbuild.findings import Rule
from assetbuild.source.urdf.xml import Node

TAKEN = Rule(
    "urdf.path",
    ("info", "warning"),
    "file names that not every reader understands were followed: `model://`, `file://`, absolute "
    "ones, or relative ones from another folder than the URDF's",
    "write `package://NAME/path`, which all readers understand",
)
MISSING = Rule(
    "urdf.visual.missing",
    "warning",
    "a visual mesh that the recipe states as missing was left out, and its shape with it",
    "add the mesh, and remove it from `source.missing.visuals`",
)

_SCHEME = re.compile(r"([A-Za-z][A-Za-z0-9+.-]*):")
_HINT = "use `package://NAME/path` (see `source.packages`) or a path relative to the URDF"


@dataclass(frozen=True)
class Paths:
    """The meaning of file names; all folders lie below the source's root.

    file: the URDF itself; packages: name -> folder; relative_to, absolute, missing: see `Source`.
    taken: what not every reader would have followed: by kind how it was taken, name, path, line.
    """

    file: str
    packages: Mapping[str, str] = field(default_factory=dict)
    relative_to: str | None = None
    absolute: Mapping[str, str] = field(default_factory=dict)
    missing: tuple[str, ...] = ()
    taken: dict[str, list[tuple[str, str, str, int]]] = field(default_factory=dict)

    def resolve(self, node: Node) -> str:
        """The normalised path, below the source root, of the `filename` of a node.

        `package://name/path`, `package:///name/path` or relative to the URDF's own folder.
        Whether the file exists is not asked here.
        """
        kind, assumption, path = self._meaning(node)
        if assumption:
            uri = node.text("filename").strip()
            self.taken.setdefault(kind, []).append((assumption, uri, path, node.line))
        return path

    def _meaning(self, node: Node) -> tuple[str, str, str]:
        """(kind, how it was taken, normalised path); "" for how where all readers agree."""
        uri = node.text("filename").strip()
        if "\\" in uri:
            raise node.error(f"{node.tag} filename `{uri}` has a backslash", "write `/` instead")
        kind, assumption, path = self._followed(node, uri)
        normal = posixpath.normpath(path)
        left = posixpath.isabs(normal) and not posixpath.isabs(self.file)  # `package://name//etc`
        if left or normal == ".." or normal.startswith("../"):
            hint = "choose a higher `source.root` in the recipe"
            raise node.error(f"{node.tag} filename `{uri}` leads out of the source", hint)
        if normal == "." or uri.endswith("/"):
            raise node.error(f"{node.tag} filename `{uri}` names a folder")
        return kind, assumption, normal

    def _followed(self, node: Node, uri: str) -> tuple[str, str, str]:
        """(kind, how it was taken, path), before the path is normalised."""
        match = _SCHEME.match(uri)
        scheme = match[1] if match else ""
        start = self.relative_to if self.relative_to is not None else posixpath.dirname(self.file)
        shown = f"was taken to start at `{start or '.'}`"
        if scheme in ("package", "model"):
            bare = uri.removeprefix(f"{scheme}:").lstrip("/")
            if "/" not in bare:
                meant = posixpath.join(start, bare)
                return "bare", f"`{scheme}://` without a package {shown}", meant
            path = self._in_package(node, uri, uri.removeprefix(f"{scheme}:"))
            assumption = "`model://` was taken for `package://`" if scheme == "model" else ""
            return scheme, assumption, path
        if scheme not in ("", "file"):
            raise node.error(f"{node.tag} filename `{uri}`: `{scheme}:` cannot be followed", _HINT)
        path = uri.removeprefix("file:")
        plain = re.sub("^//(?!/)", "", path) if scheme else path
        if plain.startswith("/"):  # on the author's machine
            there = posixpath.normpath("/" + plain.lstrip("/"))
            fitting = [known for known in self.absolute if there.startswith(f"{known}/")]
            if not fitting:
                hint = "say what lies there: `absolute: {/FOLDER/OF/THE/AUTHOR: FOLDER}` under "
                hint += f"`source`; or {_HINT}"
                raise node.error(f"{node.tag} filename `{uri}` is absolute", hint)
            known = max(fitting, key=len)
            here = self.absolute[known]
            assumption = f"`{known}` was taken for the folder `{here}`"
            return known, assumption, posixpath.join(here, there[len(known) + 1 :])
        whole = posixpath.join(start, plain)
        if scheme:
            return "file", f"`file:` without an absolute path {shown}", whole
        if self.relative_to is None or start == posixpath.dirname(self.file):
            return "", "", whole
        return "relative", f"relative names were taken to start at `{start}`", whole

    def _in_package(self, node: Node, uri: str, path: str) -> str:
        name, _, rest = path.lstrip("/").partition("/")
        if name not in self.packages:
            near = did_you_mean(name, self.packages)
            advice = f"add `{name}: FOLDER` under `source.packages` in the recipe"
            hint = f"{near}; or {advice}" if near.startswith("did") else advice
            raise node.error(f"{node.tag} filename `{uri}`: no package named `{name}`", hint)
        return posixpath.join(self.packages[name], rest)

    def left_out(self, geometry: Node, role: str) -> bool:
        """Return whether the mesh of a shape is stated as missing, and report that.

        SourceError for a collision mesh: without it the robot would be another one.
        """
        mesh = geometry.only("mesh") if self.missing else None
        if mesh is None or (path := self._meaning(mesh)[2]) not in self.missing:
            return False
        if role == "collision":
            hint = "add the mesh, or replace the <collision> by a patch (see `source.patches`)"
            message = (
                f"the collision mesh `{path}` is stated as missing, which only a visual can be"
            )
            raise mesh.error(message, hint)
        message = f"its visual mesh `{path}` is missing (line {mesh.line}); nothing is drawn for it"
        mesh.report(MISSING, message, data={"mesh": path})
        return True

    def report(self, robot: Node) -> None:
        """Report each kind of name that not every reader would have followed."""
        for kind, taken in sorted(self.taken.items()):
            assumption, uri, path, line = taken[0]
            robot.report(
                TAKEN,
                f"{assumption}, {len(taken)} times: first `{uri}` (line {line}) for `{path}`",
                severity="warning" if kind.startswith("/") or kind == "file" else "info",
                data={"uri": uri, "path": path, "count": len(taken)},
            )
