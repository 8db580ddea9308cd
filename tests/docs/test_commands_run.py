"""Every command of the pages runs as it stands there, on a tiny robot under the pages' names."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import commands
import pytest
from engine.servers_for_tests import serving

from .test_pages import commands as shown_commands

LEGS = Path(__file__).parents[1] / "robots/four_legs.urdf"
RECIPE = """\
schema: assetbuild/v1
robot: {name}
source: {{path: {path}, urdf: four_legs.urdf, license: MIT}}
base: floating
collision: {{default: {{method: keep}}}}
actuators: [{{joints: ".*", model: pd, kp: 20, kd: 1, effort: 10, velocity: 20}}]
randomize: {{links: {{".*": {{density: [0.9, 1.1], source: "CAD"}}}}}}
targets: [urdf, mjcf]
"""
XACRO = """\
<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="$(arg name)">
  <xacro:arg name="name" default="ur"/><xacro:arg name="ur_type" default="ur5"/>
  <link name="$(arg ur_type)_base"/>
</robot>
"""
ELSEWHERE = {
    "--executor dask": "tests/cli/test_cluster.py",
    "assetbuild smoke": "tests/checks/test_smoke.py",
    "assetbuild identify": "tests/cli/test_identify.py",
    "assetbuild policy": "tests/policy/test_replay.py",
    "_isaaclab.json": "tests/targets/test_isaaclab.py",
    "assetbuild build go1": "tests/cli/test_tools.py",
    "build crate.yaml": "tests/contracts/test_foreign_plugins.py",
}
"""What a page shows and needs another machine or simulator for: the test that runs it."""
FIRST = (
    "assetbuild build recipes/*",
    "assetbuild init",
    "assetbuild build recipes/",
    "assetbuild cache push",
)
"""Others read what these write; all recipes are one while `init` has written none."""
EXIT = {"--exit-code": 1}
SHELL_S_OWN = set("*?$|<>;&`~#\n")
"""Letters that a shell acts on: a command that has one of them is given to one."""
URLS = ("https://cache.example.org:8080", "URL")

Run = Callable[[str], subprocess.CompletedProcess[str]]


def in_order() -> list[str]:
    """Each command once; those that others need first."""
    found = dict.fromkeys(command for _, command in shown_commands())
    kept = [c for c in found if not any(word in c for word in ELSEWHERE)]
    ranks = {c: next((i for i, f in enumerate(FIRST) if c.startswith(f)), 9) for c in kept}
    return sorted(kept, key=lambda c: (ranks[c], c))


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Run]:
    """Runs a command in a folder as the pages take for granted."""
    folder = tmp_path_factory.mktemp("pages")
    (folder / "bin").mkdir()
    program = folder / "bin/assetbuild"
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m assetbuild "$@"\n')
    program.chmod(0o755)
    laid_out(folder)
    kept = {k: v for k, v in os.environ.items() if not k.startswith("ASSETBUILD_")}
    env = kept | {
        "PATH": f"{program.parent}:{kept['PATH']}",
        "ASSETBUILD_CACHE": str(folder / "store"),
        "BROWSER": "true",
        "MUJOCO_GL": "disable",
        "HOME": str(folder),
    }
    with serving() as server:

        def run(command: str) -> subprocess.CompletedProcess[str]:
            for url in URLS:
                command = command.replace(url, server.url)
            words = shlex.split(command)
            if words[0] == "assetbuild" and not SHELL_S_OWN & set(command):
                return commands.run(words[1:], folder, env)
            return subprocess.run(
                ["sh", "-c", command], cwd=folder, env=env, capture_output=True, text=True,
                timeout=300,
            )  # fmt: skip

        yield run


def laid_out(folder: Path) -> None:
    """Robots and recipes at the places that the pages name; a git repository holds them."""
    for place in (
        "robot/four_legs.urdf",
        "my_robot/urdf/my_robot.urdf",
        "NAME_description/urdf/NAME.urdf",
    ):
        own = folder / place
        own.parent.mkdir(parents=True)
        own.write_text(LEGS.read_text().replace('name="four_legs"', f'name="{own.stem}"'))
    xacro = folder / "ur_description/urdf/ur.urdf.xacro"
    xacro.parent.mkdir(parents=True)
    xacro.write_text(XACRO)
    (folder / "recipes").mkdir()
    (folder / "recipes/go1.yaml").write_text(RECIPE.format(name="go1", path="../robot"))
    (folder / "b1_z1.yaml").write_text(RECIPE.format(name="b1_z1", path="robot"))
    mjcf = folder / "menagerie/unitree_go1/go1.xml"
    mjcf.parent.mkdir(parents=True)
    mjcf.write_text(
        "<mujoco><worldbody><body name='trunk'><geom size='1'/></body></worldbody></mujoco>"
    )
    config = folder / "isaaclab/unitree.py"
    config.parent.mkdir()
    drive = "ImplicitActuatorCfg(joint_names_expr=['.*'], stiffness=25.0)"
    imports = "from isaaclab.assets import ArticulationCfg\nfrom isaaclab.actuators import "
    imports += "ImplicitActuatorCfg\n"
    config.write_text(f"{imports}GO1_CFG = ArticulationCfg(actuators={{'legs': {drive}}})")
    git = ["git", "-c", "user.name=me", "-c", "user.email=me@example.org", "-C", str(folder)]
    for words in (["init", "-q"], ["add", "."], ["commit", "-q", "-m", "robots"]):
        subprocess.run([*git, *words], check=True)


@pytest.mark.slow
@pytest.mark.skipif(not shutil.which("git"), reason="git is not installed")
@pytest.mark.parametrize("command", in_order())
def test_the_command_does_what_the_page_says(command: str, run: Run):
    if "build/go1-train" in command:
        run("cp -r build/go1 build/go1-train")
    done = run(command)
    expected = next((code for word, code in EXIT.items() if word in command), 0)
    assert done.returncode == expected, done.stdout + done.stderr
    assert "Traceback" not in done.stderr


def test_what_runs_elsewhere_is_tested_there():
    for word, test in ELSEWHERE.items():
        assert any(word in command for _, command in shown_commands())
        assert (Path(__file__).parents[2] / test).is_file()
