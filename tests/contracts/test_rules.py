"""Rules are declared where they are found, once, and the reference says what the code says."""

from __future__ import annotations

import ast
import functools
import gc
import re
import subprocess
import sys
from collections.abc import Iterator
from fnmatch import fnmatchcase
from pathlib import Path
from types import ModuleType

import pytest

from assetbuild.findings import NEW_IDS, SEVERITIES, Rule
from docs.site.pages.rules import Entry, entries_of, package_modules, rule_pages

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "assetbuild"
LEGS = "schema: assetbuild/v1\nrobot: r\nsource: {path: ., urdf: r.urdf}\ntargets: [urdf]\n"


Nodes = list[ast.AST]
"""The syntax nodes of one file; its module comes first."""


def nodes_of(path: Path) -> Nodes:
    return list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))


@functools.cache
def package() -> dict[str, Nodes]:
    """The syntax of the package's files, parsed only in the process that runs these tests."""
    gc.disable()  # it would take most of the time: syntax trees are many small objects
    parsed = {
        path.relative_to(PACKAGE).as_posix(): nodes_of(path)
        for path in sorted(PACKAGE.rglob("*.py"))
    }
    gc.freeze()
    gc.enable()
    return parsed


@pytest.fixture(scope="module")
def entries() -> tuple[Entry, ...]:
    return entries_of(package_modules())


def calls(nodes: Nodes, name: str) -> Iterator[ast.Call]:
    for node in nodes:
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") == name:
            yield node


def constants(nodes: Nodes) -> dict[str, ast.Call]:
    """Rules by the name of their constant, as the text of a module declares them."""
    return {
        node.targets[0].id: node.value
        for node in nodes[0].body
        if isinstance(node, ast.Assign)
        and isinstance(node.value, ast.Call)
        and getattr(node.value.func, "id", "") == "Rule"
        and isinstance(node.targets[0], ast.Name)
    }


def test_every_finding_is_made_by_a_rule():
    made = [
        f"{path}:{call.lineno}"
        for path, nodes in package().items()
        for call in calls(nodes, "Finding")
    ]
    assert [place for place in made if not place.startswith("findings.py:")] == []


def test_every_rule_is_a_constant_of_its_module():
    """Only so the reference finds it."""
    for path, nodes in package().items():
        assert len(list(calls(nodes, "Rule"))) == len(constants(nodes)), path


def test_the_reference_has_every_rule_of_the_code(entries):
    """Children that are programs of their own are not imported: they can declare none."""
    declared = {
        ast.literal_eval(call.args[0])
        for nodes in package().values()
        for call in constants(nodes).values()
    }
    assert {entry.rule.id for entry in entries} == declared


def test_every_rule_says_what_it_means_and_what_to_do(entries):
    for rule in (entry.rule for entry in entries):
        assert re.fullmatch(r"[a-z_]+(\.[a-z_]+)*\.([a-z_]+|\*)", rule.id)
        assert rule.meaning.strip() and rule.remedy.strip(), rule.id
        assert not rule.meaning.endswith(".") and not rule.remedy.endswith("."), rule.id
        assert set(rule.severities) <= set(SEVERITIES), rule.id
        assert len(set(rule.severities)) == len(rule.severities), rule.id


def test_old_names_lead_to_rules_that_there_are(entries):
    known = {entry.rule.id for entry in entries}
    for rule in (entry.rule for entry in entries):
        for old, patterns in rule.was.items():
            assert old not in known
            for pattern in (pattern.partition(" ")[0] for pattern in patterns):
                assert fnmatchcase(pattern, rule.id) or pattern in known, f"{old}: {pattern}"


def test_a_program_that_reads_a_recipe_knows_all_old_names(entries, tmp_path: Path):
    """A waiver is matched where the recipe was read, and no rule is imported only for that."""
    (tmp_path / "r.yaml").write_text(LEGS)
    program = (
        "import sys\nfrom assetbuild.findings import RENAMED\n"
        "from assetbuild.pipeline.recipes import load_recipe\n"
        "load_recipe(sys.argv[1])\nprint(*RENAMED, sep='\\n')"
    )
    command = [sys.executable, "-c", program, str(tmp_path / "r.yaml")]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    stated = {old for entry in entries for old in entry.rule.was}
    assert set(done.stdout.split()) == stated | NEW_IDS.keys()
    assert set(NEW_IDS.values()) <= {entry.rule.id for entry in entries}


def severities_stated(call: ast.Call) -> set[str]:
    """Literals of `severity=`, of both sides of a condition; what is computed is left out."""
    values = [keyword.value for keyword in call.keywords if keyword.arg == "severity"]
    for value in values:
        if isinstance(value, ast.IfExp):
            values += [value.body, value.orelse]
    return {value.value for value in values if isinstance(value, ast.Constant)}


def test_every_severity_that_a_call_states_is_declared_and_not_the_usual_one():
    for path, nodes in package().items():
        for name, declaration in constants(nodes).items():
            rule = Rule(*(ast.literal_eval(argument) for argument in declaration.args))
            for call in calls(nodes, name):
                assert severities_stated(call) <= set(rule.severities), f"{path}:{call.lineno}"
                assert severities_stated(call) != {rule.severities[0]}, f"{path}:{call.lineno}"


def test_every_rule_that_the_code_compares_with_exists(entries):
    known = {entry.rule.id for entry in entries}
    for path, nodes in package().items():
        for node in nodes:
            if isinstance(node, ast.Compare) and getattr(node.left, "attr", "") == "rule":
                named = {c.value for c in node.comparators if isinstance(c, ast.Constant)}
                for rule in named:
                    family = rule.rpartition(".")[0] + ".*"
                    assert rule in known or family in known, f"{path}:{node.lineno}: {rule}"


# --- rules of another package ---------------------------------------------------------------


def a_module(name: str, **rules: Rule) -> ModuleType:
    module = ModuleType(name, "One sentence.")
    vars(module).update(rules)
    return module


SLIP = Rule("grip.slip", ("info", "error"), "a finger slides | turns", "raise the friction")


def test_a_rule_of_another_package_gets_a_page_of_its_family():
    pages = rule_pages(entries_of([a_module("plug", SLIP=SLIP)]))
    row = r"| `grip.slip` | info, error | a finger slides \| turns | raise the friction |"
    assert row in pages["rules/grip.md"]
    assert "- `plug`: One sentence." in pages["rules/grip.md"]
    assert "[grip](rules/grip.md)" in pages["rules.md"]


def test_a_rule_is_declared_once_and_may_be_imported():
    own, other = a_module("a", SLIP=SLIP), a_module("b", SLIP=SLIP)
    (entry,) = entries_of([own, other])
    assert entry.modules == (own, other)
    again = Rule("grip.slip", "info", "the same", "again")
    with pytest.raises(ValueError, match=r"`grip\.slip` is declared in a and b"):
        entries_of([own, a_module("b", SLIP=again)])


TOOLS = {"mutations", "benchmarks", "corpus", "faults"}
"""Folders of programs beside the tests."""


def literals(nodes: Nodes) -> Iterator[str]:
    """Strings that code uses: no docstrings, and nothing of a finding that a test makes up."""
    idle = {id(node.value) for node in nodes if isinstance(node, ast.Expr)}
    idle |= {
        id(part) for name in ("Finding", "Rule") for c in calls(nodes, name) for part in c.args
    }
    for node in nodes:
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in idle:
            yield node.value


def test_every_rule_is_named_by_a_test(entries):
    """A new rule needs a robot on which it is reported; of `equal.mjcf.*` one name is enough."""
    words = set[str]()
    for path in (ROOT / "tests").rglob("*.py"):
        if path != Path(__file__) and not TOOLS & set(path.relative_to(ROOT).parts):
            for text in literals(nodes_of(path)):
                words.update(re.findall(r"[a-z_]+(?:\.[a-z_]*)+", text))
    unnamed = [
        rule
        for rule in (entry.rule.id for entry in entries)
        if rule not in words
        and not (rule.endswith("*") and any(word.startswith(rule[:-1]) for word in words))
    ]
    assert not unnamed, f"no test names {', '.join(unnamed)}"
