"""Every target, on every tiny robot: same bytes twice. What it opens: `test_code`."""

from __future__ import annotations

from pathlib import Path

import pytest
from robot_files import contents, emit
from tiny import four_bar, tiny_quadruped

from assetbuild.plugin_types import Target
from assetbuild.plugins import load_plugin, plugin_names

TINY = {"quadruped": tiny_quadruped, "four_bar": four_bar}
TARGETS = plugin_names(Target)


@pytest.mark.parametrize("robot", TINY)
@pytest.mark.parametrize("name", TARGETS)
def test_two_runs_in_two_folders_write_the_same_bytes(name: str, robot: str, tmp_path: Path):
    target = load_plugin(Target, name)(robot="tiny")
    assert target.outputs == (f"{name}/",)
    runs = []
    for folder in ("a", "b/c"):
        emit(target, TINY[robot](), tmp_path / folder)
        runs.append(contents(tmp_path / folder / "out"))
        assert all(path.startswith(f"{name}/") for path in runs[-1])
    assert runs[0] == runs[1]
    assert runs[0]
