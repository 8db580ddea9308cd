"""The code of a step: what of a module counts, which modules it leads to, which libraries."""

from __future__ import annotations

import importlib
import itertools
import json
import sys
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from assetbuild.engine import code as code_module
from assetbuild.engine import libraries as libraries_module
from assetbuild.engine import stamps
from assetbuild.engine.code import Code, StepCode, notes_folder
from assetbuild.engine.step import Step
from assetbuild.errors import MachineError

STEP = """\
from assetbuild.engine.step import Step

class Weigh(Step):
    outputs = ("mass",)
    def run(self, files):
        {body}
        yield from ()
"""
NUMBERS = itertools.count()


class Package:
    """A package of a step, edited between two looks at it. Each look is that of a new process."""

    def __init__(self, folder: Path) -> None:
        self.name = f"plant{next(NUMBERS)}"
        self.folder = folder / self.name
        self.folder.mkdir()
        self.write("__init__.py", "")

    def write(self, name: str, text: str) -> None:
        path = self.folder / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)

    def look(self) -> StepCode:
        code_module._FIRST_SEEN.clear()
        return Code().of(importlib.import_module(f"{self.name}.weigh").Weigh)

    def modules(self) -> set[str]:
        return {name.removeprefix(f"{self.name}.") for name in self.look().modules}

    def step(self, text: str) -> type[Step]:
        self.write("weigh.py", text)
        return importlib.import_module(f"{self.name}.weigh").Weigh


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Package:
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(code_module, "_FIRST_SEEN", {})
    return Package(tmp_path)


def digest_of(package: Package, text: str) -> str:
    package.write("weigh.py", STEP.format(body="pass"))
    package.look()
    package.write("weigh.py", text)
    return package.look().modules[f"{package.name}.weigh"]


PLAIN = STEP.format(body="mass = 2 * 3")
TYPED = "from typing import TYPE_CHECKING\n" + PLAIN


@pytest.mark.parametrize(
    ("before", "after", "counts"),
    [
        (PLAIN, "# a comment\n" + PLAIN, False),
        (PLAIN, '"""A docstring."""\n' + PLAIN, False),
        (PLAIN, PLAIN.replace("2 * 3", "(2 *\n            3)  # kg"), False),
        (PLAIN, PLAIN.replace("    outputs", '    """What it weighs."""\n\n    outputs'), False),
        (PLAIN, PLAIN.replace("2 * 3", '2 * 3\n        """A string nobody reads."""'), False),
        (
            TYPED,
            TYPED.replace("CHECKING\n", "CHECKING\nif TYPE_CHECKING:\n    import json\n"),
            False,
        ),
        (PLAIN, PLAIN.replace("2 * 3", "2 * 4"), True),
        (PLAIN, PLAIN.replace("2 * 3", "2.0 * 3"), True),
        (PLAIN, PLAIN.replace("2 * 3", "2 + 3"), True),
        (PLAIN, PLAIN.replace("mass = 2", "mess = 2"), True),
        (PLAIN, PLAIN.replace("self, files", "self, files=None"), True),
        (PLAIN, PLAIN.replace("mass = 2 * 3", "mass = '2 * 3'"), True),
        (PLAIN.replace("2 * 3", "'2'"), PLAIN.replace("2 * 3", "b'2'"), True),
        (PLAIN, PLAIN.replace("def run", "async def run"), True),
        (PLAIN, PLAIN + "UNIT = 'kg'\n", True),
    ],
)
def test_statements_count_and_comments_docstrings_and_layout_do_not(package, before, after, counts):
    assert (digest_of(package, before) != digest_of(package, after)) == counts


IMPORTS: dict[str, tuple[dict[str, str], set[str]]] = {
    "a module by its whole name": ({"weigh.py": "import {name}.other"}, {"other"}),
    "a member of a package": ({"weigh.py": "from {name}.parts import other"}, {"parts.other"}),
    "a name in a module": ({"weigh.py": "from {name}.other import A as a"}, {"other"}),
    "a sibling, and what it imports": (
        {"weigh.py": "from . import other", "other.py": "from .further import A"},
        {"other", "further"},
    ),
    "what lies above": ({"weigh.py": "from .deep.below import A"}, {"deep.below", "other"}),
    "in a function": ({"weigh.py": "def late():\n    from .other import A"}, {"other"}),
    "no types": (
        {
            "weigh.py": "from typing import TYPE_CHECKING\n"
            "if TYPE_CHECKING:\n    from . import further\nelse:\n    from . import other"
        },
        {"other"},
    ),
    "the package that holds it": ({"__init__.py": "START = 1", "weigh.py": ""}, {"{name}"}),
    "what no distribution installs": ({"weigh.py": "import somewhere"}, {"somewhere"}),
    "what Python cannot read": (
        {"weigh.py": "def late():\n    from . import other", "other.py": "def ("}, {"other"}
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", IMPORTS)
def test_every_way_to_import_leads_to_a_module(package, tmp_path, case):
    files, expected = IMPORTS[case]
    there = dict.fromkeys(("other.py", "further.py", "unused.py", "parts/other.py"), "A = 1")
    there |= {"parts/__init__.py": "", "deep/__init__.py": ""}
    there["deep/below.py"] = "from .. import other\nA = 1"
    (tmp_path / "somewhere.py").write_text("A = 1")
    for name, text in (there | files).items():
        package.write(name, text.replace("{name}", package.name))
    own = (package.folder / "weigh.py").read_text()
    package.write("weigh.py", f"{own}\n{PLAIN}")
    assert package.modules() == {
        "weigh",
        *(each.replace("{name}", package.name) for each in expected),
    }


def test_the_release_is_no_code_unless_it_is_imported(package):
    package.write("weigh.py", PLAIN)
    package.write("__init__.py", '__version__ = "1"\n')
    first = package.look()
    package.write("__init__.py", '__version__ = "2"\n')
    assert package.look().modules == first.modules
    package.write("weigh.py", f"from {package.name} import __version__\n" + PLAIN)
    second = package.look()
    package.write("__init__.py", '__version__ = "3"\n')
    third = package.look().modules
    changed = {n for n in third if third[n] != second.modules.get(n)}
    assert changed == {f"{package.name}/__init__.py"}


def test_a_module_states_the_programs_files_and_libraries_that_imports_do_not_show(package):
    stated = f'BEYOND_IMPORTS = ("{package.name}.child", "./page.css", "scipy")\n'
    package.write("weigh.py", stated + PLAIN)
    package.write("child.py", "from . import grandchild")
    package.write("grandchild.py", "A = 1")
    package.write("page.css", "a {}")
    found = package.look()
    assert package.modules() == {"weigh", "child", "grandchild", f"{package.name}/page.css"}
    assert {"scipy", "numpy"} <= found.libraries.keys()
    package.write("page.css", "b {}")
    now = package.look().modules
    assert {n for n in now if now[n] != found.modules[n]} == {f"{package.name}/page.css"}


@pytest.mark.parametrize(
    ("stated", "message"),
    [
        ('("./page.css",)', "which is not there"),
        ('("{name}.child",)', "which is not there"),
        ("[str(1)]", "is not a tuple of strings"),
        ('("json")', "is not a tuple of strings"),
    ],
)
def test_a_wrong_statement_is_refused(package, stated, message):
    package.write("weigh.py", f"BEYOND_IMPORTS = {stated.format(name=package.name)}\n" + PLAIN)
    with pytest.raises(MachineError, match=message):
        package.look()


def test_a_library_that_is_not_installed_counts_once_it_is(package, tmp_path):
    package.write("weigh.py", STEP.format(body="import meshlib"))
    assert package.look().libraries == {}
    install(tmp_path, "mesh-lib", "1.5", "meshlib", requires=("numpy", "tester; extra == 'test'"))
    install(tmp_path, "tester", "3", "tester")
    found = package.look()
    assert found.libraries.keys() == {"mesh-lib", "numpy"}
    assert found.libraries["mesh-lib"] == "1.5"
    assert package.modules() == {"weigh"}


@pytest.mark.parametrize(
    ("requires", "of_yard", "expected"),
    [
        (("yard[easy] >= 2",), ('numpy; extra == "easy"', 'scipy; extra=="x"'), {"numpy"}),
        (("yard[all]",), ("yard[all]; extra == 'all'", "meshlib"), set()),
    ],
    ids=["an extra", "a circle"],
)
def test_requirements_of_a_library_are_followed(package, tmp_path, requires, of_yard, expected):
    package.write("weigh.py", STEP.format(body="import meshlib"))
    install(tmp_path, "meshlib", "1", "meshlib", requires=requires)
    install(tmp_path, "yard", "2", "yard", requires=of_yard)
    assert package.look().libraries.keys() == {"meshlib", "yard"} | expected


def test_tools_of_a_plug_in_for_an_older_assetbuild_still_count(package):
    old = PLAIN.replace("    outputs", '    version = "2"\n    tools = ("scipy",)\n    outputs')
    package.write("weigh.py", old)
    assert "scipy" in package.look().libraries


def install(
    site: Path, name: str, version: str, module: str, requires: tuple[str, ...] = ()
) -> None:
    info = site / f"{name.replace('-', '_')}-{version}.dist-info"
    info.mkdir()
    lines = "".join(f"Requires-Dist: {each}\n" for each in requires)
    text = f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n{lines}"
    (info / "METADATA").write_text(text)
    (info / "RECORD").write_text(f"{module}/__init__.py,,\n{info.name}/METADATA,,\n")
    (site / module).mkdir()
    (site / module / "__init__.py").write_text("")


# -- the cache


@pytest.fixture
def reads(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the modules that were read and parsed."""
    found: list[str] = []
    read = code_module._read

    def noted(name: str, path: str) -> list[str]:
        found.append(name)
        return read(name, path)

    monkeypatch.setattr(code_module, "_read", noted)
    return found


def one_process(folder: Path, step: type[Step]) -> Mapping[str, str]:
    code_module._FIRST_SEEN.clear()
    code = Code(folder)
    found = code.of(step).modules
    code.save()
    return found


@pytest.fixture
def never_racy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stamps, "is_racy", lambda *_: False)


def test_the_next_process_reads_nothing_again(package, tmp_path, reads, never_racy):
    step = package.step(PLAIN)
    first = one_process(tmp_path / "code", step)
    assert f"{package.name}.weigh" in reads
    reads.clear()
    assert one_process(tmp_path / "code", step) == first
    assert reads == []
    package.write("weigh.py", PLAIN.replace("2", "7"))
    assert one_process(tmp_path / "code", step) != first
    assert reads == [f"{package.name}.weigh"]


def test_a_file_that_was_written_just_now_is_read_again(package, tmp_path, reads):
    step = package.step(PLAIN)
    one_process(tmp_path / "code", step)
    reads.clear()
    one_process(tmp_path / "code", step)
    assert f"{package.name}.weigh" in reads


@pytest.mark.parametrize(
    "spoil",
    [
        lambda text: text[: len(text) // 2],
        lambda _: "[]",
        lambda _: "",
        lambda text: json.dumps({**json.loads(text), "files": {"/a": [1]}}),
        lambda text: json.dumps({**json.loads(text), "format": 0}),
    ],
)
def test_a_spoilt_cache_counts_as_empty(package, tmp_path, never_racy, spoil: Callable[[str], str]):
    step = package.step(PLAIN)
    first = one_process(tmp_path / "code", step)
    (file,) = (tmp_path / "code").iterdir()
    file.write_text(spoil(file.read_text()))
    assert one_process(tmp_path / "code", step) == first


def test_what_was_found_lies_beside_the_package(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    package = tmp_path / "assetbuild"
    monkeypatch.setattr(code_module, "__file__", str(package / "engine/code.py"))
    assert notes_folder(tmp_path) == tmp_path / "code"  # Python keeps no bytecode there
    (package / "__pycache__").mkdir(parents=True)
    assert notes_folder(tmp_path) == package / "__pycache__/syntax"
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    assert notes_folder(tmp_path) == tmp_path / "code"


# -- edits while it runs


def test_an_edit_while_a_step_runs_is_found(package):
    step = package.step(PLAIN)
    code = Code()
    code.check(step)
    package.write("weigh.py", "# only a comment\n" + PLAIN)
    code.check(step)
    package.write("weigh.py", PLAIN.replace("2", "7"))
    with pytest.raises(MachineError, match=r"weigh.py` was changed while a step ran"):
        code.check(step)
    assert Code().of(step) == code.of(step)  # this process has loaded the old code


def test_threads_that_look_at_an_edited_file_parse_it_one_after_another(package, monkeypatch):
    step = package.step(PLAIN)
    code = Code()
    code.check(step)
    package.write("weigh.py", "# only a comment\n" + PLAIN)
    parse, inside, most = code_module.ast.parse, [], []

    def slowly(*given: object) -> object:
        inside.append(given)
        most.append(len(inside))
        time.sleep(0.02)
        inside.pop()
        return parse(*given)

    monkeypatch.setattr(code_module.ast, "parse", slowly)
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda _: code.check(step), range(4)))
    assert most == [1, 1, 1, 1]


def test_an_upgrade_while_a_step_runs_is_found(package, tmp_path):
    step = package.step(STEP.format(body="import meshlib"))
    install(tmp_path, "meshlib", "1", "meshlib")
    code = Code()
    code.check(step)
    (tmp_path / "meshlib-1.dist-info").rename(tmp_path / "meshlib-2.dist-info")
    with pytest.raises(MachineError, match=r"the library `meshlib` was changed while a step ran"):
        code.check(step)


def test_threads_that_ask_at_once_have_one_answer(package):
    step = package.step("import numpy\n" + PLAIN)
    for _ in range(3):
        libraries_module._metadata_text.cache_clear()
        code = Code()
        with ThreadPoolExecutor(8) as pool:
            found = list(pool.map(lambda _: code.of(step), range(8)))  # noqa: B023
        assert all("numpy" in each.libraries for each in found)


def test_a_step_without_a_file_is_refused():
    step = type("Homeless", (Step,), {"__module__": "nowhere.at_all"})
    with pytest.raises(MachineError, match=r"source of `nowhere.at_all`.* cannot be found"):
        Code().of(step)
