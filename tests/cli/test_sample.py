"""`assetbuild sample`: robots drawn of the real Go1, read back by MuJoCo, and wrong ranges."""

import json
import re

import mujoco
import pytest

RANGES = """
randomize:
  links: {".*": {density: [0.8, 1.2], com: 0.01, stretch: 0.1}}
  payloads: [{link: trunk, mass: [2, 3], size: [0.2, 0.15, 0.1], at: [0, 0, 0.1]}]
  friction: [0.4, 1.2]
"""


@pytest.mark.slow
def test_three_robots_load_and_differ_as_drawn(place):
    """The ranges take the place of those that the recipe of the Go1 has."""
    text = place.recipe.read_text()
    place.recipe.write_text(re.sub(r"\nrandomize:.*?\n(?=\n)", RANGES, text, flags=re.DOTALL))
    done = place.run("sample", "recipes/go1.yaml", "-n", "3", "--judge", "300", "-o", "drawn")
    assert done.returncode == 0, done.stderr
    assert "300 draws" in done.stdout and "trunk" in done.stdout
    folder = place.folder / "drawn"
    samples = json.loads((folder / "samples.json").read_text())["samples"]
    masses = []
    for index, sample in enumerate(samples):
        model = mujoco.MjModel.from_xml_path(str(folder / f"go1_{index:03}.xml"))
        for body in sample["bodies"]:
            assert model.body(body["body"]).mass[0] == body["inertial"]["mass_kg"]
        masses.append(model.body_mass.sum())
        touching = model.geom_friction[model.geom_contype > 0]
        assert set(touching[:, 0]) == {sample["friction"]}
    assert len(set(masses)) == 3
    assert all(0.8 * 13.1 + 2 < mass < 1.2 * 13.2 + 3 for mass in masses)


def test_a_recipe_without_ranges_says_what_to_add(legs):
    told = legs.refused("sample", "legs.yaml")
    assert "has no `randomize`" in told and "hint: add" in told


@pytest.mark.parametrize(
    ("ranges", "message"),
    [
        ("{links: {trnk: {}}}", "did you mean `trunk`"),
        ("{links: {RF_foot: {}}}", "merged into `RF_calf`"),
        ("{friction: [1, 0.5]}", "must not exceed the second"),
    ],
)
def test_wrong_ranges_are_told_with_their_line(warm_legs, ranges, message):
    warm_legs.edit("\ntargets:", f"\nrandomize: {ranges}\ntargets:")
    told = warm_legs.refused("sample", "legs.yaml")
    assert message in told and "legs.yaml:" in told


@pytest.mark.parametrize("verb", ["sample", "bench"])
def test_an_edit_that_fails_is_told_with_its_line(warm_legs, verb):
    twins = "edits: [{rename: {links: {'.*_foot': foot}}}]"
    warm_legs.edit("\ntargets:", f"\n{twins}\nrandomize: {{friction: [0.5, 1]}}\ntargets:")
    told = warm_legs.refused(verb, "legs.yaml")
    assert "legs.yaml:8:10: rename: the links `" in told
    assert "hint: a narrower pattern" in told
