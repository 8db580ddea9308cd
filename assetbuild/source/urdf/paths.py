"""Where a URDF's file names lead: always to a path below the root of the source."""

from __future__ import annotations

import posixpath
import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from assetbuild.errors import did_you_mean
from assetbuild.source.urdf.xml import Node

_SCHEME = re.compile(r"([A-Za-z][A-Za-z0-9+.-]*):")


@dataclass(frozen=True)
class Paths:
    """file: the URDF itself, below the source root; packages: name -> folder below the root."""

    file: str
    packages: Mapping[str, str] = field(default_factory=dict)

    def resolve(self, node: Node) -> str:
        """The normalised path, below the source root, of the `filename` of a node.

        `package://name/path`, `package:///name/path` or relative to the URDF's own folder.
        Whether the file exists is not asked here.
        """
        uri = node.text("filename").strip()
        if "\\" in uri:
            raise node.error(f"{node.tag} filename `{uri}` has a backslash", "write `/` instead")
        scheme = _SCHEME.match(uri)
        if scheme and scheme[1] == "package":
            path = self._in_package(node, uri)
        elif scheme:
            raise node.error(
                f"{node.tag} filename `{uri}`: `{scheme[1]}:` cannot be followed", _HINT
            )
        elif uri.startswith("/"):
            raise node.error(f"{node.tag} filename `{uri}` is absolute", _HINT)
        else:
            path = posixpath.join(posixpath.dirname(self.file), uri)
        normal = posixpath.normpath(path)
        if normal == ".." or normal.startswith(("../", "/")):
            hint = "choose a higher `source.root` in the recipe"
            raise node.error(f"{node.tag} filename `{uri}` leads out of the source", hint)
        if normal == "." or uri.endswith("/"):
            raise node.error(f"{node.tag} filename `{uri}` names a folder")
        return normal

    def _in_package(self, node: Node, uri: str) -> str:
        name, _, rest = uri.removeprefix("package:").lstrip("/").partition("/")
        if name not in self.packages:
            near = did_you_mean(name, self.packages)
            advice = f"add `{name}: FOLDER` under `source.packages` in the recipe"
            hint = f"{near}; or {advice}" if near.startswith("did") else advice
            raise node.error(f"{node.tag} filename `{uri}`: no package named `{name}`", hint)
        return posixpath.join(self.packages[name], rest)


_HINT = "use `package://NAME/path` (see `source.packages`) or a path relative to the URDF"
