"""Robots through PhysX and two validators, a row each: `python -m tests.benchmarks.usd_table`.

    python -m tests.benchmarks.usd_table --validator PYTHON --usd PYTHON [--usd PYTHON] [ROBOT ...]

ROBOT: a name, or a URDF of yours; no wheel on PyPI has Cassie's, so get that of
github.com/robot-descriptions/cassie_description. Each is built as MJCF and USD with the checks in
MuJoCo and PhysX: by its recipe in `recipes/`, else as `init` proposes, with hulls for collision.
Its USD then goes to

- `--validator`: an environment with omniverse-asset-validator (all rules; slow);
- `--usd`, repeated: environments with other versions of usd-core, which count what they see.

The table says pass or fail alone; below it stands what failed. `--work` keeps the bundles, whose
reports have the figures. PhysX's licence does not let those be published: do not commit them.
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

sys.path.insert(0, str(Path(__file__).parents[1]))

from corpus.lists import data_root
from corpus.one import error_of, run, with_hulls

from assetbuild.cli.public import shown_message
from assetbuild.findings import Finding, finding_from_json

RECIPES = Path(__file__).parents[2] / "recipes"
LIBRARY = ("go1", "go2", "g1", "ur10", "panda", "xarm7", "talos", "b1_z1", "allegro_right")
URDFS = {
    "pr2": "robots/pr2_description/urdf/pr2.urdf",
    "icub": "robots/icub_description/robots/icub.urdf",
}
"""Of example-robot-data."""
ROBOTS = (*LIBRARY, *URDFS)
VALIDATOR_S = 1500.0
BOTH = {"simulators": ["mujoco", "physx"], "trials": None, "mirror": None, "free_fall": {}}
"""The keys of `validate`; what concerns MuJoCo alone is left out."""
COUNT = """
import json, sys
from pxr import Usd, UsdGeom, UsdPhysics, UsdShade
stage = Usd.Stage.Open(sys.argv[1])
prims = list(Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies()))
colliders = {p.GetPath() for p in prims if p.HasAPI(UsdPhysics.CollisionAPI)}
print(json.dumps({
    "version": ".".join(map(str, Usd.GetVersion()[1:])),
    "bodies": sum(p.HasAPI(UsdPhysics.RigidBodyAPI) for p in prims),
    "joints": sum(p.IsA(UsdPhysics.Joint) and len(UsdPhysics.Joint(p).GetBody0Rel().GetTargets())
                  for p in prims),
    "colliders": len(colliders),
    "visuals": sum(p.IsA(UsdGeom.Gprim) and p.GetPath() not in colliders for p in prims),
    "materials": sum(p.IsA(UsdShade.Material) and not p.HasAPI(UsdPhysics.MaterialAPI)
                     for p in prims),
}))
"""
"""Runs where nothing of ours is installed."""
COUNTED = ("bodies", "joints", "colliders", "visuals", "materials")
HEAD = (
    *("robot", "USD: bodies, joints, colliders, meshes, materials", "are the robot's"),
    *("PhysX holds the robot", "falls", "sine", "as it is", "5 s finite", "base still"),
    *("UsdValidation", "asset validator", "opens in usd-core", "s"),
)

Json = dict[str, Any]  # Any: a report


@dataclass(frozen=True)
class Row:
    """cells: without the robot's name; notes: what failed, in words."""

    cells: tuple[str, ...]
    notes: tuple[str, ...]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("robots", nargs="*", default=ROBOTS, metavar="ROBOT", help=" ".join(ROBOTS))
    parser.add_argument("--validator", metavar="PYTHON", help="has omniverse-asset-validator")
    parser.add_argument("--usd", metavar="PYTHON", action="append", default=[], help="has usd-core")
    parser.add_argument("--data", type=Path, help="folder with example-robot-data, unpacked")
    parser.add_argument("--work", type=Path, help="keep recipes and bundles here")
    parser.add_argument("--hulls", action="store_true", help="hulls for `auto`, to be quick")
    parser.add_argument("--kept", action="store_true", help="do not build what lies in --work")
    options = parser.parse_args()
    unknown = {n for n in options.robots if n not in ROBOTS and not Path(n).is_file()}
    if unknown:
        parser.error(f"no robot {', '.join(sorted(unknown))}; there are {', '.join(ROBOTS)}")
    print(f"| {' | '.join(HEAD)} |\n|{' --- |' * len(HEAD)}", flush=True)
    notes = []
    with tempfile.TemporaryDirectory(prefix="usd-table-") as scratch:
        for name in options.robots:
            folder = (options.work or Path(scratch)) / Path(name).stem
            row = one(name, folder, options)
            print(f"| {' | '.join((folder.name, *row.cells))} |", flush=True)
            notes += [f"- {folder.name}: {note}" for note in row.notes]
    print("\n".join(["", *notes]))
    return 1 if any(": warning " not in note for note in notes) else 0


def one(name: str, folder: Path, options: argparse.Namespace) -> Row:
    """Build one robot and ask everybody about its USD."""
    started = time.monotonic()
    bundle = folder / "bundle"
    if not (options.kept and (bundle / "report/report.json").is_file()):
        failure = built(name, folder, options.data, options.hulls)
        if failure:
            return Row(("-",) * (len(HEAD) - 1), (failure,))
    report = json.loads((bundle / "report/report.json").read_text(encoding="utf-8"))
    (main_file,) = [p for p in (bundle / "usd").glob("*.usda") if p.name != "scene.usda"]
    findings = [finding_from_json(f) for f in report["findings"]]
    counted = subprocess.run([sys.executable, "-c", COUNT, str(main_file)], capture_output=True)
    counts = json.loads(counted.stdout)
    opened = [opens(python, main_file, counts) for python in options.usd]
    validator, complaint = asked(options.validator, main_file)
    cells = (
        ", ".join(str(counts.get(kind, "-")) for kind in COUNTED),
        passed(findings, "equal.usd."),
        *physics(report, findings),
        passed(findings, "usd.validation", "usd.unresolved"),
        validator,
        ", ".join(version for version, _ in opened) or "not asked",
        f"{time.monotonic() - started:.0f}",
    )
    others = [complaint, *(difference for _, difference in opened)]
    return Row(cells, (*told(findings), *filter(None, others)))


def built(name: str, folder: Path, data: Path | None, hulls: bool) -> str:
    """Write `folder/bundle`; why that failed, or ""."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    recipe = folder / "recipe.yaml"
    if name in LIBRARY:
        shutil.copy(RECIPES / f"{name}.yaml", recipe)
        shutil.copy(RECIPES / f"{name}.lock.yaml", folder / "recipe.lock.yaml")
        if hulls:
            with_hulls(recipe)
    else:
        urdf = data_root(data) / URDFS[name] if name in URDFS else Path(name)
        done = run("init", str(urdf), "-o", str(recipe))
        if done.returncode != 0:
            return error_of(done.stderr)
        with_hulls(recipe)
        exclude_overlaps(recipe)
    patch(recipe, targets=["mjcf", "usd"], validate=BOTH)
    words = ("-o", str(folder / "bundle"), "--fail-on", "never")
    done = run("build", str(recipe), *words)
    return "" if (folder / "bundle").is_dir() else error_of(done.stderr + done.stdout)


def patch(recipe: Path, **changes: Any) -> None:  # Any: YAML
    """Put other keys into a recipe, those of `validate` beside what stands there."""
    said = yaml.safe_load(recipe.read_text(encoding="utf-8"))
    checks = (said.get("validate") or {}) | changes.pop("validate", {})
    said |= changes | {"validate": checks}
    for other in ("variants", "mjx"):
        said.pop(other, None)
    recipe.write_text(yaml.safe_dump(said, sort_keys=False), encoding="utf-8")


def exclude_overlaps(recipe: Path) -> None:
    """Exclude what lies in one another at home, as the check `stand` asks: hulls often do."""
    import mujoco

    folder = recipe.parent / "first"
    patch(recipe, targets=["mjcf"], validate={"trials": None, "mirror": None, "free_fall": None})
    run("build", str(recipe), "-o", str(folder), "--fail-on", "never")
    models = [path for path in (folder / "mjcf").glob("*.xml") if path.name != "scene.xml"]
    if not models:
        return  # the build that follows says why
    model = mujoco.MjModel.from_xml_path(str(models[0]))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    bodies = (sorted(int(model.geom_bodyid[g]) for g in c.geom) for c in data.contact[: data.ncon])
    pairs = {(model.body(a).name, model.body(b).name) for a, b in bodies}
    said = yaml.safe_load(recipe.read_text(encoding="utf-8"))["collision"]
    said["exclude"]["pairs"] = [*said["exclude"].get("pairs", []), *map(list, sorted(pairs))]
    patch(recipe, collision=said)


def passed(findings: Sequence[Finding], *rules: str) -> str:
    """`pass`, or how many findings of these rules say otherwise."""
    found = [f for f in findings if f.rule.startswith(rules) and severity(f) != "info"]
    errors = sum(severity(f) == "error" for f in found)
    words = [f"{n} {kind}" for kind, n in (("errors", errors), ("warnings", len(found) - errors))
             if n]  # fmt: skip
    return ", ".join(words) or "pass"


def severity(finding: Finding) -> str:
    """As the check told it, before the recipe's waivers."""
    return str(finding.data.get("severity_before", finding.severity))


def physics(report: Json, findings: Sequence[Finding]) -> tuple[str, ...]:
    """What PhysX holds, how it falls, follows two sines, keeps its numbers and its base."""
    checks = report["checks"]
    status = {name: check["status"] for name, check in checks.items()}
    if status.get("physx_readback", "skip") == "skip":
        return ("skipped",) * 6
    held = checks["physx_readback"]["figures"]
    motion = ("physx.free_fall", "physx.finite", "physx.drift")
    of_robot = [
        f
        for f in findings
        if f.rule.startswith(("physx.", "equal.physx.")) and f.rule not in motion
    ]
    rows = checks["alignment"]["figures"].get("rows", [])
    fixed = bool(held.get("fixed_base"))
    finite = held.get("finite_alone") and held.get("finite_on_floor")
    return (
        passed([*of_robot, *(f for f in findings if f.rule in HELD_ROWS)], ""),
        "fixed" if fixed else passed(findings, "physx.free_fall", "alignment.physx.free_fall"),
        judged(rows, "sine"),
        judged(rows, "sine_as_is"),
        "pass" if finite and passed(findings, "physx.finite") == "pass" else "fail",
        passed(findings, "physx.drift") if fixed else "floats",
    )


HELD_ROWS = tuple(
    f"alignment.physx.{row}"
    for row in (
        *("missing", "base", "base_pose", "mass", "centre_of_mass", "inertia", "pose", "dof"),
        *("type", "axis", "lower", "upper", "kp", "kd", "damping", "effort", "armature"),
        *("friction", "static_friction", "dynamic_friction", "shapes"),
    )
)


def judged(rows: Sequence[Mapping[str, Any]], name: str) -> str:
    """How many joints' rows are within the design's tolerance, warnings, errors, not judged."""
    verdicts = [row["verdict"] for row in rows if row["row"] == name]
    bad = [f"{verdicts.count(v)} {v}s" for v in ("error", "warning") if v in verdicts]
    if "told" in verdicts:
        bad.append(f"{verdicts.count('told')} touch")
    if not verdicts:
        return "not run"
    return ", ".join(bad) + f" of {len(verdicts)}" if bad else f"pass ({len(verdicts)})"


def told(findings: Sequence[Finding]) -> Iterator[str]:
    """Each loud finding on USD and PhysX."""
    for finding in findings:
        about = finding.rule.startswith(("physx.", "alignment.", "usd.", "equal.usd."))
        if about and severity(finding) != "info":
            place = f"{finding.rule} {finding.subject}"
            yield f"{severity(finding)} {place}: {shown_message(finding)}"


def opens(python: str, main_file: Path, ours: Mapping[str, object]) -> tuple[str, str]:
    """(version of usd-core, what differs from our own count or "")."""
    command = [python, "-c", COUNT, str(main_file)]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode != 0:
        last = done.stderr.strip().rpartition("\n")[2]
        return "fails", f"does not open with {python}: {last}"
    counts = json.loads(done.stdout)
    other = [kind for kind in COUNTED if counts[kind] != ours[kind]]
    version = str(counts["version"])
    said = ", ".join(f"{counts[kind]} {kind}" for kind in other)
    return (f"{version} differs", f"usd-core {version} sees {said}") if other else (version, "")


def asked(python: str | None, main_file: Path) -> tuple[str, str]:
    """(omniverse-asset-validator's errors and warnings, what its first error says or "")."""
    if python is None:
        return "not asked", ""
    tool = Path(python).with_name("omni_asset_validate")
    command = [str(tool), "--no-variants", str(main_file)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=VALIDATOR_S)
    except subprocess.TimeoutExpired:
        return "too slow", f"omniverse-asset-validator took more than {VALIDATOR_S:.0f} s"
    said = done.stdout + done.stderr
    found = dict(re.findall(r"(Errors|Failures|Warnings): (\d+)", said))
    if not found and "No issues found" not in said:
        return "fails", f"omniverse-asset-validator: {said.strip().rpartition(chr(10))[2]}"
    errors = int(found.get("Errors", 0)) + int(found.get("Failures", 0))
    first = next((line for line in said.splitlines() if re.search("ERROR|FAILURE", line)), "")
    cell = f"{errors} errors, {found.get('Warnings', 0)} warnings"
    return cell, f"omniverse-asset-validator: {first[:300]}" if errors else ""


if __name__ == "__main__":
    sys.exit(main())
