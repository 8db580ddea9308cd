"""validate(): checks on files that we did not build, or did: MJCF, URDF, USD, a whole bundle."""

from __future__ import annotations

import json
import math
import tempfile
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from assetbuild.body.inertia_rules import MASS, mass_findings
from assetbuild.body.lint import LintBodies, LintLinks, crossed_limits
from assetbuild.engine.actions import SharedCache
from assetbuild.engine.digest import digest_file
from assetbuild.engine.execute import Listener
from assetbuild.engine.scratch import scratch
from assetbuild.engine.world import World
from assetbuild.errors import AssetBuildError, SourceError, StepError, UsageError
from assetbuild.facts.reference import Reference, robot_named
from assetbuild.facts.table import Table
from assetbuild.findings import Finding, Rule, worst_first
from assetbuild.grouping import grouped
from assetbuild.pipeline.again import ROBOT, prove_again
from assetbuild.pipeline.judging import evaluate
from assetbuild.pipeline.opening import Opened, open_session
from assetbuild.pipeline.recipes import collision_rule, load_recipe
from assetbuild.plan import plan
from assetbuild.plugin_types import lacking
from assetbuild.recipe.models import CollisionRule
from assetbuild.report.bundle import manifest_of
from assetbuild.report.document import Report
from assetbuild.report.sides import bundle_readers
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.inertia import InertiaBounds
from assetbuild.robot.mirror import Tolerances, mirror_findings
from assetbuild.robot.model import Control, Inertial, Joint, JointKind, Limits
from assetbuild.robot.pose import Pose, Vec3
from assetbuild.robot.twins import twins
from assetbuild.simulators import physx
from assetbuild.simulators.experiments import Experiment, Outcome, Setting
from assetbuild.simulators.free_fall import fall_of
from assetbuild.simulators.stages import perform_on_stages

KINDS = {
    ".xml": "mjcf",
    ".mjcf": "mjcf",
    ".urdf": "urdf",
    ".usd": "usd",
    ".usda": "usd",
    ".usdc": "usd",
}
LARGEST_MB = 64

LOST = Rule(
    "equal.lost",
    "error",
    "a file of the bundle is missing, or was edited where nothing installed reads it",
    "build the bundle again, with the package of its plug-in installed",
)
UNREADABLE = Rule("urdf.unreadable", "error", "`validate` cannot read the file", "read the message")


@dataclass(frozen=True)
class Validated:
    """One file and what there is to say about it, worst first."""

    file: str
    kind: str
    findings: tuple[Finding, ...]


@dataclass(frozen=True)
class Wish:
    """How to look at a file. simulate: not only read it.

    propose: writes a recipe for the first path, a robot's description, to the second.
    remote: the cache that its trial build shares with other machines.
    """

    simulate: bool
    propose: Callable[[Path, Path], None]
    on_event: Listener
    remote: SharedCache | None = None


def validate(path: Path, wish: Wish) -> list[Validated]:
    """Every file that can be checked: the one, or those of a bundle. Raises AssetBuildError.

    A URDF or USD of a bundle is only read: its build has simulated the robot, with more than is
    known here.
    """
    if path.is_dir():
        return _of_bundle(path, replace(wish, simulate=False))
    if not path.is_file():
        raise UsageError(f"no such file or folder: `{path}`")
    return [_validated(path, str(path), wish)]


def _of_bundle(bundle: Path, wish: Wish) -> list[Validated]:
    files = _files(bundle)
    if (bundle / ROBOT).exists():
        proved = _proved(bundle)
    else:
        proved = _lost(bundle) if (bundle / "manifest.json").exists() else {}
    results = []
    for name in (file.relative_to(bundle).as_posix() for file in files):
        one, proof = _validated(bundle / name, name, wish), proved.pop(name, None)
        # What else there is to say of the robot, its build has said.
        wrong = tuple(each for each in one.findings if each.severity == "error" or not proof)
        results.append(replace(one, findings=(*proof.findings, *wrong) if proof else wrong))
    return [*results, *proved.values()]


def _proved(bundle: Path) -> dict[str, Validated]:
    """Every file of a bundle that says what the robot is, compared with the bundle's robot."""
    reference = Reference.of_bundle(bundle)
    robot = str(reference.options.get("robot") or robot_named(bundle, bundle.name))
    files = {ROBOT: Validated(ROBOT, "robot", ())}
    for form, reader, file in bundle_readers(bundle, robot, reference):
        name = file.relative_to(bundle).as_posix()
        proof = reader.prove(reference, file)
        placed = (finding if finding.where else finding.at(name) for finding in proof.findings)
        files[name] = Validated(name, form, tuple(placed))
    proven = prove_again(bundle, robot, reference)
    again = grouped(proven, lambda finding: finding.where.partition(":")[0])
    for name, findings in again.items():
        one, rules = files.get(name, Validated(name, "file", ())), {each.rule for each in findings}
        read = (finding for finding in one.findings if finding.rule not in rules)  # without a line
        files[name] = replace(one, findings=(*read, *findings))
    unproven = {f.subject.removeprefix("target ") for f in again.get(ROBOT, ())}
    unread = unproven - {name.partition("/")[0] for name in files}
    return files | _lost(bundle, unread)


def _lost(bundle: Path, unread: Collection[str] = ()) -> dict[str, Validated]:
    findings = lost_files(bundle, unread)
    return {one.where: Validated(one.where, "file", (one,)) for one in findings}


def lost_files(bundle: Path, unread: Collection[str] = ()) -> Iterator[Finding]:
    """One for each file that the manifest lists and the bundle does not hold, and for each edited
    one in a folder of `unread`, which nothing here writes or reads."""
    for name, digest in manifest_of(bundle).items():
        path, data = bundle / name, {"attribute": "sha256", "expected": digest}
        if not path.is_file():
            text = "the manifest lists it, and it is not there"
            yield LOST(f"file {name}", text, data=data | {"found": "no file"}, where=name)
        elif name.partition("/")[0] in unread and (found := digest_file(path)) != digest:
            text = "it was edited, and nothing here writes or reads it"
            yield LOST(f"file {name}", text, data=data | {"found": found}, where=name)


def _files(folder: Path) -> list[Path]:
    """The robot's own files: scenes include them, payloads belong to the USD."""
    files = [
        *sorted(p for p in (folder / "mjcf").glob("*.xml") if not p.stem.startswith("scene")),
        *sorted((folder / "urdf").glob("*.urdf")),
        *sorted((folder / "usd").glob("*.usda")),
    ]
    if not files:
        raise UsageError(
            f"`{folder}` is no bundle: no mjcf/*.xml, urdf/*.urdf or usd/*.usda in it",
            hint="give a bundle, or one MJCF, URDF or USD file",
        )
    return files


def _validated(file: Path, name: str, wish: Wish) -> Validated:
    if not file.is_file():  # to read a pipe would never end
        raise UsageError(f"{name}: not a file that can be read")
    if file.stat().st_size > LARGEST_MB << 20:
        raise UsageError(f"{name}: larger than {LARGEST_MB} MB")
    kind = KINDS.get(file.suffix.lower())
    if kind is None:
        hint = f"known: {', '.join(KINDS)}"
        raise UsageError(f"{name}: not a kind of file that can be validated", hint=hint)
    if kind == "mjcf" and b"<robot" in file.read_bytes()[:4096]:
        kind = "urdf"
    findings = list({"mjcf": _mjcf, "urdf": _urdf, "usd": _usd}[kind](file))
    if wish.simulate and kind != "mjcf":  # which is tried while it is read
        findings += {"urdf": _try_urdf, "usd": _try_usd}[kind](file, wish, findings)
    # Two lints may say the same of a link that is a body too.
    once = [one for at, one in enumerate(findings) if one not in findings[:at]]
    return Validated(name, kind, tuple(worst_first(once)))


def _mjcf(file: Path) -> Iterator[Finding]:
    from assetbuild.checks.mjcf_compiles import LOAD, lint_file
    from assetbuild.checks.mjx_pairs import judge
    from assetbuild.checks.trials import Trials
    from assetbuild.simulators.mujoco import load

    findings = list(lint_file(file))
    yield from findings
    if any(finding.rule == "mjcf.load" for finding in findings):
        return
    if "mjx" in file.stem:
        yield from judge(load(file).model)
    elif not file.stem.endswith("_bare"):
        scene = file.parent / "scene.xml"  # a bundle's own: the robot on a floor
        ours = file.parent.name == "mjcf" and scene.is_file()
        tried = scene if ours else file
        try:
            model = load(tried, visuals=False).model
        except StepError as error:
            yield LOAD("robot", f"MuJoCo refuses {tried.name}: {error.message}")
            return
        yield from Trials().examine(model, {})


def _usd(file: Path) -> Iterator[Finding]:
    from assetbuild.checks.usd_valid import lint_file
    from assetbuild.facts.reader import BROKEN
    from assetbuild.facts.readers._usd import UsdReader, ignored_words

    yield from lint_file(file)
    try:
        table = UsdReader(robot=file.stem).read(file)
    except (UsageError, *BROKEN):
        return  # OpenUSD's own validators speak of such a file
    yield from ignored_words(table)
    yield from _lint_numbers(table)


def _lint_numbers(table: Table) -> Iterator[Finding]:
    """Numbers that OpenUSD's validators take and engines repair in silence or refuse.

    Tensors that no matter has, and limits the wrong way round, by the rules of a URDF's links.
    A mass or tensor of 0 is not stated: engines compute it from the shapes.
    """
    for name in table.names("body"):
        facts: Any = table.of("body", name)  # Any: a number and a tensor, as the reader has them
        mass, tensor = facts["mass"], facts.get("inertia", (0.0,) * 6)
        if not all(map(math.isfinite, (mass, *tensor))):
            yield MASS(f"link {name}", "its mass or its inertia is not a finite number")
        elif mass and any(tensor):
            inertial = Inertial(mass, (0.0, 0.0, 0.0), tensor)
            judged = mass_findings(f"link {name}", inertial, InertiaBounds(), "error")
            yield from (finding for finding in judged if finding.severity == "error")
    for name in table.names("joint"):
        facts = table.of("joint", name)
        limits = Limits(facts.get("lower"), facts.get("upper"))
        kind: JointKind = "prismatic" if facts.get("type") == "linear" else "revolute"
        yield from crossed_limits(Joint(name, kind, "", "", limits=limits), "error")


def _urdf(file: Path) -> Iterator[Finding]:
    """The reader and both lints; packages are not looked for, meshes are not opened."""
    from assetbuild.body.merge_fixed_joints import MergeFixedJoints
    from assetbuild.source.urdf.read_urdf import without_meshes

    data = file.read_bytes()
    lines: dict[str, int] = {}

    def placed(findings: Iterable[Finding]) -> Iterator[Finding]:
        for finding in findings:
            line = lines.get(finding.subject)
            yield finding.at(f"{file.name}:{line}") if line else finding

    with scratch() as ports:
        ports.put("robot.urdf", data)
        try:
            read = ports.run(without_meshes(file, data))
        except SourceError as error:
            where = str(replace(error.where, file=file.name)) if error.where else ""
            yield UNREADABLE("robot", error.message, error.hint, where=where)
            return
        yield from read
        lines |= json.loads(ports.read("source_map.json"))["lines"]
        merge = MergeFixedJoints(merge=True, keep_bodies=())
        for step in (LintLinks(), merge, LintBodies()):
            yield from placed(ports.run(step))
        tree = RobotFiles(ports.folder).tree
    yield from placed(mirror_findings(twins(tree, Control()), Tolerances()))


def _try_urdf(file: Path, wish: Wish, read: Sequence[Finding]) -> list[Finding]:
    """What a build of the recipe that `init` would write finds besides."""
    if any(finding.rule == "urdf.unreadable" for finding in read):
        return []
    try:
        report = _built(file, wish)
    except AssetBuildError as error:
        where = str(error.where or "")
        hint = error.hint or "`--static` only reads the file"
        message = f"not simulated: {error.message}"
        return [UNTRIED("robot", message, hint, severity="warning", where=where)]
    known = {(finding.rule, finding.subject) for finding in read}
    return [
        finding
        for finding in report.findings
        if finding.severity != "info"
        and not finding.subject.startswith("recipe ")  # nobody has written it
        and (finding.rule, finding.subject) not in known
    ]


def _try_usd(file: Path, wish: Wish, read: Sequence[Finding]) -> list[Finding]:
    """Loaded, dropped without contacts, and left on a floor for two seconds, in PhysX."""
    if any(finding.severity == "error" for finding in read):
        message = "not tried in PhysX because of the errors above"
        return [UNTRIED("robot", message)]
    if lack := lacking(physx.PhysxCheck.requires, World()):
        return [UNTRIED("robot", f"not tried in PhysX: {lack}")]
    air = Setting(TIMESTEP_S, GRAVITY, contacts=False)
    floor = Setting(TIMESTEP_S, GRAVITY, at=Pose((0.0, 0.0, HIGH_M)), floor_friction=1.0)
    steps = round(DROP_S / TIMESTEP_S)
    experiments = (
        Experiment("load", air),
        Experiment("fall", air, steps=steps, every=steps),
        Experiment("floor", floor, steps=4 * steps, every=steps),
    )
    start = physx.PhysxCheck.start
    return list(tried(perform_on_stages(start, file, experiments, MOST_S, copied=False), air))


# --- a robot that has no recipe, simulated --------------------------------------------------

TIMESTEP_S, DROP_S, HIGH_M, MOST_S = 0.005, 0.5, 1.0, 240.0
GRAVITY: Vec3 = (0.0, 0.0, -9.81)
BROKEN = 0.05
"""Relative error of a fall above which something is wrong with the asset."""

UNTRIED = Rule(
    "trials.not_simulated",
    ("info", "warning"),
    "`assetbuild validate` has only read the file (a warning for a URDF)",
    "the message says what is missing; `--package NAME=PATH` says where meshes are",
)


def _built(file: Path, wish: Wish) -> Report:
    """Findings and checks of a URDF in MuJoCo, with the recipe that `wish.propose` writes.

    Every mesh collides as its hull: a decomposition takes minutes and changes no joint. Nothing is
    written outside the store. Raises AssetBuildError for what cannot be built.
    """
    with tempfile.TemporaryDirectory(prefix="try-") as folder:
        recipe = Path(folder).resolve() / "recipe.yaml"
        wish.propose(file, recipe)
        loaded = load_recipe(recipe)
        collision = loaded.recipe.collision
        hulls = {
            "default": _hulls(collision.default),
            "links": {name: _hulls(rule) for name, rule in collision.links.items()},
        }
        targets = tuple(target for target in loaded.recipe.targets if target == "mjcf")
        loaded = loaded.but(collision=collision.model_copy(update=hulls), targets=targets)
        with open_session(loaded, remote=wish.remote) as session:
            work = Opened(loaded, None, session, on_event=wish.on_event)
            done = work.made(lambda p: plan(loaded, None, p, drawn=False))
            return evaluate(loaded, done, session)


def _hulls(rule: CollisionRule) -> CollisionRule:
    if rule.method == "none":
        return rule
    return collision_rule(**{"method": "hull", "from": rule.from_})


def tried(done: Mapping[str, Outcome], air: Setting) -> Iterator[Finding]:
    """What is wrong with a stage, once it was loaded, dropped and left on a floor."""
    held = done["load"].held
    if held is None or held["articulations"] + len(held["loose"]) == 0:
        why = done["load"].failure or "it holds no body that moves"
        yield physx.LOAD("robot", f"PhysX does not load it: {why}")
        return
    for name, where in (("fall", "in free fall"), ("floor", "on a floor")):
        if not done[name].finite:
            why = done[name].failure or "its state is not finite"
            yield physx.NOT_FINITE("robot", f"{where}: {why}")
    if held["articulations"] != 1:
        message = f"PhysX holds {held['articulations']} articulations, not one"
        yield physx.ARTICULATION("robot", message, severity="warning")
    for body in held["loose"]:
        message = "PhysX keeps it outside of every articulation"
        yield physx.LOOSE_BODY(f"link {body}", message, severity="warning")
    if held["articulations"] == 1 and not held["fixed_base"] and done["fall"].finite:
        yield from _fell(done["fall"], air)


def _fell(outcome: Outcome, setting: Setting) -> Iterator[Finding]:
    """Whatever the solver's iterations, gravity makes between g/2 t^2 and g/2 t (t + dt)."""
    fall = fall_of(Experiment("fall", setting), outcome)
    if fall is None:
        return
    least = fall.expected_m - 0.5 * abs(GRAVITY[2]) * fall.seconds * setting.timestep
    error = max(least - fall.drop_m, fall.drop_m - fall.expected_m, fall.sideways_m)
    if error > BROKEN * fall.expected_m:
        yield physx.FREE_FALL(
            "robot",
            f"fell {fall.drop_m:.4g} m and {fall.sideways_m:.3g} m sideways in "
            f"{fall.seconds:g} s, expected {fall.expected_m:.4g} m",
            hint="is a body damped, welded, or outside of the articulation?",
            data={"drop_m": fall.drop_m, "expected_m": fall.expected_m},
        )
