"""Every target, on every tiny robot: same bytes twice, nothing undeclared."""

from __future__ import annotations

from pathlib import Path

import pytest
from tiny import four_bar, pendulum, run_step, tiny_quadruped, write_robot_ports

from assetbuild.kinds import Target
from assetbuild.plugins import load_plugin, plugin_names

TINY = {"quadruped": tiny_quadruped, "pendulum": pendulum, "four_bar": four_bar}
TARGETS = plugin_names(Target)


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
    runs = []
    for folder in ("a", "b/c"):
        inputs = write_robot_ports(tmp_path / folder / "in", TINY[robot]())
        run_step(target, inputs, tmp_path / folder / "out")
        runs.append(written(tmp_path / folder / "out"))
        assert all(path.startswith(f"{name}/") for path in runs[-1])
    assert runs[0] == runs[1]
    assert runs[0]


@pytest.mark.parametrize("name", TARGETS)
def test_it_writes_below_its_own_name_and_says_what_it_reads(name: str):
    target = load_plugin(Target, name)
    assert target.outputs == (f"{name}/",)
    assert set(target.reads) <= {
        "links.json", "tree.json", "shapes.json", "control.json", "ratings.json", "meshes/",
    }  # fmt: skip
