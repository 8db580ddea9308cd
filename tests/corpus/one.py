"""One robot through `init` and `build`: its row of the table.

As a program: the robot as JSON on the standard input, the row on the standard output. The runner
starts it that way: whatever a robot does to this process is an outcome.
"""

from __future__ import annotations

import ctypes
import json
import re
import resource
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

from tests.corpus.judge import evaluate
from tests.corpus.lists import Robot
from tests.corpus.rules import broken
from tests.corpus.xacros import XacroError, expanded, packages_in

SECONDS = 300
"""For `init` and `build` together."""
MEMORY_BYTES = 8 << 30
"""Limit of data memory for each process that they start."""


def one(
    robot: Robot, work: Path, seconds: float = SECONDS, *, hulls: bool = True
) -> dict[str, object]:
    """Init and build; everything that the table says about it. hulls: see `with_hulls`."""
    folder = work / folder_name(robot.name)
    folder.mkdir(parents=True, exist_ok=True)
    recipe, bundle = folder / "recipe.yaml", folder / "bundle"
    row: dict[str, object] = {"result": "refused", "note": ""}
    started = time.monotonic()
    done = run("init", str(robot.file), *robot.words, "-o", str(recipe), "--force", seconds=seconds)
    verb = "init"
    if done.returncode == 0:
        if hulls:
            with_hulls(recipe)
        left, verb = seconds - (time.monotonic() - started), "build"
        done = run("build", str(recipe), "-o", str(bundle), seconds=left)
        row |= reported(folder, done.returncode)
    row["seconds"] = round(time.monotonic() - started, 1)
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    row["cpu_seconds"] = round(used.ru_utime + used.ru_stime, 1)
    row["peak_mb"] = used.ru_maxrss // 1024  # of the largest process
    if row["result"] == "refused":
        row |= stopped(done, verb, robot.root)
    return row | compared_with_source(robot, folder, row)


def folder_name(name: str) -> str:
    return re.sub(r"[^A-Za-z0-9_]", "_", name.removesuffix(".urdf"))


# --- assetbuild -----------------------------------------------------------------------------


def run(*words: str, seconds: float | None = None) -> subprocess.CompletedProcess[str]:
    """Exit code 124: it took longer, and was asked to stop."""
    command = [sys.executable, "-m", "assetbuild", *words]
    with subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
        preexec_fn=_limit if seconds else None,
    ) as child:
        try:
            out, error = child.communicate(timeout=seconds)
        except subprocess.TimeoutExpired:
            child.terminate()
            try:
                child.communicate(timeout=20)
            except subprocess.TimeoutExpired:
                child.kill()
            return subprocess.CompletedProcess(command, 124, "", f"no end after {seconds:.0f} s")
    return subprocess.CompletedProcess(command, child.returncode, out, error)


def _limit() -> None:
    _end_with_parent()
    resource.setrlimit(resource.RLIMIT_DATA, (MEMORY_BYTES, MEMORY_BYTES))


def _end_with_parent() -> None:
    """A run that is killed leaves nobody behind (Linux)."""
    ctypes.CDLL(None).prctl(1, signal.SIGTERM)  # PR_SET_PDEATHSIG


def with_hulls(recipe: Path) -> None:
    """Convex hulls for collision: this is about the robots, not about decomposition.

    Hulls lie in each other where the pieces of `auto` do not, so that does not count.
    """
    text = recipe.read_text(encoding="utf-8")
    if "{method: auto," in text:
        waiver = '{severity: info, because: "hulls in place of the pieces"}'
        text = text.replace("{method: auto,", "{method: hull,")
        text += f"rules: {{trials.overlap: {waiver}}}\n"
        recipe.write_text(text, encoding="utf-8")


def stopped(done: subprocess.CompletedProcess[str], verb: str, root: Path) -> dict[str, object]:
    """Return the outcome of a run without a bundle: refused (exit code 2), or failed."""
    note = error_of(done.stderr + done.stdout).replace(str(root), "")
    if "Traceback" in done.stderr:
        return {"result": "failed", "cause": f"{verb}: traceback", "note": last(done.stderr)}
    if done.returncode == 124:
        return {"result": "failed", "cause": f"{verb}: time", "note": done.stderr}
    if done.returncode != 2:
        return {"result": "failed", "cause": f"{verb}: {class_of(note)}", "note": note}
    return {"cause": f"{verb}: {class_of(note)}", "note": note}


def error_of(text: str) -> str:
    """The first error line."""
    lines = [line for line in text.splitlines() if "error" in line.lower()] or text.splitlines()
    return lines[0].removeprefix("error: ")[:300] if lines else ""


def last(text: str) -> str:
    return text.strip().splitlines()[-1][:300]


def class_of(note: str) -> str:
    """The message without the robot's own names and numbers, so that like causes are alike."""
    words = re.sub(r"`[^`]*`?", "`…`", re.sub(r"^\S*?:\d+(:\d+)?: ", "", note))
    words = re.sub(r"\b(link|joint|body|geom|mesh|actuator) \S+?(?=[:,]|$| )", r"\1 …", words)
    return re.sub(r"[-+]?\d[\d.,e+-]*", "N", words)[:90]


def reported(folder: Path, code: int) -> dict[str, object]:
    """What the bundle's report says; a bundle in `bundle.failed` is not ready."""
    bundle = folder / ("bundle" if code == 0 else "bundle.failed")
    report = bundle / "report/report.json"
    if not report.is_file():
        return {}
    said = json.loads(report.read_text())
    findings = said["findings"]
    errors = [f for f in findings if f["severity"] == "error"]
    row: dict[str, object] = {
        "result": "ready" if said["verdict"]["ready"] else "not ready",
        "bundle": bundle.name,
        "findings": dict(Counter(f["severity"] for f in findings)),
        "edits": dict(Counter(f["rule"][5:] for f in findings if f["rule"].startswith("edit."))),
        "lost": sorted({f["subject"] for f in findings if f["rule"].startswith("count.")}),
    }
    if errors:
        first, rules = errors[0], ", ".join(sorted({e["rule"] for e in errors}))
        note = f"{len(errors)} errors ({rules}): {first['subject']}: {first['message']}"
        row |= {"cause": first["rule"], "note": note[:300], "where": first["where"]}
    elif not said["verdict"]["ready"]:
        row["cause"] = ", ".join(said["verdict"]["blocked_by"])
        row["note"] = said["verdict"]["next_step"][:300]
    return row | driven(bundle)


def driven(bundle: Path) -> dict[str, object]:
    """Actuators and joints of the MJCF, as MuJoCo compiles it."""
    import mujoco

    (path,) = [p for p in (bundle / "mjcf").glob("*.xml") if p.name != "scene.xml"]
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        return {"note": f"MuJoCo: {error}"[:200]}
    moving = sum(kind != mujoco.mjtJoint.mjJNT_FREE for kind in model.jnt_type)
    return {"actuators": int(model.nu), "joints": int(moving)}


def compared_with_source(robot: Robot, folder: Path, row: dict) -> dict[str, object]:
    """What others say: the rule that the source breaks, and the judges."""
    packages = packages_in(robot.root)
    try:
        source = description(robot, folder, packages)
    except XacroError as error:
        return left_out(row, f"readers: xacro: {error}")
    breaks = broken(source)
    if row["result"] != "ready":
        return {"breaks": breaks} | (left_out(row, breaks) if breaks else {})
    edited = bool(set(row["edits"]) - {"merge"})

    def find(uri: str) -> Path | None:
        return resolved(uri, robot.file, robot.root, packages)

    try:
        judge = evaluate(source, folder / str(row["bundle"]), find, edited=edited)
    except Exception as error:  # a judge that fails is no acquittal: its name stands in the table
        judge = f"not judged: {type(error).__name__}: {error}"[:200]
    return {"breaks": breaks, "judge": judge}


# --- others ---------------------------------------------------------------------------------


def left_out(row: dict, rule: str) -> dict[str, object]:
    """The robot breaks a rule that was written down: it does not count, and is named."""
    return {
        "result": "left out",
        "cause": rule.partition(":")[0],
        "note": f"{rule}; we say: {row['result']}: {row['note']}"[:400],
    }


def description(robot: Robot, folder: Path, packages: dict[str, Path]) -> Path:
    """The description itself, of a xacro what it expands to."""
    if robot.file.suffix != ".xacro":
        return robot.file
    path = folder / "expanded.urdf"
    path.write_bytes(expanded(robot.file, robot.args, packages))
    return path


def resolved(uri: str, file: Path, folder: Path, packages: Mapping[str, Path]) -> Path | None:
    """The file of a mesh, where any reader of the field would look for it."""
    kind, _, rest = uri.rpartition("://")
    rest = rest.lstrip("/")
    places: list[Path] = []
    if kind == "file":
        places.append(Path("/") / rest)
    if kind in ("package", "model", "file"):
        package, _, inside = rest.partition("/")
        if package in packages:
            places.append(packages[package] / inside)
        places += [parent / inside for parent in above(file, folder) if parent.name == package]
        places += [parent / inside for parent in above(file, folder)]
    places += [parent / rest for parent in above(file, folder)]
    return next((place for place in places if place.is_file()), None)


def above(file: Path, folder: Path) -> list[Path]:
    return [parent for parent in file.parents if parent.is_relative_to(folder)]


def main() -> int:
    _end_with_parent()
    given = json.load(sys.stdin)
    work, seconds = Path(given.pop("work")), given.pop("seconds")
    robot = Robot(given["name"], Path(given["file"]), Path(given["root"]), given["args"])
    print(json.dumps(one(robot, work, seconds, hulls=given["hulls"])))
    return 0


if __name__ == "__main__":
    sys.exit(main())
