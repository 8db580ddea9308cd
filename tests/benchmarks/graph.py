"""The synthetic robots that all tools build: 98 steps and 129 files each, contents known.

30 meshes of 1 MB and a description -> 30 norm -> 30 hull and 30 vis -> 2 merges -> 6 checks.
"""

from __future__ import annotations

import random
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

MESHES = 30
MESH_BYTES = 1 << 20
HULL_BYTES, VIS_BYTES, CHECK_BYTES = 1 << 19, 1 << 18, 100


@dataclass(frozen=True)
class Task:
    """One step. kind: `cp`, `cat`, or `head` of so many bytes. Paths are relative."""

    kind: str
    inputs: tuple[str, ...]
    output: str
    size: int = 0

    @property
    def command(self) -> str:
        """For a shell."""
        files = " ".join(self.inputs)
        if self.kind == "cp":
            return f"cp {files} {self.output}"
        if self.kind == "cat":
            return f"cat {files} > {self.output}"
        return f"head -c {self.size} {files} > {self.output}"

    def made(self, contents: dict[str, bytes]) -> bytes:
        """The bytes of the output, from scratch."""
        data = b"".join(contents[name] for name in self.inputs)
        return data[: self.size] if self.kind == "head" else data


def tasks(robots: int) -> Iterator[Task]:
    """All steps, each after those that it reads."""
    for robot in range(robots):
        source, out = f"src/r{robot}", f"out/r{robot}"
        for n in range(MESHES):
            yield Task("cp", (f"{source}/m{n}.stl",), f"{out}/norm{n}.stl")
            yield Task("head", (f"{out}/norm{n}.stl",), f"{out}/hull{n}.stl", HULL_BYTES)
            yield Task("head", (f"{out}/norm{n}.stl",), f"{out}/vis{n}.stl", VIS_BYTES)
        for target, part in (("mjcf", "hull"), ("usd", "vis")):
            parts = tuple(f"{out}/{part}{n}.stl" for n in range(MESHES))
            yield Task("cat", (f"{source}/robot.urdf", *parts), f"{out}/{target}")
            for check in range(3):
                name = f"{out}/check_{target}_{check}"
                yield Task("head", (f"{out}/{target}",), name, CHECK_BYTES + check)


def write_sources(folder: Path, robots: int) -> None:
    """The same bytes every time."""
    for robot in range(robots):
        place = folder / f"src/r{robot}"
        place.mkdir(parents=True, exist_ok=True)
        chance = random.Random(robot)
        (place / "robot.urdf").write_text(f"<robot name='r{robot}'/>\n")
        for n in range(MESHES):
            (place / f"m{n}.stl").write_bytes(chance.randbytes(MESH_BYTES))


def gold(folder: Path, robots: int) -> dict[str, bytes]:
    """What each output must hold, by path."""
    paths = [p for p in (folder / "src").rglob("*") if p.is_file()]
    contents = {p.relative_to(folder).as_posix(): p.read_bytes() for p in paths}
    made = {}
    for task in tasks(robots):
        made[task.output] = contents[task.output] = task.made(contents)
    return made


def wrong_outputs(folder: Path, robots: int) -> list[str]:
    """Outputs that are not what the sources make."""
    return [
        path
        for path, data in gold(folder, robots).items()
        if not (folder / path).is_file() or (folder / path).read_bytes() != data
    ]
