"""A package of somebody else's brings a target, a check and a collision method by entry points."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from tiny import box_obj

PAGE = Path(__file__).parents[2] / "docs/how-to/plugins.md"
BLOCK = re.compile(r"^```\w+ file=(\S+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
URDF = """\
<robot name="crate"><link name="crate">
  <inertial><mass value="4"/>
    <inertia ixx="0.04" iyy="0.04" izz="0.04" ixy="0" ixz="0" iyz="0"/></inertial>
  <visual><geometry><mesh filename="crate.obj"/></geometry></visual>
</link></robot>
"""


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
    for name, text in BLOCK.findall(PAGE.read_text(encoding="utf-8")):
        path = (tmp_path if name.endswith(".yaml") else site) / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    project = tomllib.loads((site / "pyproject.toml").read_text())["project"]
    install(site, project["name"], project["entry-points"])
    (tmp_path / "crate.urdf").write_text(URDF)
    (tmp_path / "crate.obj").write_bytes(box_obj((0.2, 0.3, 0.4)))
    return site


def run(site: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(site), *filter(None, [os.environ.get("PYTHONPATH")])]),
        "ASSETBUILD_CACHE": str(site.parent / "cache"),
    }
    command = [sys.executable, "-m", "assetbuild", *arguments]
    return subprocess.run(
        command, cwd=site.parent, env=environment, capture_output=True, text=True, timeout=300
    )


@pytest.mark.slow
def test_the_page_of_the_how_to_builds_a_robot(site: Path):
    done = run(site, "build", "crate.yaml", "-o", "out", "--fail-on", "never")
    assert done.returncode == 0, done.stderr
    bundle = site.parent / "out"
    assert "<static>true</static>" in (bundle / "sdf/crate.sdf").read_text()
    report = json.loads((bundle / "report/report.json").read_bytes())
    assert report["checks"]["wind"]["figures"]["force_N"] == pytest.approx(0.5 * 1.2 * 900 * 0.5)
    assert report["checks"]["sdf_equal"] == {"status": "pass", "figures": {
        "differ": 0, "facts": 2, "unread": 0}}  # fmt: skip
    gusts = [found for found in report["findings"] if found["rule"] == "wind.gust"]
    assert [found["severity"] for found in gusts] == ["warning"]
    assert 'size="0.102 0.152 0.202"' in (bundle / "mjcf/crate.xml").read_text()


@pytest.mark.slow
def test_its_steps_run_again_when_its_code_is_edited(site: Path):
    words = ("build", "crate.yaml", "-o", "out", "--fail-on", "never", "--log-json", "log")
    run(site, *words)
    path = site / "acme_assets/sdf.py"
    text = path.read_text()
    path.write_text(text.replace('version="1.10"', 'version="1.11"') + "# an edit\n")
    run(site, *words)
    events = map(json.loads, (site.parent / "log").read_text().splitlines())
    ran = {event["step"]: event["reason"] for event in events if event.get("status") == "ran"}
    assert ran["sdf"] == "code acme_assets.sdf changed"
    assert "mjcf" not in ran
    assert 'version="1.11"' in (site.parent / "out/sdf/crate.sdf").read_text()


@pytest.mark.slow
def test_its_reader_finds_an_edited_file_and_what_it_does_not_know(site: Path):
    run(site, "build", "crate.yaml", "-o", "out", "--fail-on", "never")
    path = site.parent / "out/sdf/crate.sdf"
    text = path.read_text().replace("<mass>4.0", "<mass>5.0").replace("<static>", "<wind/><static>")
    path.write_text(text)
    done = run(site, "validate", "out", "--static")
    assert "equal.sdf.mass" in done.stdout
    assert "mass is 5 kg in the SDF, 4 kg in the robot" in done.stdout
    assert "equal.unread" in done.stdout


@pytest.mark.slow
def test_a_target_without_a_reader_builds_and_is_not_ready(site: Path):
    (points,) = site.glob("*.dist-info/entry_points.txt")
    points.write_text(points.read_text().replace("[assetbuild.facts.readers]", "[nobody.reads]"))
    done = run(site, "build", "crate.yaml", "-o", "out")
    verdict = json.loads((site.parent / "out/report/report.json").read_bytes())["verdict"]
    assert (done.returncode, verdict["ready"]) == (0, False)
    assert verdict["formats"]["not_compared"] == ["sdf"]


def test_its_keys_are_checked_and_described_like_all_others(site: Path):
    recipe = site.parent / "crate.yaml"
    recipe.write_text(recipe.read_text().replace("grow: 2 mm", "gorw: 2 mm"))
    wrong = run(site, "check", "crate.yaml")
    assert wrong.returncode == 2
    assert "crate.yaml:5:" in wrong.stderr
    assert "`bounds` has no key `gorw`" in wrong.stderr
    assert "did you mean `grow`?" in wrong.stderr
    schema = json.loads(run(site, "schema").stdout)
    assert schema["properties"]["sdf"]["$ref"].endswith("SdfOptions")
    assert "wind" in schema["$defs"]["Validate"]["properties"]
    assert "grow" in schema["$defs"]["BoundsRule"]["properties"]


def test_a_broken_plug_in_is_one_error_that_names_its_distribution(site: Path):
    (site / "acme_assets/sdf.py").write_text("import nothing_like_that\n")
    done = run(site, "build", "crate.yaml")
    assert done.returncode == 1
    assert "plug-in `sdf` (targets) of acme-assets 0.1 cannot be loaded" in done.stderr
    assert "Traceback" not in done.stderr


def test_two_plug_ins_of_one_name_are_one_error(site: Path):
    install(site, "other-assets", {"assetbuild.targets": {"mjcf": "acme_assets.sdf"}})
    done = run(site, "check", "crate.yaml")
    assert done.returncode == 1
    assert "two plug-ins are called `mjcf` (targets)" in done.stderr
    assert "of other-assets 0.1 and of assetbuild itself" in done.stderr


def test_only_what_a_recipe_names_is_imported(site: Path):
    (site / "acme_assets/sdf.py").write_text("raise RuntimeError('imported')\n")
    recipe = site.parent / "crate.yaml"
    text = recipe.read_text().replace(", sdf]", "]").replace("sdf: {static: true}\n", "")
    recipe.write_text(text)
    assert run(site, "check", "crate.yaml").returncode == 0


@pytest.mark.slow
def test_an_edit_of_its_code_is_no_null_build(site: Path):
    def builds() -> bool:
        log = site.parent / "out.run.json"
        log.unlink(missing_ok=True)
        done = run(site, "build", "crate.yaml", "-o", "out", "--fail-on", "never")
        assert done.returncode == 0, done.stderr
        return log.exists()

    assert builds()
    assert not builds()
    plugin = next(path for path in site.rglob("*.py") if "wind" in path.name)
    text = plugin.read_text(encoding="utf-8")
    assert "0.5 * " in text
    plugin.write_text(text.replace("0.5 * ", "0.25 * "), encoding="utf-8")
    assert builds()
    report = json.loads((site.parent / "out/report/report.json").read_bytes())
    assert report["checks"]["wind"]["figures"]["force_N"] == pytest.approx(0.25 * 1.2 * 900 * 0.5)
    assert not builds()
    (plugin.parent / "new.py").write_text("", encoding="utf-8")
    assert builds()
