"""Every target, on every tiny robot: same bytes twice, nothing undeclared."""

from __future__ import annotations

import os
import sys
import sysconfig
from pathlib import Path
from typing import Any

import pytest
from robot_files import run_step, write_robot_ports
from tiny import four_bar, pendulum, tiny_quadruped

import assetbuild
from assetbuild.plugin_types import Target
from assetbuild.plugins import load_plugin, plugin_names

TINY = {"quadruped": tiny_quadruped, "four_bar": four_bar}
TARGETS = plugin_names(Target)
FREE = ("/usr", "/etc", "/proc", "/dev", sys.prefix, sys.base_prefix, sysconfig.get_path("purelib"))
"""What any program opens, besides the package's own code."""
opened: list[str] = []


@pytest.fixture(scope="module")
def watched() -> list[str]:
    """Every path that this process opens from now on; an audit hook cannot be taken away."""

    def hear(event: str, arguments: tuple[Any, ...]) -> None:
        if event in ("open", "os.listdir", "os.scandir") and isinstance(arguments[0], str):
            opened.append(os.path.abspath(arguments[0]))  # noqa: PTH100 # links are no answer

    sys.addaudithook(hear)
    return opened


def written(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


@pytest.mark.parametrize("robot", TINY)
@pytest.mark.parametrize("name", TARGETS)
def test_two_runs_in_two_folders_write_the_same_bytes(name: str, robot: str, tmp_path: Path):
    target = load_plugin(Target, name)(robot="tiny")
    assert target.outputs == (f"{name}/",)
    runs = []
    for folder in ("a", "b/c"):
        inputs = write_robot_ports(tmp_path / folder / "in", TINY[robot]())
        run_step(target, inputs, tmp_path / folder / "out")
        runs.append(written(tmp_path / folder / "out"))
        assert all(path.startswith(f"{name}/") for path in runs[-1])
    assert runs[0] == runs[1]
    assert runs[0]


@pytest.mark.parametrize("name", TARGETS)
def test_it_opens_what_it_declares_and_nothing_else(
    name: str, tmp_path: Path, watched: list[str]
) -> None:
    target = load_plugin(Target, name)(robot="tiny")
    inputs = write_robot_ports(tmp_path / "in", tiny_quadruped())
    secret = tmp_path / "undeclared"
    secret.write_text("known bad")
    run_step(target, write_robot_ports(tmp_path / "small", pendulum()), tmp_path / "warm")
    # What is imported late is imported by now.
    watched.clear()
    run_step(target, inputs, tmp_path / "out")
    declared = (str(inputs), str(tmp_path / "out"), *FREE, str(Path(assetbuild.__file__).parent))
    assert [path for path in watched if not path.startswith(declared)] == []
    secret.read_text()
    assert str(secret) in watched
