"""The page in a real browser: it draws, moves a joint, switches layers, and logs no error."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from robot_files import run_step, write_robot_ports
from tiny import TinyRobot, tiny_quadruped

from assetbuild.rendering.viewer import Viewer
from assetbuild.report.document import make_report
from assetbuild.report.html import View, html_page
from assetbuild.robot.shapes import Shapes

from .robots_for_tests import subject

CHROMIUM = (
    shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
)
FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
    "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
    "--virtual-time-budget=10000", "--hide-scrollbars",
)  # fmt: skip
LISTEN = """<script>
window.told = [];
window.addEventListener("error", (e) => told.push(String(e.message)));
for (const kind of ["error", "warn"]) {
  const old = console[kind];
  console[kind] = (...words) => { told.push(kind + ": " + words.join(" ")); old(...words); };
}
</script>"""


@pytest.fixture
def visit(tmp_path: Path) -> Callable[[str, str], dict]:
    """Opens a page, runs a script in it, and returns what the script puts into `result`."""
    if CHROMIUM is None:
        pytest.skip("no chromium: apt-get install chromium")

    def run(page: str, script: str) -> dict:
        tail = f"""<pre id="result"></pre><script>
        (async () => {{
          const result = {{}};
          try {{ await assetbuildReady; {script} }} catch (e) {{ result.thrown = String(e); }}
          result.told = told;
          document.getElementById("result").textContent = JSON.stringify(result);
        }})();</script>"""
        file = tmp_path / "page.html"
        file.write_text(
            page.replace("<title>", LISTEN + "<title>").replace("</body>", tail + "</body>")
        )
        command = [CHROMIUM, *FLAGS, f"--user-data-dir={tmp_path / 'profile'}", "--dump-dom"]
        done = subprocess.run(
            [*command, file.as_uri()], capture_output=True, text=True, timeout=120
        )
        found = re.search(r'<pre id="result">(.*?)</pre>', done.stdout, re.DOTALL)
        assert found and found.group(1), done.stderr[-2000:]
        return json.loads(found.group(1).replace("&amp;", "&").replace("&lt;", "<"))

    return run


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The report of the tiny quadruped."""
    return _page(tmp_path_factory.mktemp("page"), tiny_quadruped())


def _page(folder: Path, robot: TinyRobot) -> str:
    inputs = write_robot_ports(folder / "in", robot)
    findings = run_step(Viewer(), inputs, folder / "out")
    if findings:
        pytest.skip(findings[0].message)
    out = folder / "out"
    view = View((out / "viewer.json").read_text(), (out / "three.js").read_text())
    return html_page(make_report("tiny", [], {}, {}, lambda _: ""), subject(robot), None, view)


def test_it_loads_moves_a_joint_switches_layers_and_logs_nothing(visit, page):
    joint = tiny_quadruped().tree.moving_joints[1]
    child = json.dumps(_below(joint.child))
    result = visit(page, f"""
        const root = document.getElementById("viewer");
        const wait = () => new Promise((go) => setTimeout(go, 100));
        await wait();
        result.ready = root.dataset.ready;
        const before = assetbuildViewer.worldPosition({child});
        const slider = document.getElementById("joint-{joint.name}");
        slider.value = Number(slider.min) + 0.25 * (slider.max - slider.min);
        slider.dispatchEvent(new Event("input"));
        await wait();
        const after = assetbuildViewer.worldPosition({child});
        result.moved = Math.hypot(...after.map((v, i) => v - before[i]));
        result.shown = slider.parentElement.querySelector("output").textContent;
        for (const box of root.querySelectorAll("input[data-layer]")) {{
          box.click();
          await wait();
        }}
        const colour = root.querySelector("select[data-colour]");
        colour.value = "distance";
        colour.dispatchEvent(new Event("change"));
        await wait();
        result.legend = !root.querySelector(".viewer-legend").hidden;
        assetbuildViewer.choose({json.dumps(joint.child)});
        result.facts = root.querySelector(".viewer-facts").textContent;
        result.frames = Number(root.dataset.frames);
        root.querySelector(".viewer-poses button").click();
        const again = assetbuildViewer.worldPosition({child});
        result.back = Math.hypot(...again.map((v, i) => v - before[i]));
    """)  # fmt: skip
    assert "thrown" not in result, result
    assert result["told"] == []
    assert result["ready"] == "true"
    assert result["moved"] > 0.01
    assert result["back"] < 1e-6
    assert "rad" in result["shown"]
    assert result["legend"]
    assert joint.name in result["facts"] and "kg" in result["facts"]
    assert result["frames"] >= 1


def test_the_view_stands_where_forward_kinematics_says(visit, page):
    """three.js composes the same transforms from the page's data as `robot.tree` does."""
    from assetbuild.robot.tree import forward_kinematics

    robot = tiny_quadruped()
    home = robot.control.keyframes[0]
    X_root_body = forward_kinematics(robot.tree, dict(home.joints))
    names = json.dumps([b.name for b in robot.tree.bodies])
    result = visit(page, f"""
        await new Promise((go) => setTimeout(go, 50));
        result.at = {names}.map((name) => assetbuildViewer.worldPosition(name));
    """)  # fmt: skip
    for body, at in zip(robot.tree.bodies, result["at"], strict=True):
        expected = (home.base @ X_root_body[body.name]).xyz
        assert at == pytest.approx(expected, abs=1e-6), body.name


def _below(body: str) -> str:
    """The last body under this one: what moves when its joint turns."""
    tree = tiny_quadruped().tree
    found = body
    for joint in tree.joints:
        if joint.parent == found:
            found = joint.child
    return found


def test_a_robot_without_visual_geometry_shows_what_collides(visit, page, tmp_path):
    robot = tiny_quadruped()
    bare = replace(robot, shapes=Shapes(robot.shapes.of("collision")))
    checked = """result.on = [...document.querySelectorAll("input[data-layer]:checked")]
        .map((box) => box.dataset.layer);"""
    assert visit(page, checked)["on"] == ["visual"]
    assert visit(_page(tmp_path, bare), checked)["on"] == ["visual", "collision"]
