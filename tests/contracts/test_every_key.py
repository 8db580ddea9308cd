"""A key of the recipe that changes nothing is a defect.

Two robots state every key that they have a use for. Each is set to another value, one at a time:
a target writes other bytes, or some step says something else; of a key that asks for work (meshes,
collision, edits, checks) another step is planned. That each format holds what it can is shown
where the facts are: `test_one_declaration`, `test_facts`.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
import yaml

from assetbuild.engine.graph import Node
from assetbuild.engine.planner import settle
from assetbuild.engine.processes import Processes
from assetbuild.engine.step import Step
from assetbuild.pipeline.opening import open_session
from assetbuild.pipeline.recipes import load_recipe, schema_text
from assetbuild.plan import plan
from assetbuild.plugin_types import Check

HERE = Path(__file__).parent / "every_key"
ROBOTS = ("dog", "press")
PLANNED = ("collision", "edits", "validate", "visual")
"""Sections that ask for work: another step is enough, whatever comes of it on a tiny robot."""
ELSEWHERE = {
    "actuators[].unit": "picks the joints that turn, or those that slide: tests/control",
    "collision.default": "tests/collision: each method has other keys, and uses all of its own",
    "collision.links": "likewise",
    "compose": "tests/compose",
    "edits": "tests/edits; those that a press can have are changed here, too",
    "identify": "tests/identify: a log is needed",
    "loops[].a.link": "another loop: tests/control",
    "loops[].b.link": "likewise",
    "loops[].a.rpy": "a loop of which one end turns does not close: tests/control",
    "loops[].b.rpy": "likewise",
    "loops[].kind": "another kind has other keys: tests/control",
    "mjcf.grammar": "tests/source: for the words of an MJCF that is read",
    "motor_file": "tests/recipe: motors of another file",
    "robot": "a name",
    "rules": "tests/report: what a finding is taken for",
    "schema": "has one value",
    "source": "tests/source: another source is another robot",
    "targets": "tests/contracts/test_targets.py",
    "validate.alignment": "tests/checks: another engine must be installed",
    "validate.linters": "tests/checks: another program must be installed",
    "validate.policy": "tests/policy: needs a policy",
    "validate.simulators": "likewise",
    "validate.sine": "likewise: MuJoCo alone is not swung",
    "validate.smoke": "tests/checks: a trainer must be installed",
    "validate.smoke_bounds": "likewise",
    "variants": "tests/recipe: keys of the recipe again",
    "xrdf": "tests/targets/test_xrdf.py, tests/facts/test_planted.py: its spheres take long",
}
IN_THE_CARD = ("source", "friction_source", "measured", "guessed")
"""Where a number comes from: `model_card.md` states it, which tests/report checks."""
OTHER: dict[str, Any] = json.loads((HERE / "other.json").read_text())
"""Values that a rule of thumb would not find."""


@dataclass(frozen=True)
class Built:
    """A robot without its checks. written: by target; said: by all steps; planned: they.

    whole: whether no step is missing that an answer would add.
    """

    written: dict[str, object]
    said: frozenset[tuple[str, str, str]]
    planned: dict[str, Step]
    whole: bool

    def plans_other_work(self, before: Built) -> bool:
        if self.whole:
            return self.planned != before.planned
        return any(before.planned.get(label) != step for label, step in self.planned.items())


def built(recipe: Path, *, may_run: Callable[[Node], bool]) -> Built:
    """Every step that may run, made."""
    loaded = load_recipe(recipe)
    with open_session(loaded) as session, Processes(session) as runner:
        done = settle(
            lambda planner: plan(loaded, None, planner, drawn=False),
            session, runner, jobs=2, may_run=may_run,
        )  # fmt: skip
        assert not done.errors, done.errors[0]
        targets = dict(done.outline.targets)
        if done.outline.ranges is not None:
            targets["dr"] = done.outline.ranges
        findings = [one for result in done.results.values() for one in result.findings]
        return Built(
            {
                name: done.results[node.label].outputs
                for name, node in targets.items()
                if node.label in done.results
            },
            frozenset((one.rule, one.subject, one.message) for one in findings),
            {label: node.step for label, node in done.graph.nodes.items()},
            done.whole,
        )


def _is_no_check(node: Node) -> bool:
    return not isinstance(node.step, Check)


# --- the keys --------------------------------------------------------------------------------


def schema_keys() -> list[str]:
    """Every key of the schema: `actuators[].kp`, `contact.links.*.condim`."""
    schema = json.loads(schema_text())
    return sorted(set(_below(schema, "", schema["$defs"], ())))


def _below(
    node: dict[str, Any], path: str, defs: dict[str, Any], models: tuple[str, ...]
) -> Iterator[str]:
    """The keys below a node of the schema; the model of a row may hold itself."""
    name = node.get("$ref", "").rpartition("/")[2]
    if name and name not in models:
        yield from _below(defs[name], path, defs, (*models, name))
    for form in (*node.get("anyOf", ()), *node.get("oneOf", ()), *node.get("allOf", ())):
        yield from _below(form, path, defs, models)
    for key, value in node.get("properties", {}).items():
        yield f"{path}.{key}".removeprefix(".")
        yield from _below(value, f"{path}.{key}".removeprefix("."), defs, models)
    entries = [node.get("additionalProperties"), *node.get("patternProperties", {}).values()]
    for value in filter(lambda entry: isinstance(entry, dict), entries):
        yield f"{path}.*"
        yield from _below(value, f"{path}.*", defs, models)
    if isinstance(node.get("items"), dict):
        yield from _below(node["items"], f"{path}[]", defs, models)


Path_ = tuple[str | int, ...]


def places(node: object, path: Path_ = ()) -> Iterator[tuple[Path_, object]]:
    """Where a recipe states a value, and the value; a list of plain values is one."""
    if isinstance(node, dict):
        for key, value in node.items():
            yield from places(value, (*path, key))
    elif isinstance(node, list) and node and isinstance(node[0], dict):
        for number, value in enumerate(node):
            yield from places(value, (*path, number))
    else:
        yield path, node


def key_of(path: Path_, keys: set[str]) -> str:
    """The schema's key of a place in a recipe."""
    ways = [""]
    for part in path:
        if isinstance(part, int):
            ways = [f"{way}[]" for way in ways]
        else:
            ways = [f"{way}.{step}".removeprefix(".") for way in ways for step in (part, "*")]
    return next((way for way in ways if way in keys), ".".join(map(str, path)))


def stated() -> dict[str, list[tuple[str, Path_]]]:
    """Key -> where the robots state it."""
    keys, found = set(schema_keys()), dict[str, list[tuple[str, Path_]]]()
    for robot in ROBOTS:
        for path, _ in places(yaml.safe_load((HERE / f"{robot}.yaml").read_text())):
            found.setdefault(key_of(path, keys), []).append((robot, path))
    return {key: where for key, where in found.items() if not is_elsewhere(key)}


def is_elsewhere(key: str) -> bool:
    return any(key == name or key.startswith((f"{name}.", f"{name}[")) for name in ELSEWHERE)


def test_every_key_of_the_schema_is_changed_or_said_to_be_tested_elsewhere():
    changed = stated()
    missing = [
        key
        for key in schema_keys()
        if not is_elsewhere(key)
        and not any(one == key or one.startswith((f"{key}.", f"{key}[")) for one in changed)
    ]
    assert missing == []


# --- each of them changed --------------------------------------------------------------------


@pytest.mark.slow
def test_another_value_of_any_key_changes_something(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("ASSETBUILD_CACHE", str(tmp_path / "store"))
    lump = trimesh.creation.icosphere(subdivisions=3, radius=0.05)
    lump.vertices[:, 0] += np.abs(lump.vertices[:, 1])  # not convex
    lump.export(tmp_path / "lump.stl")
    for file in (HERE.parents[1] / "robots/four_legs.urdf", *HERE.glob("*.[yu]*")):
        shutil.copy(file, tmp_path)
    before = {name: built(tmp_path / f"{name}.yaml", may_run=_is_no_check) for name in ROBOTS}
    dead = [
        key
        for key, where in stated().items()
        if not any(_effect(robot, path, tmp_path, before[robot]) for robot, path in where)
    ]
    assert dead == [], "these keys change nothing"


def _effect(robot: str, path: Path_, folder: Path, before: Built) -> bool:
    recipe = yaml.safe_load((folder / f"{robot}.yaml").read_text())
    name = ".".join(map(str, path))
    place = recipe
    for part in path[:-1]:
        place = place[part]
    place[path[-1]] = OTHER[name] if name in OTHER else other(place[path[-1]])
    changed = folder / "changed.yaml"
    changed.write_text(yaml.safe_dump(recipe, sort_keys=False))
    if path[0] in PLANNED or path[-1] in IN_THE_CARD:
        return built(changed, may_run=lambda _: False).plans_other_work(before)
    after = built(changed, may_run=_is_no_check)
    return (before.written, before.said) != (after.written, after.said)


def other(value: object) -> object:
    """A value that is not the same."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, int | float):
        return value * 0.9 if isinstance(value, float) else value + 1
    if isinstance(value, list):
        return [0.95 * part + 0.001 * (number == 0) for number, part in enumerate(value)]
    return f"{value} more"
