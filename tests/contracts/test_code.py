"""Keys cover the code: what a step's run loads or opens is in its key, or among its files."""

from __future__ import annotations

import ast
import json
import subprocess
import sys
import sysconfig
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import grimp
import pytest

from assetbuild.cli.identify import plan_excite
from assetbuild.cli.sample import plan_samples
from assetbuild.engine.actions import Action, Made
from assetbuild.engine.code import Code, StepCode
from assetbuild.engine.libraries import Libraries
from assetbuild.engine.planner import settle
from assetbuild.engine.processes import Processes, stage
from assetbuild.engine.session import Session
from assetbuild.engine.stamps import Stamps
from assetbuild.engine.step import Step
from assetbuild.engine.store import Store
from assetbuild.engine.wire import step_to_json
from assetbuild.pipeline.opening import Opened
from assetbuild.pipeline.recipes import load_recipe
from assetbuild.plan import plan

from .code_robots import write_robots
from .conftest import PACKAGE, step_classes

PROBE = """\
import json, os, sys
job = json.loads(sys.argv[1])
sys.path[:] = job["sys_path"]
from pathlib import Path
from assetbuild.engine.step import Files, Step
from assetbuild.engine.wire import perform, step_from_json
Step.model_rebuild()  # pydantic builds late, and loads then what the engine needs
for file in job["runs"]:
    if pid := os.fork():
        os.waitpid(pid, 0)
        continue
    run = json.loads(Path(file).read_bytes())
    before, opened, programs = set(sys.modules), [], []
    def note(event, words):
        if event in ("open", "os.listdir", "os.scandir") and isinstance(words[0], str | bytes):
            opened.append(os.path.abspath(os.fsdecode(words[0])))
        elif event == "subprocess.Popen":
            programs.append([os.fsdecode(word) for word in words[1]])
    sys.addaudithook(note)
    os.environ["TMPDIR"] = run["home"]
    os.chdir(run["home"])
    step = step_from_json(run["step"])
    files = Files(Path(run["inputs"]), Path(run["outputs"]))
    result, log = perform(lambda: step, files, run["label"], step.limits)
    seen = {"modules": sorted(set(sys.modules) - before), "opened": opened, "programs": programs}
    Path(file).with_name("seen.json").write_text(json.dumps({**seen, "log": log}))
    os._exit(0)
"""
"""Runs each step in a process of its own, which has loaded nothing but the engine before."""
ELSEWHERE = {
    "assetbuild.checks.policy": "only where a recipe names a policy: see its own tests",
    "assetbuild.checks._newton": "needs the trainer",
    "assetbuild.checks._physx": "needs PhysX",
    "assetbuild.checks.smoke_isaaclab": "needs the trainer",
    "assetbuild.checks.smoke_mjlab": "needs the trainer",
    "assetbuild.checks._foreign": "needs the extra `lint`, or the validator",
    "assetbuild.source.get.fetch": "needs the network",
}
"""Steps that these builds do not run; no library or program of theirs is on every machine."""

BYTECODE = filter(None, [sys.pycache_prefix])
FREE = (
    *("/usr", "/etc", "/proc", "/dev"),
    *(sys.prefix, sys.base_prefix, sysconfig.get_path("purelib"), *BYTECODE),
)
"""What any program opens, besides the package's own code."""
ASIDE = {
    "charset-normalizer": "`numpy.f2py`, which scipy loads, guesses encodings of Fortran with it",
    "cffi": "`glfw` prefers it to `ctypes` where it is installed; no step opens a window",
    "pycparser": "needed by `cffi`",
}
"""Libraries that others load where they are installed, and that write no byte of ours."""


@dataclass(frozen=True)
class Seen:
    """What one run did. modules: loaded; opened: paths; programs: started, as words.

    place: the folder of its inputs and outputs.
    """

    step: type[Step]
    place: Path
    modules: tuple[str, ...]
    opened: tuple[str, ...]
    programs: tuple[tuple[str, ...], ...]


class Recording(Processes):
    """Runs steps, and notes the first of each class that is not known yet."""

    def __init__(self, session: Session, known: set[type[Step]]) -> None:
        super().__init__(session)
        self.known = known
        self.first: dict[type[Step], Action] = {}

    def run(self, action: Action) -> Made:
        if type(action.step) not in self.known:
            self.first.setdefault(type(action.step), action)
        return super().run(action)


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[Seen]:
    """One run of each class of step that three small robots need."""
    folder = tmp_path_factory.mktemp("robots")
    steps: list[tuple[type[Step], Path]] = []
    for recipe in write_robots(folder):
        loaded = load_recipe(recipe)
        known = {kind for kind, _ in steps}
        with Session(Store(folder / recipe.stem)) as session, Recording(session, known) as runner:
            done = settle(lambda planner: plan(loaded, None, planner), session, runner)  # noqa: B023
            assert not done.errors
            work = Opened(loaded, None, session, runner)
            if loaded.recipe.randomize:
                work.made(partial(plan_samples, work, 1, 5, 1))
            if loaded.recipe.identify:
                work.made(partial(plan_excite, work, 10.0))
            for number, (kind, action) in enumerate(runner.first.items()):
                place = folder / f"{recipe.stem}-{number}"
                steps.append((kind, laid_out(action, session, place)))
    job = {
        "sys_path": [str(Path(p).resolve()) for p in sys.path if p],
        "runs": [str(f) for _, f in steps],
    }
    subprocess.run([sys.executable, "-P", "-c", PROBE, json.dumps(job)], check=True, timeout=900)
    return [seen(kind, file) for kind, file in steps]


def laid_out(action: Action, session: Session, place: Path) -> Path:
    for name in ("outputs", "home"):
        (place / name).mkdir(parents=True)
    stage(session, action.inputs, place / "inputs", alone=True)
    folders = {name: str(place / name) for name in ("inputs", "outputs", "home")}
    run = {"label": action.label, "step": step_to_json(action.step), **folders}
    (place / "run.json").write_text(json.dumps(run))
    return place / "run.json"


def seen(kind: type[Step], file: Path) -> Seen:
    raw = json.loads(file.with_name("seen.json").read_bytes())
    assert not raw["log"], f"{kind.__module__}: {raw['log']}"
    programs = tuple(tuple(words) for words in raw["programs"])
    return Seen(kind, file.parent, tuple(raw["modules"]), tuple(raw["opened"]), programs)


def is_ours(name: str) -> bool:
    return name == "assetbuild" or name.startswith("assetbuild.")


def not_covered(run: Seen, code: StepCode, libraries: Libraries) -> Iterator[str]:
    """What a run used that its key does not hold."""
    names, paths = {name for name, _ in code.files}, {path for _, path in code.files}
    started = [name for words in run.programs for name in names_of(words)]
    for name in (*run.modules, *started):
        if is_ours(name):
            if name not in names and not name.startswith("assetbuild.engine"):
                yield f"module {name}"
        else:
            for owner in libraries.owners(name.partition(".")[0]):
                if owner not in (*code.libraries, *ASIDE):
                    yield f"library {owner}"
    for words in run.programs:
        run_files = [word for word in words if word.endswith(".py")]
        yield from (f"program {path}" for path in run_files if path not in paths)
    for path in run.opened:
        is_data = PACKAGE in Path(path).parents and Path(path).suffix not in ("", ".py", ".pyc")
        is_own = path.startswith((str(run.place), str(PACKAGE), *FREE))
        if path not in paths and (is_data or not is_own):
            yield f"file {path}"


def names_of(words: tuple[str, ...]) -> Iterator[str]:
    """Modules that the words of a Python program load."""
    if "-m" in words:
        yield words[words.index("-m") + 1]
    if "-c" in words:
        for node in ast.walk(ast.parse(words[words.index("-c") + 1])):
            if isinstance(node, ast.Import):
                yield from (alias.name for alias in node.names)
            elif isinstance(node, ast.ImportFrom):
                yield node.module or ""
                yield from (f"{node.module}.{alias.name}" for alias in node.names)


@pytest.mark.slow
def test_what_a_run_loads_opens_or_starts_is_in_its_key(runs: list[Seen], code: Code):
    libraries = Libraries(Stamps())
    wrong = {
        (run.step.__module__, what)
        for run in runs
        for what in not_covered(run, code.of(run.step), libraries)
    }
    assert not wrong, "\n".join(f"{step} uses {what}" for step, what in sorted(wrong))


def test_a_file_that_is_no_input_of_a_step_is_named(code: Code):
    step = step_classes()[0]
    run = Seen(step, Path("/step"), (), ("/step/inputs/a", "/home/me/secret"), ())
    found = list(not_covered(run, code.of(step), Libraries(Stamps())))
    assert found == ["file /home/me/secret"]


@pytest.mark.slow
def test_these_runs_are_of_every_step(runs: list[Seen]):
    ran = {run.step.__module__ for run in runs}
    assert {step.__module__ for step in step_classes()} - ran == ELSEWHERE.keys()


COMPUTED_WITH = {
    "assetbuild.engine.digest": "downloads are compared with the lock by their digests",
    "assetbuild.engine.confine": "what a xacro and a trainer's module may do and open",
}
"""Modules of the engine that steps compute with; another would run most steps when it changes."""


ASKING = ("smoke_", "_newton", "_foreign")
"""Checks that ask a program in an environment of its own: they look for that environment."""


def test_steps_compute_with_these_modules_of_the_engine_and_no_others(code: Code):
    found = {
        name
        for step in step_classes()
        if not step.__module__.removeprefix("assetbuild.checks.").startswith(ASKING)
        for name in code.of(step).modules
        if name.startswith("assetbuild.engine")
    }
    assert found == COMPUTED_WITH.keys()


def test_the_closures_are_those_of_another_reader_of_imports(code: Code):
    imports = grimp.build_graph("assetbuild", exclude_type_checking_imports=True, cache_dir=None)
    for step in step_classes():
        upstream = imports.find_upstream_modules(step.__module__)
        expected = {name for name in upstream if not name.startswith("assetbuild.engine")}
        missed = expected - {name for name, _ in code.of(step).files}
        assert not missed, (step.__module__, missed)
