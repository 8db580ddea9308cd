"""The code of a step: what of a module counts, which modules it leads to, which libraries."""

from __future__ import annotations

import importlib
import itertools
import json
import sys
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

    def look(self, module: str = "weigh") -> StepCode:
        code_module._FIRST_SEEN.clear()
        step = importlib.import_module(f"{self.name}.{module}").Weigh
        return Code().of(step)

    def modules(self, module: str = "weigh") -> set[str]:
        return {name.removeprefix(f"{self.name}.") for name in self.look(module).modules}


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


@pytest.mark.parametrize(
    "text",
    [
        "# a comment\n" + PLAIN,
        '"""A docstring."""\n' + PLAIN,
        PLAIN.replace("2 * 3", "(2 *\n            3)  # kg"),
        PLAIN.replace("    outputs", '    """What it weighs."""\n\n    outputs'),
        PLAIN.replace("2 * 3", '2 * 3\n        """A string that nobody reads."""'),
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import json\n" + PLAIN,
    ],
)
def test_comments_docstrings_and_layout_do_not_count(package, text):
    with_import = "from typing import TYPE_CHECKING\n" if "TYPE_CHECKING" in text else ""
    assert digest_of(package, text) == digest_of(package, with_import + PLAIN)


@pytest.mark.parametrize(
    "text",
    [
        PLAIN.replace("2 * 3", "2 * 4"),
        PLAIN.replace("2 * 3", "2.0 * 3"),
        PLAIN.replace("2 * 3", "2 + 3"),
        PLAIN.replace("mass = 2", "mess = 2"),
        PLAIN.replace("yield from ()", "yield from []"),
        PLAIN.replace("self, files", "self, files=None"),
        PLAIN.replace("mass = 2 * 3", "mass = '2 * 3'"),
        PLAIN.replace("mass = 2 * 3", "mass = b'2 * 3'"),
        PLAIN.replace("def run", "async def run"),
        PLAIN + "UNIT = 'kg'\n",
    ],
)
def test_a_changed_statement_counts(package, text):
    assert digest_of(package, text) != digest_of(package, PLAIN)


def test_all_ways_to_import_count(package):
    package.write(
        "weigh.py",
        f"import {package.name}.plainly\n"
        f"from {package.name}.parts import member\n"
        f"from {package.name}.parts.values import G as g\n"
        "from . import sibling\nfrom .deep.below import value\n" + STEP.format(body="import json\n"
        f"        from {package.name} import lazily\n        from .late import thing"),
    )  # fmt: skip
    package.write("plainly.py", "A = 1")
    package.write("sibling.py", "from .after_sibling import B")
    package.write("after_sibling.py", "B = 1")
    package.write("lazily.py", "C = 1")
    package.write("late.py", "thing = 1")
    package.write("unused.py", "D = 1")
    package.write("parts/__init__.py", "E = 1")
    package.write("parts/member.py", "F = 1")
    package.write("parts/values.py", "G = 1")
    package.write("parts/other.py", "H = 1")
    package.write("deep/__init__.py", "")
    package.write("deep/below.py", "from .. import up\nvalue = 1")
    package.write("up.py", "I = 1")
    assert package.modules() == {
        "weigh", "plainly", "sibling", "after_sibling", "lazily", "late", "up",
        "parts", "parts.member", "parts.values", "deep.below",
    }  # fmt: skip


def test_what_only_types_need_does_not_count(package):
    text = (
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from . import typed\n"
        "else:\n    from . import real\n"
    )
    package.write("weigh.py", text + STEP.format(body="pass"))
    package.write("typed.py", "A = 1")
    package.write("real.py", "B = 1")
    assert package.modules() == {"weigh", "real"}


def test_a_package_runs_before_what_is_in_it(package):
    package.write("__init__.py", "START = 1")
    package.write("weigh.py", STEP.format(body="pass"))
    assert package.modules() == {package.name, "weigh"}


def test_a_step_leads_to_the_modules_of_assetbuild_that_it_imports(package):
    package.write("weigh.py", "from assetbuild.robot.inertia import combine\n" + PLAIN)
    found = package.look()
    assert {"assetbuild.robot.inertia", "assetbuild.robot.pose"} <= found.modules.keys()
    assert "numpy" in found.libraries
    assert not any(name.startswith("assetbuild.engine") for name in found.modules)


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


def test_a_requirement_may_ask_for_an_extra(package, tmp_path):
    package.write("weigh.py", STEP.format(body="import meshlib"))
    install(tmp_path, "meshlib", "1", "meshlib", requires=("yard[easy] >= 2",))
    install(tmp_path, "yard", "2", "yard", requires=('numpy; extra == "easy"', 'scipy; extra=="x"'))
    assert package.look().libraries.keys() == {"meshlib", "yard", "numpy"}


def test_a_module_that_no_distribution_installs_is_code(package, tmp_path):
    package.write("weigh.py", STEP.format(body="import somewhere"))
    (tmp_path / "somewhere.py").write_text("A = 1")
    assert "somewhere" in package.look().modules


def test_tools_of_a_plug_in_for_an_older_assetbuild_still_count(package):
    old = PLAIN.replace("    outputs", '    version = "2"\n    tools = ("scipy",)\n    outputs')
    package.write("weigh.py", old)
    assert "scipy" in package.look().libraries


def test_a_module_that_python_cannot_read_counts_by_its_bytes(package):
    package.write("weigh.py", STEP.format(body="from . import broken"))
    package.write("broken.py", "def (")
    assert "broken" in package.modules()


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
    package.write("weigh.py", PLAIN)
    step = importlib.import_module(f"{package.name}.weigh").Weigh
    first = one_process(tmp_path / "code", step)
    assert f"{package.name}.weigh" in reads
    reads.clear()
    assert one_process(tmp_path / "code", step) == first
    assert reads == []
    package.write("weigh.py", PLAIN.replace("2", "7"))
    assert one_process(tmp_path / "code", step) != first
    assert reads == [f"{package.name}.weigh"]


def test_a_file_that_was_written_just_now_is_read_again(package, tmp_path, reads):
    package.write("weigh.py", PLAIN)
    step = importlib.import_module(f"{package.name}.weigh").Weigh
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
        lambda text: json.dumps({**json.loads(text), "notes": {"stamp": "", "read": {}}}),
        lambda text: json.dumps({**json.loads(text), "notes": []}),
    ],
)
def test_a_spoilt_cache_counts_as_empty(package, tmp_path, never_racy, spoil: Callable[[str], str]):
    package.write("weigh.py", PLAIN)
    step = importlib.import_module(f"{package.name}.weigh").Weigh
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
    package.write("weigh.py", PLAIN)
    package.look()
    step = sys.modules[f"{package.name}.weigh"].Weigh
    code = Code()
    code.check(step)
    package.write("weigh.py", "# only a comment\n" + PLAIN)
    code.check(step)
    package.write("weigh.py", PLAIN.replace("2", "7"))
    with pytest.raises(MachineError, match=r"weigh.py` was changed while a step ran"):
        code.check(step)
    assert Code().of(step) == code.of(step)  # this process has loaded the old code


def test_an_upgrade_while_a_step_runs_is_found(package, tmp_path):
    package.write("weigh.py", STEP.format(body="import meshlib"))
    install(tmp_path, "meshlib", "1", "meshlib")
    package.look()
    step = sys.modules[f"{package.name}.weigh"].Weigh
    code = Code()
    code.check(step)
    (tmp_path / "meshlib-1.dist-info").rename(tmp_path / "meshlib-2.dist-info")
    with pytest.raises(MachineError, match=r"the library `meshlib` was changed while a step ran"):
        code.check(step)


def test_requirements_may_go_in_a_circle(package, tmp_path):
    package.write("weigh.py", STEP.format(body="import egg"))
    install(tmp_path, "egg", "1", "egg", requires=("hen[all]",))
    install(tmp_path, "hen", "1", "hen", requires=("hen[all]; extra == 'all'", "egg"))
    assert package.look().libraries == {"egg": "1", "hen": "1"}


def test_threads_that_ask_at_once_have_one_answer(package):
    package.write("weigh.py", "import numpy\n" + PLAIN)
    package.look()
    step = sys.modules[f"{package.name}.weigh"].Weigh
    for _ in range(20):
        libraries_module._READ.clear()
        code = Code()
        with ThreadPoolExecutor(8) as pool:
            found = list(pool.map(lambda _: code.of(step), range(8)))  # noqa: B023
        assert all("numpy" in each.libraries for each in found)


def test_a_step_without_a_file_is_refused():
    step = type("Homeless", (Step,), {"__module__": "nowhere.at_all"})
    with pytest.raises(MachineError, match=r"source of `nowhere.at_all`.* cannot be found"):
        Code().of(step)
