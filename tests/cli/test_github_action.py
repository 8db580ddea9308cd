"""The GitHub Action's steps on a scratch repository; a script stands in for `gh`."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from .conftest import LEGS_RECIPE, new_legs

ACTION = Path(__file__).parents[2] / ".github/actions/robots"
RECIPE = LEGS_RECIPE.replace("path: robot", "path: ../robot").replace("[urdf]", "[mjcf]")
GH = """\
#!/bin/sh
echo "$@" >> "$GH_LOG"
for word in "$@"; do case "$word" in body=@*) cat "${word#body=@}" > "$GH_LOG.body";; esac; done
"""


class Lab:
    """A repository with two recipes, and the folders that a runner gives a job."""

    def __init__(self, folder: Path) -> None:
        place = new_legs(folder / "lab", folder / "store")
        self.root, programs = place.folder, folder / "bin"
        (self.root / "recipes").mkdir()
        programs.mkdir()
        for name in ("one", "two"):
            self.write(name, 20)
        program = f'#!/bin/sh\nexec "{sys.executable}" -m assetbuild "$@"\n'
        for name, text in (("gh", GH), ("assetbuild", program)):
            (programs / name).write_text(text)
            (programs / name).chmod(0o755)
        self.variables = place.env(
            PATH=f"{programs}:{os.environ['PATH']}",
            PYTHONPATH=str(ACTION.parents[2]),
            RUNNER_TEMP=str(folder),
            GH_LOG=str(folder / "gh.log"),
            GITHUB_REPOSITORY="lab/robots",
            GITHUB_ACTIONS="true",
            GITHUB_WORKSPACE=str(self.root),
            GITHUB_STEP_SUMMARY=str(folder / "summary.md"),
            RECIPES="recipes/one.yaml recipes/two.yaml",
            NUMBER="7",
        )
        self.git("init", "-q")
        self.base = self.commit()

    def write(self, name: str, kp: float) -> None:
        text = RECIPE.replace("robot: legs", f"robot: {name}").replace("kp: 20", f"kp: {kp}")
        (self.root / f"recipes/{name}.yaml").write_text(text)

    def git(self, *words: str) -> str:
        who = ("-c", "user.name=lab", "-c", "user.email=lab@example.org")
        done = subprocess.run(
            ["git", *who, *words], cwd=self.root, capture_output=True, text=True, check=True
        )
        return done.stdout.strip()

    def commit(self) -> str:
        self.git("add", "-A")
        self.git("commit", "-qm", "change")
        return self.git("rev-parse", "HEAD")

    def run(self, what: str, base: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            ["bash", str(ACTION / "steps.sh"), what],
            cwd=self.root,
            env=self.variables | {"BASE": base},
            capture_output=True,
            text=True,
        )


@pytest.fixture
def lab(tmp_path: Path) -> Lab:
    return Lab(tmp_path)


@pytest.mark.slow
def test_a_pull_request_builds_what_it_touches_and_comments_what_changed(lab: Lab) -> None:
    lab.write("two", 25)
    lab.commit()
    built = lab.run("build", lab.base)
    assert built.returncode == 0, built.stderr
    assert not (lab.root / "build/one").exists()
    summary = Path(lab.variables["GITHUB_STEP_SUMMARY"]).read_text()
    assert re.search(r"^\| two \| yes \|", summary, re.MULTILINE), summary
    said = lab.run("comment", lab.base)
    assert said.returncode == 0, said.stderr
    body = Path(lab.variables["GH_LOG"] + ".body").read_text()
    assert body.startswith("<!-- assetbuild -->")
    assert "kp" in body and "25" in body and "one" not in re.findall(r"`recipes/(\w+)", body)
    assert "repos/lab/robots/issues/7/comments" in Path(lab.variables["GH_LOG"]).read_text()


@pytest.mark.slow
def test_a_changed_robot_builds_all_and_a_broken_one_is_marked(lab: Lab) -> None:
    urdf = lab.root / "robot/four_legs.urdf"
    urdf.write_text(re.sub(r'izz="[^"]*"', 'izz="9"', urdf.read_text(), count=1))
    lab.commit()
    built = lab.run("build", lab.base)
    assert built.returncode == 1
    assert "::error file=robot/four_legs.urdf,line=" in built.stdout
    summary = Path(lab.variables["GITHUB_STEP_SUMMARY"]).read_text()
    assert "| one | **no** |" in summary and "| two | **no** |" in summary


def test_documentation_builds_nothing(lab: Lab) -> None:
    (lab.root / "README.md").write_text("words")
    lab.commit()
    built = lab.run("build", lab.base)
    assert (built.returncode, built.stdout.strip()) == (0, "no recipe is touched")


def test_the_action_calls_the_steps_with_every_variable_that_they_read() -> None:
    action = yaml.safe_load((ACTION / "action.yml").read_text())
    calls = [step for step in action["runs"]["steps"] if "steps.sh" in step.get("run", "")]
    steps = {step["run"].split()[-1]: step for step in calls}
    assert set(steps) == {"build", "comment"}
    assert {"RECIPES", "BASE", "ASSETBUILD_CACHE"} <= set(steps["build"]["env"])
    assert {"NUMBER", "GH_TOKEN"} <= set(steps["comment"]["env"])
