"""Where a robot comes from: `source` in a recipe, and in a part of a composite."""

from __future__ import annotations

import re
from pathlib import PurePosixPath
from typing import Annotated

from pydantic import AfterValidator, Field, model_validator

from assetbuild.quantities import Model, Pattern, Real


def _inside(text: str) -> str:
    """A path that cannot lead out of the source: relative, no `..`, slashes only."""
    path = PurePosixPath(text)
    if not text or path.is_absolute() or ".." in path.parts:
        raise ValueError("must be a relative path inside the source, without `..`")
    if "\\" in text or any(ord(c) < 32 for c in text) or re.match(r"[A-Za-z]:", text):
        raise ValueError("must be a plain path with `/` between folders")
    return path.as_posix()


InsidePath = Annotated[str, AfterValidator(_inside)]
Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
PYPI_PATTERN = r"^[A-Za-z0-9][A-Za-z0-9._-]*==[A-Za-z0-9][A-Za-z0-9.+!_-]*$"


class Source(Model):
    """Where the robot comes from: one of path, url, git, pypi; one of urdf, xacro, mjcf."""

    path: str | None = Field(
        None, description="a folder, or a zip or tar archive, relative to the recipe"
    )
    url: str | None = Field(
        None,
        description="http(s) address of a zip or tar archive",
        pattern=r"^https?://[^/@\s]+/\S*$",
    )
    sha256: Sha256 | None = Field(None, description="of the file at `url`, 64 hex digits")
    git: str | None = Field(
        None,
        description="a repository: https or ssh address, or a folder relative to the recipe",
        pattern=r"^[A-Za-z0-9./~_][^\s]*$",
    )
    rev: str | None = Field(
        None,
        description="branch, tag or commit of `git`; the lock pins the commit",
        pattern=r"^[A-Za-z0-9][A-Za-z0-9._/+-]*$",
    )
    pypi: str | None = Field(None, description="`name==version` of a wheel", pattern=PYPI_PATTERN)
    root: InsidePath = Field(
        ".", description="folder inside the source that all paths below start from"
    )
    urdf: InsidePath | None = Field(None, description="the URDF file")
    xacro: InsidePath | None = Field(None, description="the xacro file, instead of `urdf`")
    mjcf: InsidePath | None = Field(None, description="the MJCF file, instead of `urdf`")
    body: str | None = Field(
        None, description="the robot's body in the world of an MJCF that holds several robots"
    )
    args: dict[str, str | bool | int | Real] = Field(
        default_factory=dict, description="arguments of the xacro file, by name"
    )
    packages: dict[str, InsidePath] = Field(
        default_factory=dict, description="package:// name -> folder; explicit, nothing is searched"
    )
    honour_up_axis: tuple[Pattern, ...] = Field(
        (),
        description="paths of meshes (regular expressions) that are turned to Z as their up axis "
        "says; all others are taken as they are, which is what URDF viewers do",
    )
    license: str | None = Field(None, description="SPDX identifier of the source's licence")

    @model_validator(mode="after")
    def _one_of_each(self) -> Source:
        if [self.path, self.url, self.git, self.pypi].count(None) != 3:
            raise ValueError("give exactly one of `path`, `url`, `git`, `pypi`")
        if (self.url is None) != (self.sha256 is None):
            raise ValueError("`url` and `sha256` go together")
        if (self.git is None) != (self.rev is None):
            raise ValueError("`git` and `rev` go together")
        if self.git is not None and "://" in self.git:
            scheme, _, rest = self.git.partition("://")
            if scheme not in ("http", "https", "ssh") or ":" in rest.partition("@")[0] * (
                "@" in rest
            ):
                raise ValueError("`git`: https or ssh, without a password; or a folder")
        if [self.urdf, self.xacro, self.mjcf].count(None) != 2:
            raise ValueError(
                "give exactly one of `urdf`, `xacro`, `mjcf`: the description below `root`"
            )
        if self.args and self.xacro is None:
            raise ValueError("`args` are for a `xacro` file")
        if self.body is not None and self.mjcf is None:
            raise ValueError("`body` chooses a robot in an `mjcf` file")
        if self.packages and self.mjcf is not None:
            raise ValueError("`packages` are for URDF: the files of an MJCF lie below its folder")
        return self

    @property
    def moving(self) -> str | None:
        """What the lock must pin: a name that may stand for something else tomorrow."""
        return self.pypi or (f"{self.git} at {self.rev}" if self.git else None)

    @property
    def origin(self) -> str:
        """Where the files come from, as the recipe spells it."""
        return str(self.path or self.url or self.moving)

    @property
    def description(self) -> str:
        """Path of the robot's description below the root."""
        return str(self.urdf or self.xacro or self.mjcf)
