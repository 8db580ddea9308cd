"""A robot that has no recipe, simulated: an URDF in MuJoCo, a USD in PhysX."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from assetbuild.engine.actions import SharedCache
from assetbuild.engine.execute import Listener
from assetbuild.engine.world import World
from assetbuild.findings import Finding, Rule
from assetbuild.kinds import lacking
from assetbuild.pipeline.judging import judged
from assetbuild.pipeline.opening import Opened, open_session
from assetbuild.pipeline.recipes import collision_rule, load_recipe
from assetbuild.plan import plan
from assetbuild.recipe.collision import CollisionRule
from assetbuild.recipe.models import Recipe
from assetbuild.report.document import Report
from assetbuild.robot.pose import Pose, Vec3
from assetbuild.simulators import physx
from assetbuild.simulators.experiments import Experiment, Outcome, Setting
from assetbuild.simulators.free_fall import fall_of

TIMESTEP_S, DROP_S, HIGH_M = 0.005, 0.5, 1.0
GRAVITY: Vec3 = (0.0, 0.0, -9.81)
BROKEN = 0.05
"""Relative error of a fall above which something is wrong with the asset."""

UNTRIED = Rule(
    "trials.untried",
    ("info", "warning"),
    "`assetbuild validate` has only read the file (a warning for a URDF)",
    "the message says what is missing; `--package NAME=PATH` says where meshes are",
)


def try_urdf(
    propose: Callable[[Path], None], on_event: Listener, remote: SharedCache | None = None
) -> Report:
    """Findings and checks in MuJoCo, with the recipe that `propose` writes to a path.

    Every mesh collides as its hull: a decomposition takes minutes and changes no joint. Nothing is
    written outside the store. Raises AssetBuildError for what cannot be built.
    """
    with tempfile.TemporaryDirectory(prefix="try-") as folder:
        recipe = Path(folder).resolve() / "recipe.yaml"
        propose(recipe)
        loaded = load_recipe(recipe)
        loaded = loaded.but(**_in_mujoco(loaded.recipe))
        with open_session(loaded, remote=remote) as session:
            work = Opened(loaded, None, session, on_event=on_event)
            done = work.made(lambda p: plan(loaded, None, p, drawn=False))
            return judged(loaded, done, session)


def _in_mujoco(recipe: Recipe) -> dict[str, object]:
    """Hulls in place of every method but `none`, and no target that the trials do not read."""
    collision = recipe.collision.model_copy(
        update={
            "default": _hulls(recipe.collision.default),
            "links": {name: _hulls(rule) for name, rule in recipe.collision.links.items()},
        }
    )
    targets = tuple(target for target in recipe.targets if target == "mjcf")
    return {"collision": collision, "targets": targets}


def _hulls(rule: CollisionRule) -> CollisionRule:
    if rule.method == "none":
        return rule
    return collision_rule(**{"method": "hull", "from": rule.from_})


def try_usd(file: Path) -> Iterator[Finding]:
    """Loaded, dropped without contacts, and left on a floor for two seconds."""
    if lack := lacking(physx.REQUIRES, World()):
        yield UNTRIED("robot", f"not tried in PhysX: {lack}")
        return
    air = Setting(TIMESTEP_S, GRAVITY, contacts=False)
    floor = Setting(TIMESTEP_S, GRAVITY, at=Pose((0.0, 0.0, HIGH_M)), floor_friction=1.0)
    steps = round(DROP_S / TIMESTEP_S)
    done = physx.perform(
        file,
        (
            Experiment("load", air),
            Experiment("fall", air, steps=steps, every=steps),
            Experiment("floor", floor, steps=4 * steps, every=steps),
        ),
        copied=False,
    )
    yield from tried(done, air)


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
