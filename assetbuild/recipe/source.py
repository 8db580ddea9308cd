"""Where a robot comes from: `source` in a recipe, and in a part of a composite."""

from __future__ import annotations

import re
from pathlib import PurePosixPath
from typing import Annotated

from pydantic import AfterValidator, Field, model_validator

from assetbuild.recipe_types import Model, Name, Pattern, Real


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


def _absolute(text: str) -> str:
    """A folder of another machine, as file names begin with it: `/home/me/ws/arm_description`."""
    if not text.startswith("/") or PurePosixPath(text).as_posix() != text or text == "/":
        raise ValueError("must be an absolute folder, such as `/home/me/arm_description`")
    return text


class Patch(Model):
    """A repair of the source's text before it is read; `diff` alone, or all but `diff`."""

    file: InsidePath | None = Field(
        None, description="the description or a file that it includes, below `root`"
    )
    find: str | None = Field(
        None, min_length=1, description="the passage, which occurs exactly once in the file"
    )
    replace: str | None = Field(None, description="the replacement")
    times: int = Field(
        1, ge=1, le=10_000, description="how often `find` occurs, where that is more than once"
    )
    diff: str | None = Field(
        None,
        description="a unified diff, relative to the recipe; each of its hunks is a patch whose "
        "old lines occur exactly once",
    )
    because: str = Field(min_length=3, description="the reason, shown in the report")

    @model_validator(mode="after")
    def _one_way(self) -> Patch:
        by_text = [self.file, self.find, self.replace]
        if self.diff is None and None in by_text:
            raise ValueError("give `file`, `find` and `replace`, or `diff`")
        if self.diff is not None and (by_text != [None] * 3 or self.times != 1):
            raise ValueError("a `diff` names its files and passages itself")
        return self


class Missing(Model):
    """What the source lacks and the robot can do without."""

    visuals: tuple[InsidePath, ...] = Field(
        (), description="visual meshes, below `root`: the shapes that they draw are left out"
    )
    packages: tuple[Name, ...] = Field(
        (),
        description="packages that a xacro file asks for by `$(find)` and reads nothing of",
    )


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
    relative_to: InsidePath | None = Field(
        None,
        description="folder that relative names of meshes and textures start from; without it the "
        "folder of the URDF",
    )
    absolute: dict[Annotated[str, AfterValidator(_absolute)], InsidePath] = Field(
        default_factory=dict,
        description="folders of the author's machine, as absolute file names begin with them -> "
        "folder; the longest that fits counts",
    )
    missing: Missing = Missing()
    patches: tuple[Patch, ...] = Field(
        (), max_length=1000, description="repairs of the source's text, before it is read"
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
            has_password = "@" in rest and ":" in rest.partition("@")[0]
            if scheme not in ("http", "https", "ssh") or has_password:
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
        of_urdf = {"relative_to", "absolute", "missing"} & self.model_fields_set
        if of_urdf and self.mjcf is not None:
            raise ValueError(f"`{min(of_urdf)}` is for URDF and xacro")
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
