"""A package of somebody else's brings a target, a check and a collision method by entry points."""

from __future__ import annotations

import itertools
import json
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tomllib
from pathlib import Path
from typing import Any

import commands
import pytest

import assetbuild

HOW_TO = Path(__file__).parents[2] / "docs/how-to"
PACKAGE = HOW_TO / "plugin"
"""The package that the page shows, with its recipe and a crate."""


def install(folder: Path, name: str, points: dict[str, dict[str, str]]) -> None:
    """What `pip install` leaves of a package's metadata."""
    info = folder / f"{name.replace('-', '_')}-0.1.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 0.1\n")
    text = "".join(
        f"[{group}]\n" + "".join(f"{key} = {value}\n" for key, value in named.items())
        for group, named in points.items()
    )
    (info / "entry_points.txt").write_text(text)


@pytest.fixture
def site(tmp_path: Path) -> Path:
    """The page's package installed, and its recipe with a crate beside it."""
    site = tmp_path / "site"
    shutil.copytree(PACKAGE, site)
    for path in site.glob("crate.*"):
        path.rename(tmp_path / path.name)
    project = tomllib.loads((site / "pyproject.toml").read_text())["project"]
    install(site, project["name"], project["entry-points"])
    return site


def plain(site: Path, more: str = "") -> str:
    """The name of a recipe of the same robot that asks for nothing of the package."""
    (site.parent / "plain.yaml").write_text(
        "schema: assetbuild/v1\nrobot: crate\nbase: floating\n"
        f"source: {{path: ., urdf: crate.urdf, license: MIT}}\ntargets: [urdf, mjcf]\n{more}"
    )
    return "plain.yaml"


def run(site: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return python(site, "-m", "assetbuild", *arguments)


def forked(site: Path, verb: str, *words: str) -> subprocess.CompletedProcess[str]:
    """A command that runs no step of the package: a fork whose folder is the package's own."""
    environment = {**os.environ, "ASSETBUILD_CACHE": str(site.parent / "cache")}
    return commands.run([verb, *(f"../{word}" for word in words)], site, environment)


def python(site: Path, *arguments: str, stdin: str = "") -> subprocess.CompletedProcess[str]:
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(site), *filter(None, [os.environ.get("PYTHONPATH")])]),
        "ASSETBUILD_CACHE": str(site.parent / "cache"),
    }
    command = [sys.executable, *arguments]
    return subprocess.run(
        command, cwd=site.parent, env=environment, input=stdin, capture_output=True, text=True,
        timeout=300,
    )  # fmt: skip


def test_the_page_shows_every_file_of_its_package():
    shown = re.findall(
        r'^--8<-- "how-to/(\S+)"$', (HOW_TO / "plugins.md").read_text(), re.MULTILINE
    )
    files = {path for path in PACKAGE.rglob("*.*") if path.suffix in (".py", ".yaml", ".toml")}
    assert {HOW_TO / name for name in shown} == files - {PACKAGE / "acme_assets/__init__.py"}


def build(site: Path, *more: str) -> bool:
    """Builds the page's robot; whether it was no null build, which leaves no log."""
    log = site.parent / "out.run.json"
    log.unlink(missing_ok=True)
    done = run(site, "build", "crate.yaml", "-o", "out", "--fail-on", "never", *more)
    assert done.returncode == 0, done.stderr
    return log.exists()


def report_of(site: Path) -> dict[str, Any]:
    return json.loads((site.parent / "out/report/report.json").read_bytes())


WIND_N = 1.2 * 900 * 0.5


@pytest.mark.slow
def test_the_page_of_the_how_to_builds_a_robot_and_an_edit_of_its_code_is_no_null_build(site: Path):
    assert build(site)
    bundle, report = site.parent / "out", report_of(site)
    assert "<static>true</static>" in (bundle / "sdf/crate.sdf").read_text()
    assert report["verdict"]["ready"]
    assert report["checks"]["wind"]["figures"]["force_N"] == pytest.approx(0.5 * WIND_N)
    assert report["checks"]["sdf_equal"] == {
        "status": "pass",
        "figures": {"differ": 0, "facts": 2},
    }
    gusts = [found for found in report["findings"] if found["rule"] == "wind.gust"]
    assert [found["severity"] for found in gusts] == ["warning"]
    assert 'size="0.102 0.152 0.202"' in (bundle / "mjcf/crate.xml").read_text()
    assert not build(site)

    plugin = site / "acme_assets/wind.py"
    text = plugin.read_text(encoding="utf-8")
    assert "0.5 * " in text
    plugin.write_text(text.replace("0.5 * ", "0.25 * "), encoding="utf-8")
    assert build(site, "--log-json", "log")
    events = map(json.loads, (site.parent / "log").read_text().splitlines())
    ran = {event["step"]: event["reason"] for event in events if event.get("status") == "ran"}
    assert "code acme_assets.wind changed" in ran.values()
    assert "mjcf" not in ran
    assert report_of(site)["checks"]["wind"]["figures"]["force_N"] == pytest.approx(0.25 * WIND_N)
    (site / "acme_assets/new.py").write_text("", encoding="utf-8")
    assert build(site, "--log-json", "log")

    path = bundle / "sdf/crate.sdf"
    text = path.read_text().replace("<mass>5.0", "<mass>4.0").replace("<static>", "<wind/><static>")
    path.write_text(text)
    done = run(site, "validate", "out", "--static")
    assert "mass is 4 kg in the SDF, 5 kg in the robot" in done.stdout
    assert "equal.sdf.mass" in done.stdout
    assert "equal.sdf.wind" in done.stdout


def test_its_keys_are_checked_and_described_like_all_others(site: Path):
    recipe = site.parent / "crate.yaml"
    recipe.write_text(recipe.read_text().replace("grow: 2 mm", "gorw: 2 mm"))
    wrong = forked(site, "check", "crate.yaml")
    assert wrong.returncode == 2
    assert "crate.yaml:5:" in wrong.stderr
    assert "`bounds` has no key `gorw`" in wrong.stderr
    assert "did you mean `grow`?" in wrong.stderr
    schema = json.loads(forked(site, "schema").stdout)
    assert schema["properties"]["sdf"]["$ref"].endswith("SdfOptions")
    assert "wind" in schema["$defs"]["Validate"]["properties"]
    assert "grow" in schema["$defs"]["BoundsRule"]["properties"]


def test_a_broken_plug_in_is_one_error_that_names_its_distribution(site: Path):
    (site / "acme_assets/sdf.py").write_text("import nothing_like_that\n")
    done = forked(site, "build", "crate.yaml")
    assert done.returncode == 1
    assert "plug-in `sdf` (targets) of acme-assets 0.1 cannot be loaded" in done.stderr
    assert "Traceback" not in done.stderr


def test_two_plug_ins_of_one_name_are_one_error_where_a_recipe_names_it(site: Path):
    install(site, "other-assets", {"assetbuild.targets": {"sdf": "acme_assets.sdf"}})
    done = forked(site, "check", "crate.yaml")
    assert done.returncode == 1
    assert "two plug-ins are called `sdf` (targets)" in done.stderr
    assert "acme-assets 0.1" in done.stderr
    assert "other-assets 0.1" in done.stderr
    assert forked(site, "check", plain(site)).stderr == ""


def test_a_plug_in_with_a_name_of_ours_is_left_out_and_named(site: Path):
    install(site, "other-assets", {"assetbuild.targets": {"mjcf": "acme_assets.nothing"}})
    done = forked(site, "check", "crate.yaml")
    assert done.returncode == 0
    (line,) = done.stderr.splitlines()
    assert line.startswith("warning: plug-in `mjcf` (targets) of other-assets 0.1 is not used")


FAILS = (
    "raise RuntimeError('imported')\n",
    "raise SystemExit(3)\n",
    "import nothing_like_that\n",
    "def (\n",
    "\n",
)


def test_a_plug_in_that_nobody_names_is_not_imported(site: Path):
    for path, text in zip((site / "acme_assets").glob("*.py"), itertools.cycle(FAILS)):
        path.write_text(text)
    done = forked(site, "check", plain(site))
    assert (done.returncode, done.stderr) == (0, "")


def test_a_broken_plug_in_does_not_stand_in_front_of_another_recipe_s_mistake(site: Path):
    (site / "acme_assets/wind.py").write_text("import nothing_like_that\n")
    recipe = site.parent / plain(site)
    recipe.write_text(recipe.read_text().replace("base:", "bse:"))
    done = forked(site, "check", recipe.name)
    assert done.returncode == 2
    warnings = [line for line in done.stderr.splitlines() if line.startswith("warning:")]
    assert len(warnings) == 1
    assert "plug-in `wind` (checks) of acme-assets 0.1 cannot be loaded" in warnings[0]
    assert "did you mean `base`?" in done.stderr


def test_a_required_key_is_asked_of_those_alone_who_name_the_check(site: Path):
    check = site / "acme_assets/wind.py"
    check.write_text(check.read_text().replace("Field(10.0, ", "Field("))
    target = site / "acme_assets/sdf.py"
    text = target.read_text().replace("SdfOptions = SdfOptions()", "SdfOptions")
    target.write_text(text)
    other = forked(site, "check", plain(site))
    assert (other.returncode, other.stderr) == (0, "")
    recipe = site.parent / "crate.yaml"
    recipe.write_text(recipe.read_text().replace("speed: 30, ", ""))
    own = forked(site, "check", "crate.yaml")
    assert own.returncode == 2
    assert "validate.wind" in own.stderr
    assert "missing key `speed`" in own.stderr


ASKS = {
    "by its name": ("", "wind: {}", True),
    "with its keys": ("", "wind: {speed: 30}", True),
    "by null": ("", "wind: null", False),
    "not at all": ("", "mass: {}", False),
    "by a section of another name": ('"validate.wind"|"validate.gust"', "gust: {}", True),
    "by a key among those of validate": ('"validate.wind"|"validate"', "speed: 30", True),
    "in a list": (
        'section = "validate.wind"|listed_in = "validate.linters"', "linters: [wind]", True),
    "without keys of its own": (
        'section = "validate.wind"||Field(10.0, description="m/s, of the gust")|10.0'
        '|Field(0.1, description="m2 that it meets")|0.1', "wind: {}", True),
    "null, without keys of its own": (
        'section = "validate.wind"||Field(10.0, description="m/s, of the gust")|10.0'
        '|Field(0.1, description="m2 that it meets")|0.1', "wind: null", False),
}  # fmt: skip


ASKED = """\
import json, os, sys
from pathlib import Path
from assetbuild.pipeline.recipes import load_recipe
from assetbuild.plan.asked import checks_of
check, recipe = map(Path, sys.argv[1:3])
for source, text in json.load(sys.stdin):
    check.write_text(source)
    recipe.write_text(text)
    if pid := os.fork():
        os.waitpid(pid, 0)
        continue
    read = load_recipe(str(recipe)).recipe
    runs = any(name == "wind" and kind.configure(read) for name, kind in checks_of(read))
    print(json.dumps(runs), flush=True)
    os._exit(0)
"""
"""Each case in a process of its own, which reads the plug-in as it is then."""


def test_a_check_runs_where_a_recipe_names_it(site: Path):
    check = site / "acme_assets/wind.py"
    cases: list[tuple[str, str]] = []
    for change, stated, _ in ASKS.values():
        text = check.read_text()
        words = change.split("|") if change else []
        for old, new in zip(words[::2], words[1::2], strict=True):
            assert old in text
            text = text.replace(old, new)
        recipe = site.parent / plain(site, f"validate: {{{stated}}}\n")
        cases.append((text, recipe.read_text()))
    done = python(site, "-B", "-c", ASKED, str(check), recipe.name, stdin=json.dumps(cases))
    found = dict(zip(ASKS, map(json.loads, done.stdout.splitlines()), strict=True))
    assert found == {name: runs for name, (_, _, runs) in ASKS.items()}, done.stderr


@pytest.mark.slow
def test_an_editable_installation_works_and_changes_no_other_robot(site: Path, tmp_path: Path):
    """setuptools leaves an import hook in a `.pth` file."""
    for metadata in site.glob("*.dist-info"):
        metadata.rename(tmp_path / metadata.name)
    project = site / "pyproject.toml"
    own = project.read_text().replace('dependencies = ["assetbuild"]', "dependencies = []")
    system = '[build-system]\nrequires = ["setuptools"]\nbuild-backend = "setuptools.build_meta"\n'
    project.write_text(f'{own}\n{system}\n[tool.setuptools]\npackages = ["acme_assets"]\n')
    (site / "acme_assets/__init__.py").touch()
    venv = tmp_path / "venv"
    subprocess.run([sys.executable, "-m", "venv", "--system-site-packages", venv], check=True)
    (packages,) = venv.glob("lib/python*/site-packages")
    ours = [*sysconfig.get_paths()["purelib"].split(), str(Path(assetbuild.__file__).parents[1])]
    (packages / "ours.pth").write_text("\n".join(ours))
    environment = os.environ | {
        "ASSETBUILD_CACHE": str(tmp_path / "cache"),
        "MUJOCO_GL": "disable",
    }

    def call(*words: str) -> str:
        done = subprocess.run(
            [venv / "bin/python", "-m", *words],
            cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=300,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        return done.stderr

    def manifest() -> dict[str, str]:
        said = call("assetbuild", "build", plain(site), "-o", "plain", "--fail-on", "never")
        assert "wind" not in said and "warning: plug-in" not in said
        files = json.loads((tmp_path / "plain/manifest.json").read_bytes())["files"]
        return {file["path"]: file["sha256"] for file in files}

    before = manifest()
    call("pip", "install", "--no-deps", "-e", str(site))
    assert manifest() == before
    call("assetbuild", "build", "crate.yaml", "-o", "out", "--fail-on", "never")
    assert "<static>true</static>" in (tmp_path / "out/sdf/crate.sdf").read_text()
    assert report_of(site)["checks"]["wind"]["figures"]["force_N"] == pytest.approx(0.5 * WIND_N)
