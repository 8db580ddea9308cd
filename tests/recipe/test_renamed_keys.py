"""Keys by the names of version 0.1 still work, and a finding names the new one."""

from __future__ import annotations

RECIPE = """\
schema: assetbuild/v1
robot: tiny
source: {path: tiny, urdf: tiny.urdf}
contact:
  mask: 3
  links: {foot: {partners: 5}}
identify:
  - {logs: [{file: a.csv}], tied: [".*"], use: false, widest: 0.5}
validate: {trials: {dead: 0.1}, free_fall: {broken: 0.2}}
variants:
  hard: {validate: {sine: {broken: 0.3}}}
"""
VALUES = {
    "contact.contype": 3,
    "contact.links.foot.conaffinity": 5,
    "identify.0.shared": (".*",),
    "identify.0.apply": False,
    "identify.0.max_relative_interval": 0.5,
    "validate_.trials.min_response": 0.1,
    "validate_.free_fall.error_limit": 0.2,
    "validate_.sine.error_limit": 0.3,
}


def value(recipe: object, key: str) -> object:
    for part in key.split("."):
        if part.isdigit() or isinstance(recipe, dict):
            recipe = recipe[int(part) if part.isdigit() else part]  # type: ignore[index]
        else:
            recipe = getattr(recipe, part)
    return recipe


def test_old_keys_set_what_the_new_ones_do(load):
    recipe = load(RECIPE, "hard")
    assert {key: value(recipe.recipe, key) for key in VALUES} == VALUES


def test_each_old_key_is_a_finding_with_its_line_and_new_name(load):
    renamed = load(RECIPE, "hard").renamed
    assert {f.rule for f in renamed} == {"recipe.renamed_key"}
    assert [(f.where, f.message.split("`")[1::2]) for f in renamed] == [
        ("recipes/r.yaml:5:3", ["mask", "contype"]),
        ("recipes/r.yaml:6:18", ["partners", "conaffinity"]),
        ("recipes/r.yaml:8:29", ["tied", "shared"]),
        ("recipes/r.yaml:8:43", ["use", "apply"]),
        ("recipes/r.yaml:8:55", ["widest", "max_relative_interval"]),
        ("recipes/r.yaml:9:21", ["dead", "min_response"]),
        ("recipes/r.yaml:9:45", ["broken", "error_limit"]),
        ("recipes/r.yaml:11:28", ["broken", "error_limit"]),
    ]


def test_a_key_by_both_names_is_refused(refused):
    text = RECIPE.replace("  mask: 3", "  mask: 3\n  contype: 1")
    assert "contact.mask: unknown key" in refused(text, "hard").message
