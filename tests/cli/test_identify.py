"""`assetbuild identify`: a log beside a recipe becomes numbers of the build, and of the recipe."""

import json
import re

import pytest
from logs import KD, KP, TWO_LINKS_URDF, columns_of, two_links, write_csv

from assetbuild.pipeline.recipes import load_recipe

from .conftest import Place

RECIPE = f"""\
schema: assetbuild/v1
robot: arm
source: {{path: robot, urdf: arm.urdf, license: MIT}}
identify:
  - logs: [{{file: chirp.csv}}]
    recorded: {{kp: {KP}, kd: {KD}}}
actuators:   # guessed
  - {{joints: ".*", model: pd, kp: 30, kd: 1, damping: 0.1, friction: 0.1, armature: 0.004}}  # all
targets: [urdf, mjcf]
"""


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    folder = tmp_path_factory.mktemp("arm")
    place = Place(folder, folder / "store", "arm.yaml")
    place.robot.mkdir()
    (place.robot / "arm.urdf").write_text(TWO_LINKS_URDF)
    place.recipe.write_text(RECIPE)
    target, position, _ = two_links(16.0)
    write_csv(folder / "chirp.csv", columns_of(target, position))
    return place


@pytest.mark.slow
def test_from_a_log_to_the_recipe(arm):
    done = arm.run("identify", "arm.yaml", "--json")
    assert done.returncode == 0, done.stderr
    (fit,) = json.loads(done.stdout)
    assert all(not each["refused"] for each in fit["parameters"])

    assert "fit_logs 0" not in arm.ran()
    model = (arm.bundle / "mjcf/arm.xml").read_text()
    frictions = re.findall(r'frictionloss="([\d.]+)"', model)
    assert [float(text) for text in frictions] == pytest.approx([0.4, 0.2], rel=0.05)
    card = (arm.bundle / "model_card.md").read_text()
    assert "armature and friction or damping of 2 of 2 drives are measured" in card
    assert "measured: chirp.csv" in card
    provenance = (arm.bundle / "provenance.json").read_text()
    assert fit["logs"][0]["sha256"] in provenance
    page = (arm.bundle / "report/index.html").read_text()
    assert "Measured on the real robot" in page and "friction of elbow" in page

    # A new gain fits nothing anew.
    arm.edit("kp: 30,", "kp: 45,")
    ran = arm.ran()
    assert {"control", "mjcf"} <= ran and "fit_logs 0" not in ran

    done = arm.run("identify", "arm.yaml", "--write")
    assert done.returncode == 0, done.stderr
    text = arm.recipe.read_text()
    assert "# guessed" in text and "# all" in text and text.count("measured:") >= 2
    rows = load_recipe(arm.recipe).recipe.actuators
    assert [row.kp for row in rows] == [45, 45]
    assert [row.friction for row in rows] == pytest.approx([0.4, 0.2], rel=0.05)
    assert all(row.measured == ("armature", "damping", "friction") for row in rows)


def test_a_recipe_without_logs_says_what_to_add(arm):
    (arm.folder / "plain.yaml").write_text(
        re.sub(r"identify:.*?(?=actuators)", "", RECIPE, flags=re.S)
    )
    assert "identify: [{logs:" in arm.refused("identify", "plain.yaml")


def test_a_log_that_is_not_there_is_named_with_its_line(arm):
    (arm.folder / "lost.yaml").write_text(RECIPE.replace("chirp.csv", "lost.csv"))
    told = arm.refused("build", "lost.yaml")
    assert "lost.yaml:5" in told and "there is no such file" in told
