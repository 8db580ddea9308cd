"""A step: a pure function of named input files and its own fields."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from pydantic import BaseModel, ConfigDict

from assetbuild.findings import Finding


@dataclass(frozen=True, slots=True)
class Files:
    """Where a step reads and writes: two folders, nothing else.

    inputs: holds each input under the name that the plan gave it; a name may contain slashes
        (`meshes/calf/parts/`), one that ends in a slash is a folder. Read only. Both are links:
        a recursive search enters an input folder only when it starts there.
    outputs: empty; the step writes exactly its declared outputs there.
    """

    inputs: Path
    outputs: Path

    def write_json(self, name: str, value: object) -> None:
        """Write an output as JSON, its keys in alphabetical order."""
        text = json.dumps(value, sort_keys=True, indent=1) + "\n"
        (self.outputs / name).write_text(text, encoding="ascii")


@dataclass(frozen=True, slots=True)
class Limits:
    """Bounds of one step in its child process; running over one fails the step."""

    wall_s: float = 300.0
    memory_mb: int = 4096
    file_mb: int = 4096
    cpus: int = 1


def is_plain_path(name: str) -> bool:
    """A relative path of ordinary parts: no `..`, no leading slash, no empty part."""
    return "\0" not in name and not {"", ".", ".."} & set(name.split("/"))


class Step(BaseModel):
    """Base of all steps. The fields of a subclass are its parameters and part of its key.

    No step reads the working folder, clock, environment, home or an unseeded random number.
    Heavy libraries are imported inside `run`.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", defer_build=True)

    version: ClassVar[str] = ""
    """Plug-ins for assetbuild 0.1 state it. It decides nothing: the key holds their code."""
    tools: ClassVar[tuple[str, ...]] = ()
    """Libraries that plug-ins for assetbuild 0.1 state; they count beside the imported ones."""
    outputs: ClassVar[tuple[str, ...]] = ()
    """Files to write; one that ends in a slash is a folder whose content the data decide."""
    isolated: ClassVar[bool] = False
    """Native or heavy code, or hostile input: the memory that it declares is reserved for it, and
    it may run on another machine."""
    in_parent: ClassVar[bool] = False
    """Run in the process that builds, which keeps the user's environment, and not in a child: only
    steps that compute nothing, or whose work is done by a process of their own."""
    shares: ClassVar[bool] = False
    """Leaves nothing behind in its process that another step could notice (settings, open files,
    registries of native libraries), so that steps may follow each other there: a process costs as
    much as a small step."""
    cpu_bound: ClassVar[bool] = False
    """Its bytes depend on the CPU in a way that `engine/cpu.py` cannot pin: the model is part of
    the key."""
    preload: ClassVar[tuple[str, ...]] = ()
    """Modules that the child imports once for many steps (`trimesh`).

    Steps with the same tuple share one process that has them imported, so name them alike.
    """
    imports: ClassVar[tuple[str, ...]] = ()
    """Modules that this kind of step alone needs: its worker imports them before the first one."""
    limits: ClassVar[Limits] = Limits()
    usual_s: ClassVar[float] = 0.1
    """How long such a step takes on one core, about. What takes longest, with all that waits for
    it, starts first; a build that ran here before knows better."""
    all_told: ClassVar[bool] = False
    """When one fails, the others of its kind that can run still do: each is a file of the user's,
    and one build names all that are broken."""
    own_name: ClassVar[str] = ""
    """Where its file holds several steps."""
    network: ClassVar[bool] = False
    """Only the `fetch*` steps may say True."""

    @classmethod
    def __pydantic_init_subclass__(cls, **_: object) -> None:
        """Pydantic would evaluate the class variables of all bases again for each class."""
        hints = cls.__annotations__
        cls.__annotations__ = {n: a for n, a in hints.items() if "ClassVar" not in str(a)}

    def run(self, files: Files) -> Iterable[Finding]:
        """Read `files.inputs`, write `files.outputs`, yield findings."""
        raise NotImplementedError

    def modules(self) -> tuple[str, ...]:
        """What its child has imported beforehand: `preload`, unless the fields ask for more."""
        return self.preload

    @classmethod
    def may_share(cls) -> bool:
        """Whether it `shares`; a plug-in says so itself, and does not inherit it from us."""
        by = next(each for each in cls.__mro__ if "shares" in vars(each))
        return cls.shares and by.__module__.split(".")[0] == cls.__module__.split(".")[0]

    @classmethod
    def step_name(cls) -> str:
        """`read_urdf` for `assetbuild.source.urdf.read_urdf`: its file, or a name of its own."""
        return cls.own_name or cls.__module__.rsplit(".", 1)[-1]


Step.__pydantic_init_subclass__()
