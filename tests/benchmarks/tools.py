"""The build systems that are compared: how each is installed, told of the graph, and started."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import yaml

from tests.benchmarks.graph import CHECK_BYTES, HULL_BYTES, MESHES, VIS_BYTES, tasks

ROOT = Path(__file__).parents[2]
VERSIONS = {"ninja": "1.13.2", "doit": "0.37.0", "snakemake": "9.27.1", "dvc": "3.67.1"}


@dataclass(frozen=True)
class Tool:
    """state: what it keeps beside the outputs. slow: too slow for twenty robots by default."""

    name: str
    write: Callable[[Path, int], None]
    words: tuple[str, ...]
    state: tuple[str, ...]
    slow: bool = False

    def command(self, environments: Path, robots: int) -> list[str]:
        """Words of one build, to be run in the work folder."""
        if self.name == "assetbuild":
            return [sys.executable, "-m", "tests.benchmarks.ours", str(robots)]
        return [str(environments / self.name / "bin" / self.words[0]), *self.words[1:]]

    def environment(self, folder: Path, environments: Path) -> dict[str, str]:
        """Of one build. Nothing is asked of a network."""
        kept = {k: v for k, v in os.environ.items() if not k.startswith("ASSETBUILD_")}
        own = str(environments / self.name / "bin")
        kept["PATH"] = os.pathsep.join([own, kept["PATH"]])
        kept |= {"ASSETBUILD_CACHE": str(folder / "store"), "PYTHONPATH": str(ROOT)}
        return kept | {"DVC_NO_ANALYTICS": "1", "PYTHONDONTWRITEBYTECODE": ""}

    def forget(self, folder: Path) -> None:
        """Back to sources alone."""
        for name in ("out", *self.state):
            path = folder / name
            shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)


def install(tool: Tool, environments: Path) -> None:
    """An environment of its own for a tool, unless it is there already."""
    place = environments / tool.name
    if tool.name == "assetbuild" or (place / "bin" / tool.words[0]).is_file():
        return
    subprocess.run([sys.executable, "-m", "venv", str(place)], check=True)
    package = f"{tool.name}=={VERSIONS[tool.name]}"
    subprocess.run([str(place / "bin/pip"), "install", "--quiet", package], check=True)


def _nothing(folder: Path, robots: int) -> None: ...


def _ninja(folder: Path, robots: int) -> None:
    lines = ["rule run", "  command = $cmd", ""]
    for task in tasks(robots):
        lines += [f"build {task.output}: run {' '.join(task.inputs)}", f"  cmd = {task.command}"]
    (folder / "build.ninja").write_text("\n".join(lines) + "\n")


def _doit(folder: Path, robots: int) -> None:
    rows = [(t.output, list(t.inputs), t.command) for t in tasks(robots)]
    (folder / "dodo.py").write_text(f"""
import os
DOIT_CONFIG = {{"verbosity": 0, "reporter": "zero", "backend": "sqlite3"}}
ROWS = {rows!r}
def task_it():
    for output, inputs, command in ROWS:
        os.makedirs(os.path.dirname(output), exist_ok=True)
        yield {{"name": output, "actions": [command], "file_dep": inputs, "targets": [output]}}
""")


def _snakemake(folder: Path, robots: int) -> None:
    (folder / "Snakefile").write_text(f"""
N = range({MESHES})
rule all:
    input: expand("out/r{{r}}/check_{{t}}_{{c}}", r=range({robots}), t=["mjcf", "usd"], c=range(3))
rule norm:
    input: "src/r{{r}}/m{{n}}.stl"
    output: "out/r{{r}}/norm{{n,\\\\d+}}.stl"
    shell: "cp {{input}} {{output}}"
rule hull:
    input: "out/r{{r}}/norm{{n}}.stl"
    output: "out/r{{r}}/hull{{n,\\\\d+}}.stl"
    shell: "head -c {HULL_BYTES} {{input}} > {{output}}"
rule vis:
    input: "out/r{{r}}/norm{{n}}.stl"
    output: "out/r{{r}}/vis{{n,\\\\d+}}.stl"
    shell: "head -c {VIS_BYTES} {{input}} > {{output}}"
rule mjcf:
    input: "src/r{{r}}/robot.urdf", lambda w: [f"out/r{{w.r}}/hull{{n}}.stl" for n in N]
    output: "out/r{{r}}/mjcf"
    shell: "cat {{input}} > {{output}}"
rule usd:
    input: "src/r{{r}}/robot.urdf", lambda w: [f"out/r{{w.r}}/vis{{n}}.stl" for n in N]
    output: "out/r{{r}}/usd"
    shell: "cat {{input}} > {{output}}"
rule check:
    input: "out/r{{r}}/{{t}}"
    output: "out/r{{r}}/check_{{t,mjcf|usd}}_{{c,\\\\d+}}"
    params: size=lambda w: {CHECK_BYTES} + int(w.c)
    shell: "head -c {{params.size}} {{input}} > {{output}}"
""")


def _dvc(folder: Path, robots: int) -> None:
    stages = {}
    for task in tasks(robots):
        name = task.output.replace("/", "_").replace(".", "_")
        command = f"mkdir -p {Path(task.output).parent} && {task.command}"
        stages[name] = {"cmd": command, "deps": list(task.inputs), "outs": [task.output]}
    (folder / "dvc.yaml").write_text(yaml.safe_dump({"stages": stages}))
    (folder / ".dvc").mkdir(exist_ok=True)
    (folder / ".dvc/config").write_text("[core]\n    no_scm = True\n    analytics = false\n")


TOOLS = (
    Tool("assetbuild", _nothing, ("assetbuild",), ("store",)),
    Tool("ninja", _ninja, ("ninja", "-j2", "--quiet"), (".ninja_log", ".ninja_deps")),
    Tool("doit", _doit, ("doit", "-n2"), (".doit.db",)),
    Tool("snakemake", _snakemake, ("snakemake", "-j2", "--quiet", "all"), (".snakemake",)),
    Tool("dvc", _dvc, ("dvc", "repro", "-q"), (".dvc/cache", ".dvc/tmp", "dvc.lock"), slow=True),
)
